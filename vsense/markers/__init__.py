"""Markers: what they look like, which can be told apart, and printable sheets."""
