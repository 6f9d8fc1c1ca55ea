"""Benchmarks: how fast and how well, against the best of the others, in one run."""
