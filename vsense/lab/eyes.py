"""The lab's cameras, what tracks in their pictures, and what looks after them: one arena source."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from vsense.arena import ArenaState, Frame
from vsense.cameras.grabber import Troubles
from vsense.lab.grabber import LabGrabber
from vsense.run.runtime import Pictures
from vsense.tracking.arena_tracker import ArenaTracker
from vsense.tracking.camera_watch import CameraWatch


class Eyes(Pictures):
    """Arena states from the lab's cameras; `next` belongs to one thread."""

    def __init__(
        self, grabber: LabGrabber, tracker: ArenaTracker, tell: Callable[[str], None]
    ) -> None:
        """Takes both, without owning them.

        Args:
            grabber: the cameras.
            tracker: finds the robots in their pictures.
            tell: takes a line for a person.
        """
        super().__init__(grabber, tracker)
        self._cameras = grabber
        self._counters = tracker.counters
        self._watch = CameraWatch(grabber.cameras, tracker, tell)
        self._missed_before = 0

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        """Waits for pictures and tracks the robots in them.

        Raises:
            GrabberError: no picture came in time.
            VsenseError: the tracker has failed.
        """
        state, frames = super().next(timeout_s)
        self._watch.note(frames)
        return state, frames

    def look_after(self) -> None:
        """Looks after the cameras; one thread, when the timestep's work is done."""
        self._watch.look()

    @property
    def troubles(self) -> Troubles:
        """What the cameras suffer from."""
        return self._watch.troubles

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
