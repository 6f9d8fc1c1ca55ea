"""`vsense series`: many runs by a plan, without hands: simulated, in the lab, or with real robots."""
