"""`vsense sim`: experiments without cameras, network or robots, faster than real time."""
