"""The threads that look at pictures: in order, in parallel, and each where it belongs."""

from __future__ import annotations

import os
import threading

import numpy as np
import pytest

from vsense.arena import DETECTION, Frame
from vsense.cameras.camera import Camera
from vsense.tracking.detector import Workers

CAMERAS = {f"c{n}": Camera.looking_down(f"c{n}", n, 0.0, 2.0, 100.0, (8, 6)) for n in range(5)}
FRAMES = [Frame(id, np.full((6, 8), n, np.uint8), 0, 0, 0) for n, id in enumerate(CAMERAS)]
PATIENCE_S = 20.0


class Meeting:
    """A detector whose threads wait for each other, and which notes where it ran."""

    def __init__(self, barrier: threading.Barrier, places: list[set[int]]) -> None:
        self._barrier, self._places = barrier, places
        self.overflows = 0

    def detect(self, image: np.ndarray, camera: Camera) -> np.ndarray:
        """Reports one marker, whose tag is the picture's grey."""
        if image[0, 0] < self._barrier.parties:
            self._barrier.wait(PATIENCE_S)
            self._places.append(os.sched_getaffinity(0))
        self.overflows += int(image[0, 0] == 3)
        rows = np.zeros(1, dtype=DETECTION)
        rows["tag"] = image[0, 0]
        return rows


@pytest.mark.parametrize("number", [1, 2, 3])
def test_pictures_are_looked_at_side_by_side_and_given_back_in_order(number: int) -> None:
    barrier, places = threading.Barrier(number), []
    workers = Workers(lambda: Meeting(barrier, places), number, pin=False)
    looks = workers.detect(FRAMES, CAMERAS)
    workers.close()
    assert [int(look.rows["tag"][0]) for look in looks] == [0, 1, 2, 3, 4]
    assert [look.full for look in looks] == [False, False, False, True, False]
    assert not barrier.broken and len(places) == number


def test_pinned_threads_have_a_processor_each() -> None:
    allowed = os.sched_getaffinity(0)
    number = min(2, len(allowed))
    barrier, places = threading.Barrier(number), []
    workers = Workers(lambda: Meeting(barrier, places), number, pin=True)
    workers.detect(FRAMES, CAMERAS)
    workers.close()
    assert all(len(place) == 1 and place <= allowed for place in places)
    assert len(set().union(*places)) == number
    assert os.sched_getaffinity(0) == allowed, "the caller stays where it was"


def test_no_pictures_are_no_looks() -> None:
    workers = Workers(lambda: Meeting(threading.Barrier(1), []), 2, pin=False)
    assert workers.detect([], CAMERAS) == []
    workers.close()
