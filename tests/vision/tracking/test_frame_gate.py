"""Which pictures make a timestep, in whatever order they came."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.arena import Frame
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking.arena_tracker import FrameGate, TrackingError

CAMERAS = [Camera.looking_down(n, 0.0, 0.0, 2.0, 100.0, (8, 6)) for n in ("b", "a", "c")]
IMAGE = np.zeros((6, 8), np.uint8)

events = st.lists(
    st.tuples(st.sampled_from("abc"), st.integers(0, 6), st.integers(0, 3)), max_size=12
)


def frame(camera: str, timestep: int, late_ns: int = 0) -> Frame:
    return Frame(camera, IMAGE, timestep, 1000 * timestep + late_ns, 0)


@given(st.lists(events, max_size=5), st.randoms(use_true_random=False))
def test_order_changes_nothing_and_every_frame_is_passed_or_counted(
    calls: list[list[tuple[str, int, int]]], shuffle: random.Random
) -> None:
    straight, mixed = FrameGate(CAMERAS), FrameGate(CAMERAS)
    newest, came, passed = -1, 0, 0
    for call in calls:
        frames = [frame(*event) for event in call]
        chosen = straight.choose(frames)
        shuffle.shuffle(frames)
        again = mixed.choose(frames)
        outline = [(f.camera, f.timestep, f.capture_ns) for f in chosen]
        assert outline == [(f.camera, f.timestep, f.capture_ns) for f in again]
        assert [f.camera for f in chosen] == sorted({f.camera for f in chosen})
        assert len({f.timestep for f in chosen}) <= 1
        for one in chosen:
            assert one.timestep > newest
        newest = max([newest, *(f.timestep for f in chosen)])
        came, passed = came + len(frames), passed + len(chosen)
    assert straight.counters.old_frames + straight.counters.repeated_frames + passed == came
    assert straight.counters == mixed.counters


def test_of_a_camera_that_delivers_twice_the_later_picture_counts() -> None:
    gate = FrameGate(CAMERAS)
    (chosen,) = gate.choose([frame("a", 1, 5), frame("a", 1, 9), frame("a", 1, 2)])
    assert chosen.capture_ns == 1009 and gate.counters.repeated_frames == 2


def test_what_does_not_belong_to_the_arena_is_refused() -> None:
    with pytest.raises(TrackingError, match="'x'"):
        FrameGate(CAMERAS).choose([frame("x", 1)])
    with pytest.raises(TrackingError, match="each with an id of its own"):
        FrameGate(CAMERAS[:1] * 2)
