"""Campaigns of `vsense sim`: every combination of settings and seeds."""
