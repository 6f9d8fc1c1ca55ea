"""Looks after cameras beside the tracker: whoever waits for an arena state need not wait for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.arena import Frame
from vsense.cameras.camera import Camera
from vsense.cameras.grabber import Troubles
from vsense.cameras.health import Health
from vsense.tracking.arena_tracker import ArenaTracker

PERIOD_NS = 80_000_000
"""Pictures that follow each other faster than this are not all looked at."""


class _Noted(NamedTuple):
    frames: Sequence[Frame]
    found: Mapping[str, NDArray[np.void]]
    overflowed: tuple[str, ...]


class CameraWatch:
    """Watches the cameras of a tracker.

    Attributes:
        troubles: What has been noticed so far; for the thread that looks.
    """

    def __init__(
        self, cameras: Sequence[Camera], tracker: ArenaTracker, tell: Callable[[str], None]
    ) -> None:
        """Begins with nothing known of any camera.

        Args:
            cameras: The tracker's cameras.
            tracker: Knows what was found in the newest pictures.
            tell: Takes a line for a person.
        """
        self._tracker = tracker
        self._tell = tell
        self._health = Health(cameras, tracker.heights_m)
        self._noted: _Noted | None = None
        self._looked_ns: int | None = None
        self.troubles = Troubles()

    def note(self, frames: Sequence[Frame]) -> None:
        """Keeps pictures that the tracker has done, for the next look; the tracker's thread."""
        self._noted = _Noted(frames, self._tracker.found, self._tracker.overflowed)

    def look(self) -> None:
        """Looks at the newest pictures, if nobody has; one thread, whenever it has time.

        The pictures' memory must still be theirs.
        """
        noted, self._noted = self._noted, None
        if noted is None or not noted.frames:
            return
        capture_ns = max(frame.capture_ns for frame in noted.frames)
        if self._looked_ns is not None and capture_ns - self._looked_ns < PERIOD_NS:
            return
        self._looked_ns = capture_ns
        for line in self.troubles.lines(self._health.update(*noted)):
            self._tell(line)
