"""Watches a tracking session at work on cameras, until something has happened."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from tests.gige.network import MIDDLE, MIDDLES, GigeCameras
from vsense.base.arena import ArenaState, Frame
from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError
from vsense.config.tracking_session import load
from vsense.vision.cameras.grabber import CameraEvent, Troubles
from vsense.vision.tracking.opening import open_tracking

PATIENCE_S = 60.0
STEP_S = 0.5


class Noted(Troubles):
    """What happens to cameras, all of it kept."""

    def __init__(self) -> None:
        super().__init__()
        self.events: list[CameraEvent] = []

    def lines(self, events: Iterable[CameraEvent]) -> list[str]:
        self.events += events
        return []


class Watch:
    """A tracking session on the middles of all pictures, stepped by the test.

    Those are small enough for the memory that any socket has: nothing here depends on it.

    Attributes:
        events: everything that was told so far.
        frames: pictures so far, by the camera's id.
        spreads_ms: of each timestep with all cameras: from its first to its last capture.
        state: the newest arena state.
    """

    def __init__(self, rig: GigeCameras, folder: Path, **settings: object) -> None:
        """Opens all four cameras; the settings are more attributes of every <grabber>."""
        resources, experiment = rig.files(folder, MIDDLE | settings, cameras=MIDDLES)
        session = load(resources, experiment)
        noted = Noted()
        self.events = noted.events
        self._tracking = open_tracking(session, host_ns, print, troubles=noted)
        self.frames = {camera.id: 0 for camera in rig.cameras}
        self.spreads_ms: list[float] = []
        self.state: ArenaState | None = None

    def step(self) -> None:
        """Takes one timestep, if there is one."""
        try:
            self.state, frames = self._tracking.next(STEP_S)
        except GrabberError:
            # No camera at all is there: what happened to them is told all the same.
            frames = []
        self._tracking.check_cameras()
        for frame in frames:
            self.frames[frame.camera] += 1
        if len(frames) == len(self.frames):
            self.spreads_ms.append(_spread_ms(frames))

    def until(self, condition: Callable[[], object], what: str) -> None:
        """Watches until something is so; fails after much longer than it can take."""
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            told = "\n".join(map(str, self.events))
            assert time.monotonic() < end_s, f"waited in vain for {what}; told was:\n{told}"
            self.step()

    def all_deliver(self, count: int = 5) -> None:
        """Watches until every camera has given so many more pictures."""
        self.delivered(*self.frames, count=count)

    def delivered(self, *cameras: str, count: int = 5) -> None:
        """Watches until these cameras have given so many more pictures."""
        wanted = {camera: self.frames[camera] + count for camera in cameras}
        enough = lambda: all(self.frames[c] >= n for c, n in wanted.items())  # noqa: E731
        self.until(enough, f"pictures of {', '.join(cameras)}")

    def told(self, camera: str, kind: str, since: int = 0) -> CameraEvent | None:
        """The last event of a kind, of those since a number of events."""
        found = [e for e in self.events[since:] if (e.camera, e.kind) == (camera, kind)]
        return found[-1] if found else None

    def close(self) -> None:
        """Lets the cameras go."""
        self._tracking.close()


def _spread_ms(frames: Sequence[Frame]) -> float:
    times = [frame.capture_ns for frame in frames]
    return (max(times) - min(times)) / 1e6
