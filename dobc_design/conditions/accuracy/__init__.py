"""How close to the target the agents end under what the model leaves out: disturbances, drift,
noise."""
