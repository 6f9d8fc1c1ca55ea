"""`vsense robot calibrate`: wheels, markers and sensors of robots, measured by the cameras."""
