"""The lab's cameras, what tracks in their pictures, and what looks after them: one arena source."""

from __future__ import annotations

from collections.abc import Callable

from vsense.lab.grabber import LabGrabber
from vsense.runtime import Pictures
from vsense.tracking.arena_tracker import ArenaTracker
from vsense.tracking.camera_watch import CameraWatch


class Eyes(Pictures):
    """Arena states from the lab's cameras; `next` belongs to one thread, the rest to any."""

    def __init__(
        self, grabber: LabGrabber, tracker: ArenaTracker, tell: Callable[[str], None]
    ) -> None:
        """Takes both, without owning them.

        Args:
            grabber: the cameras.
            tracker: finds the robots in their pictures.
            tell: takes a line for a person; must not wait.
        """
        self._cameras = grabber
        self._counters = tracker.counters
        self._watch = CameraWatch(grabber, grabber.cameras, tracker, tell)
        super().__init__(self._watch, tracker)
        self._missed_before = 0

    def start_run(self) -> None:
        """The run begins: timesteps left out count from here."""
        self._missed_before = self._cameras.missed

    def figures(self) -> dict[str, int]:
        """What is reported of the cameras.

        Returns:
            `left_out` timesteps of the run whose pictures were overtaken by newer ones,
            `old_pictures` dropped, `overflows` of the detectors' tables, and camera `events`.
        """
        counters = self._counters
        return {
            "left_out": self._cameras.missed - self._missed_before,
            "old_pictures": counters.old_frames + counters.repeated_frames,
            "overflows": counters.overflows,
            "events": sum(self._watch.troubles.counts.values()),
        }
