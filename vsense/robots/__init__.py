"""Robots: the daemon built and deployed, and the link to it."""
