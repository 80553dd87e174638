"""From a setpoint and a model to a current that a person in front of the header can live with."""
