"""The arena frame over the cameras: shifts between frames, and cameras carried over."""

from __future__ import annotations

import numpy as np
import pytest

from tests.vision.calibration.ideal import CAMERAS, arena_grid
from vsense.vision.calibration.frame import FrameShift

SHIFT = FrameShift(0.12, -0.05, np.radians(3.0))


def test_a_moved_camera_sees_the_moved_places_where_it_saw_them() -> None:
    points = arena_grid(0.5)
    moved = np.column_stack((SHIFT.apply(points[:, :2]), points[:, 2]))
    for camera in CAMERAS:
        # The outside: the same thing in the same pixel.
        assert SHIFT.moved(camera).project(moved) == pytest.approx(camera.project(points), abs=1e-6)


def test_the_shift_between_places_is_found() -> None:
    rng = np.random.default_rng(4)
    places = rng.uniform(-1.5, 1.5, (6, 2))
    found = FrameShift.between(places, SHIFT.apply(places))
    assert (found.x_m, found.y_m, found.yaw_rad) == pytest.approx(
        (SHIFT.x_m, SHIFT.y_m, SHIFT.yaw_rad), abs=1e-12
    )
    # In least squares: no shift near it does better with noise.
    wanted = SHIFT.apply(places) + rng.normal(0.0, 0.01, places.shape)
    best = FrameShift.between(places, wanted)
    error = np.sum((best.apply(places) - wanted) ** 2)
    for step in 1e-3 * np.vstack((np.eye(3), -np.eye(3))):
        near = FrameShift(best.x_m + step[0], best.y_m + step[1], best.yaw_rad + step[2])
        assert np.sum((near.apply(places) - wanted) ** 2) > error


def test_one_place_tells_no_turn() -> None:
    found = FrameShift.between(np.array([(1.0, 2.0)]), np.array([(1.5, 2.0)]))
    assert (found.x_m, found.y_m, found.yaw_rad) == (0.5, 0.0, 0.0)
