"""The threads that look at pictures: a detector each, on a processor each where that is wanted."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.arena import Frame
from vsense.cameras.camera import Camera
from vsense.tracking.detector import Detector


class Look(NamedTuple):
    """What was found in one picture.

    Attributes:
        rows: DETECTION array.
        full: Whether there was more in it than the detector's tables hold.
    """

    rows: NDArray[np.void]
    full: bool


class Workers:
    """Shares pictures out to threads; the same pictures to the same ones, whoever is faster."""

    def __init__(self, make_detector: Callable[[], Detector], number: int, pin: bool) -> None:
        """Starts the threads.

        Args:
            make_detector: Makes one detector per thread.
            number: How many threads, 1 or more.
            pin: Keep each on a processor of its own, where there are as many.
        """
        self._detectors = [make_detector() for _ in range(number)]
        turns = count()
        begin = (lambda: _pin(next(turns))) if pin else None
        self._pool = ThreadPoolExecutor(number, "tracking", begin)

    def look(self, frames: Sequence[Frame], cameras: Mapping[str, Camera]) -> list[Look]:
        """Returns what is in each picture, in the order of the pictures.

        Args:
            frames: The pictures.
            cameras: By their ids.
        """
        number = len(self._detectors)

        def work(worker: int) -> list[Look]:
            detector = self._detectors[worker]
            return [_look(detector, f, cameras[f.camera]) for f in frames[worker::number]]

        shares = list(self._pool.map(work, range(number)))
        return [shares[place % number][place // number] for place in range(len(frames))]

    def close(self) -> None:
        """Ends the threads; can be called again."""
        self._pool.shutdown()


def _look(detector: Detector, frame: Frame, camera: Camera) -> Look:
    before = detector.overflows
    rows = detector.detect(frame.image, camera)
    return Look(rows, detector.overflows != before)


def _pin(turn: int) -> None:
    """Keeps the calling thread on the processor of its turn, where the system can do that."""
    if hasattr(os, "sched_setaffinity"):
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {allowed[turn % len(allowed)]})
