"""From pictures to the arena state: detectors, tracks, the arena tracker."""
