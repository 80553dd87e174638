"""The running service: what is on the bus, the loop that is its only clock, and the virtual drive around it."""
