"""`vsense series`: many runs by a plan, without hands: in sim, in the lab or with robots."""
