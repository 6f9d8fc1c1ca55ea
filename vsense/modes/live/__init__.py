"""Real cameras and robots: what vsense run, track and serve do."""
