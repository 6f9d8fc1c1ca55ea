"""The link to other trackers, and to clients of the original tracking system."""
