"""From pixels to the arena state: cameras, markers, detectors, the arena tracker."""
