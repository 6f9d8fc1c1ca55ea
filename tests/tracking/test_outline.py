"""The outline's fit from disturbed starts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.tracking.camera import Camera
from vsense.tracking.families import load_family
from vsense.tracking.outline import Fits, OutlineFit, look, place

ARROW = load_family("arrow4x4")
LENS = (-0.12, 0.02, 0.0, 0.0, 0.0)
CORNER = Camera.looking_down("corner", -0.95, -0.65, 2.43, 1620.0, (1620, 1220), LENS)
TRUTH = Robot(18425, 0.0, 0.0, 0.7)
PICTURE = render(CORNER, ARROW, [TRUTH], Look(litter=0), seed=2)
FIT = OutlineFit(ARROW)


def start(x_m: float, y_m: float, yaw_rad: float, scale: float) -> Fits:
    none = np.zeros(1)
    return Fits(
        np.array([[x_m, y_m]]), np.array([yaw_rad]), np.array([scale]), none, none, none, none
    )


@given(
    st.floats(-0.002, 0.002),
    st.floats(-0.002, 0.002),
    st.floats(-0.15, 0.15),
    st.floats(0.95, 1.05),
)
@settings(max_examples=50)
def test_two_passes_reach_the_truth_in_the_picture_s_corner(
    x_m: float, y_m: float, turn_rad: float, scale: float
) -> None:
    fits = start(x_m, y_m, TRUTH.yaw_rad + turn_rad, scale)
    for reach_u, steps in ((1.0, 13), (0.6, 11)):
        fits = FIT.fit(PICTURE, CORNER, HEIGHT_M, fits, reach_u, steps)
    assert fits.centre_m[0] == pytest.approx((0.0, 0.0), abs=2e-4)
    assert fits.yaw_rad[0] == pytest.approx(TRUTH.yaw_rad, abs=0.01)
    assert fits.scale[0] == pytest.approx(1.0, abs=0.01)
    assert fits.coverage[0] > 0.95 and fits.residual_mm[0] < 0.2
    assert fits.white[0] - fits.black[0] > 80.0


def test_where_nothing_is_nothing_is_covered() -> None:
    fits = FIT.fit(PICTURE, CORNER, HEIGHT_M, start(-0.3, -0.3, 0.0, 1.0), 1.0, 13)
    assert fits.coverage[0] < 0.6 or fits.white[0] - fits.black[0] < 25.0


def test_points_are_placed_turned_and_shifted() -> None:
    fits = start(0.2, 0.1, np.pi / 2.0, 1.0)
    placed = place(np.array([[[0.01, 0.02]]]), fits, 0.06)
    assert placed[0, 0] == pytest.approx((0.18, 0.11, 0.06))
    assert len(fits.keep(np.array([False])).scale) == 0


def test_looking_interpolates_between_pixels() -> None:
    ramp = np.tile(np.arange(0, 200, 10, dtype=np.uint8), (20, 1))
    x_px = np.array([[[3.0, 3.5], [4.25, 4.75]]], dtype=np.float32)
    seen = look(ramp, x_px, np.full_like(x_px, 7.0))
    assert seen.shape == (1, 2, 2)
    assert seen[0] == pytest.approx(np.array([[30.0, 35.0], [42.5, 47.5]]), abs=0.6)
