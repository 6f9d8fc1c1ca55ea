"""Markers: families, codes that cameras can distinguish, and printable sheets."""
