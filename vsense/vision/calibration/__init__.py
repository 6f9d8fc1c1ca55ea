"""Calibration: from pictures of a printed board to camera files."""
