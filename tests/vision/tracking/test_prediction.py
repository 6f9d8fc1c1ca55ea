"""What the tracker tells the detectors: where robots should be, and what is to be searched."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.arena import POSE, ArenaState
from vsense.vision.cameras._camera_array import CameraArray
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking._prediction import Prediction, SearchPlan

STEP_NS = 100_000_000
CAMERA = Camera.looking_down("a", 0.0, 0.0, 2.43, 1620.0, (1620, 1220))


def state(step: int, *robots: tuple[int, float, float, float], seen: bool = True) -> ArenaState:
    poses = np.zeros(len(robots), dtype=POSE)
    for row, (tag, x_m, y_m, yaw_rad) in zip(poses, robots, strict=True):
        row["tag"], row["x_m"], row["y_m"], row["yaw_rad"] = tag, x_m, y_m, yaw_rad
        row["capture_ns"], row["seen"] = step * STEP_NS, seen
    return ArenaState(step, step * STEP_NS, poses, len(poses))


@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.4, 0.4))
def test_a_robot_is_expected_to_go_on_as_it_moved(dx: float, dy: float, turn: float) -> None:
    known = Prediction()
    for step in range(2):
        known.expect(step * STEP_NS)
        known.learn(state(step, (7, dx * step, dy * step, turn * step)))
    known.expect(2 * STEP_NS)
    (row,) = known.expected
    assert row["tag"] == 7 and row["sure"]
    assert row["x_m"] == pytest.approx(2.0 * dx) and row["y_m"] == pytest.approx(2.0 * dy)
    assert row["yaw_rad"] == pytest.approx(2.0 * turn)


def test_one_sighting_is_not_enough_to_be_sure() -> None:
    known = Prediction()
    known.learn(state(0, (7, 0.0, 0.0, 0.0)))
    known.expect(STEP_NS)
    assert known.expected["tag"].tolist() == [7] and not known.expected["sure"].any()


def test_a_robot_that_is_not_seen_is_expected_for_a_while_and_then_not() -> None:
    known = Prediction()
    for step in range(3):
        known.learn(state(step, (7, 0.01 * step, 0.0, 0.0)))
    sure, there = [], []
    for step in range(3, 16):
        known.expect(step * STEP_NS)
        known.learn(state(step, (7, 0.02, 0.0, 0.0), seen=False))
        sure.append(bool(known.expected["sure"].any()))
        there.append(len(known.expected))
    assert sure == [True, True] + [False] * 11
    assert there == [1] * 9 + [0] * 4


def test_key_frames_come_every_so_often() -> None:
    known = Prediction(SearchPlan(key_frame_period=3))
    frames = []
    for step in range(7):
        known.expect(step * STEP_NS)
        frames.append(known.is_key_frame)
    assert frames == [True, False, False, True, False, False, True]


def test_squares_lie_around_the_robots_in_view() -> None:
    known = Prediction(SearchPlan(5, 0.11), {1: 0.06, 2: 0.06})
    known.learn(state(0, (1, 0.1, 0.0, 0.0), (2, 5.0, 0.0, 0.0)))
    known.expect(0)
    cameras = CameraArray([CAMERA])
    seen = known.in_view(cameras, 0.06)
    assert seen.values["tag"].tolist() == [1]
    squares = known.windows(cameras, 0.06, seen.places(), seen.picture)
    ((left, top, right, bottom),) = squares.tolist()
    middle = CAMERA.project(np.array([0.1, 0.0, 0.06]))
    assert ((left + right) / 2, (top + bottom) / 2) == pytest.approx(middle.tolist(), abs=1.0)
    assert right - left == pytest.approx(0.11 * 1620 / 2.37, abs=3.0) == bottom - top


def rotation(tilt: float) -> tuple[float, ...]:
    """Looks down, tilted about x: at 0.9 rad with the horizon in the picture."""
    c, s = math.cos(tilt), math.sin(tilt)
    turned = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ np.diag((1.0, -1.0, -1.0))
    return tuple(turned.ravel().tolist())


@given(st.integers(0, 2**32 - 1), st.floats(-0.9, 0.9), st.floats(-0.3, 0.1), st.integers(0, 30))
def test_in_view_is_whose_middle_lies_in_the_picture(
    seed: int, tilt: float, barrel: float, count: int
) -> None:
    rng = np.random.default_rng(seed)
    heights_m = dict(enumerate(rng.uniform(0.0, 0.3, count).tolist()))
    lens = (barrel, 0.0, 0.0, 0.0, 0.0)
    rig = [
        replace(CAMERA, id=id, position_m=(x, x, 2.4), distortion=lens, rotation=rotation(tilt))
        for id, x in (("a", -1.0), ("b", 0.4))
    ]
    known = Prediction(heights_m=heights_m)
    places = rng.uniform(-2.0, 2.0, (count, 2))
    known.learn(state(0, *[(tag, x, y, 0.0) for tag, (x, y) in enumerate(places.tolist())]))
    known.expect(0)
    seen = known.in_view(CameraArray(rig), 0.06)
    here = list(zip(seen.picture.tolist(), seen.values["tag"].tolist()))
    points = np.column_stack((places, list(heights_m.values())))
    for number, camera in enumerate(rig):
        x, y, z = np.reshape(camera.rotation, (3, 3)) @ (points - camera.position_m).T
        inside = camera.contains(camera.project(points)) & (z > 0.0)
        # Beyond its fold the lens's formula shows far places a second time.
        near = np.hypot(x / z, y / z) < 1.0
        expects = [(number, tag) for tag in np.flatnonzero(inside & near).tolist()]
        assert [one for one in here if one[0] == number and one in expects] == expects
        assert all(inside[tag] or z[tag] <= 0.0 for of, tag in here if of == number)
