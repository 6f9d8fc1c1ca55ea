"""Printable sheets of markers, true to scale."""
