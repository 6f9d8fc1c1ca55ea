"""What is seen: cameras, fiducial markers, tracking, calibration."""
