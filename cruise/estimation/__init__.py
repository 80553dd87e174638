"""Online: from samples to a model, one at a time."""
