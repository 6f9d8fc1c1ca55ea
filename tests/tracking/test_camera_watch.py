"""Cameras are looked after while their next pictures are awaited."""

from __future__ import annotations

import numpy as np

from vsense.arena import DETECTION, Frame
from vsense.cameras.camera import Camera
from vsense.cameras.grabber import REPEATS, CameraEvent, Troubles
from vsense.tracking.arena_tracker import ArenaTracker
from vsense.tracking.camera_watch import CameraWatch

CAMERA = Camera.looking_down("top", 0.0, 0.0, 2.4, 400.0, (320, 240))


class Blind:
    """A detector whose tables are always full."""

    overflows = 0

    def detect(self, image: np.ndarray, camera: Camera) -> np.ndarray:
        """Finds nothing."""
        self.overflows += 1
        return np.zeros(0, dtype=DETECTION)


def pictures(count: int, period_ns: int = 100_000_000) -> list[Frame]:
    rng = np.random.default_rng(2)
    return [
        Frame("top", rng.integers(90, 130, (240, 320)).astype(np.uint8), n, n * period_ns, 0)
        for n in range(count)
    ]


def watch_of(told: list[str]) -> tuple[CameraWatch, ArenaTracker]:
    tracker = ArenaTracker([CAMERA], Blind, {1: 0.06})
    return CameraWatch([CAMERA], tracker, told.append), tracker


def test_what_begins_is_told_at_the_next_look() -> None:
    told: list[str] = []
    watch, tracker = watch_of(told)
    watch.look()
    for frame in pictures(3):
        tracker.update([frame])
        watch.note([frame])
        assert told == []
        watch.look()
        watch.look()
    (line,) = told
    assert line == (
        "camera top: shows more dark things than the detector can hold: markers may be missed"
    )
    assert watch.troubles.counts == {("top", "crowded"): 1}
    assert tracker.counters.overflows == 3 and tracker.overflowed == ("top",)
    tracker.close()


def test_pictures_that_come_fast_are_not_all_looked_at() -> None:
    told: list[str] = []
    watch, tracker = watch_of(told)
    for frame in pictures(20, period_ns=10_000_000):
        tracker.update([frame])
        watch.note([frame])
        watch.look()
    assert told != []
    fast: list[str] = []
    watch, tracker = watch_of(fast)
    for frame in pictures(16, period_ns=10_000_000):
        tracker.update([frame])
        watch.note([frame])
        watch.look()
    assert fast == [], "two looks in 160 ms are too few to tell"
    tracker.close()


def test_the_same_trouble_is_told_a_few_times_and_then_counted() -> None:
    troubles = Troubles()
    event = CameraEvent("c7", "gone", "does not answer")
    lines = [line for _ in range(REPEATS + 2) for line in troubles.lines([event])]
    assert len(lines) == REPEATS and lines[0] == "camera c7: does not answer"
    assert lines[-1].endswith("(more of this is only counted)")
    assert troubles.lines([CameraEvent("c8", "gone", "does not answer")]) != []
    assert troubles.summary() == [f"camera c7: {REPEATS + 2} times gone"]


def test_every_setting_that_a_camera_refuses_is_told() -> None:
    troubles = Troubles()
    settings = [CameraEvent("c7", "control", f"has no Feature{n}") for n in range(REPEATS + 2)]
    assert troubles.lines(settings) == [str(event) for event in settings]
    assert troubles.summary() == []
