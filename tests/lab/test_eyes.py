"""The lab's cameras as a source of arena states: what was left out and dropped is counted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vsense.arena import DETECTION, Frame
from vsense.cameras.camera import Camera
from vsense.lab.eyes import Eyes
from vsense.tracking.arena_tracker import ArenaTracker

CAMERA = Camera.looking_down("top", 0.0, 0.0, 2.4, 400.0, (320, 240))


class Blind:
    """A detector that finds nothing."""

    overflows = 0

    def detect(self, image: np.ndarray, camera: Camera) -> np.ndarray:
        """Finds nothing."""
        return np.zeros(0, dtype=DETECTION)


class Jumpy:
    """A grabber of dark pictures whose timesteps come as it is told."""

    def __init__(self, timesteps: Sequence[int]) -> None:
        self.cameras = [CAMERA]
        self.missed = 0
        self._timesteps = list(timesteps)
        self._last = -1

    def next(self, timeout_s: float) -> list[Frame]:
        """Gives the next timestep, and counts those before it."""
        timestep = self._timesteps.pop(0)
        self.missed += max(timestep - self._last - 1, 0)
        self._last = timestep
        image = np.full((240, 320), timestep, dtype=np.uint8)
        return [Frame("top", image, timestep, timestep * 100_000_000, 0)]

    def close(self) -> None:
        """Nothing is open."""


def test_what_is_left_out_counts_from_the_start_of_the_run() -> None:
    told: list[str] = []
    tracker = ArenaTracker([CAMERA], Blind, {1: 0.06})
    eyes = Eyes(Jumpy([0, 3, 4, 6, 5, 10]), tracker, told.append)  # type: ignore[arg-type]
    states = []
    for turn in range(6):
        if turn == 2:
            eyes.start_run()
        states.append(eyes.next(1.0)[0])
        eyes.look_after()
    eyes.stop_run()
    tracker.close()
    assert [state.timestep for state in states] == [0, 3, 4, 6, 6, 10]
    assert eyes.figures() == {"left_out": 5, "old_pictures": 1, "overflows": 0, "events": 1}
    assert told == ["camera top: went dark, or is covered (mean grey 4)"]
