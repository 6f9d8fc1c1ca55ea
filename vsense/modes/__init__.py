"""Three ways to run an experiment: simulated, in the lab, with real robots."""
