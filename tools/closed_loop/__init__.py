"""The closed loop on the virtual combine: courses, drivers, figures."""
