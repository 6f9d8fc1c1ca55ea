"""Quadrilaterals: their proposal and their precise corners, on drawn ones."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.vision.tracking._squares_edges import fit_local_corners, fit_sides, sample_grey
from vsense.vision.tracking.squares import area, find_quads, lengths, noise_level

FINE = 16


def drawn(quad: np.ndarray, blur_px: float) -> np.ndarray:
    """Returns a dark quadrilateral on light, 160 x 160 px."""
    fine = np.full((160 * FINE, 160 * FINE), 200, np.uint8)
    corners = np.rint((quad + 0.5) * FINE - 0.5).astype(np.int32)
    cv2.fillConvexPoly(fine, corners, 40)
    image = cv2.resize(fine, (160, 160), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(image, (0, 0), blur_px)


def some_quad(seed: int, side: float = 60.0) -> np.ndarray:
    """Returns a clockwise quadrilateral, turned and a little askew."""
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0.0, 2.0 * np.pi) + np.arange(4) * np.pi / 2.0
    ring = 80.0 + side * np.sqrt(0.5) * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    return ring + rng.uniform(-5.0, 5.0, (4, 2))


def distance(found: np.ndarray, quad: np.ndarray) -> np.ndarray:
    """Returns how far (n, 4, 2) quadrilaterals' corners are from the nearest of one's, at most."""
    return np.abs(found[:, :, np.newaxis] - quad).max(axis=-1).min(axis=-1).max(axis=1)


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 1.5))
@settings(max_examples=25)
def test_a_quadrilateral_is_proposed_and_fitted_to_its_edges(seed: int, blur_px: float) -> None:
    quad = some_quad(seed)
    image = drawn(quad, blur_px)
    proposed = find_quads(image, 10.0, 160.0)
    assert (area(proposed) > 0.0).all()
    near = proposed[distance(proposed, quad) < 3.0]
    assert len(near)
    first = fit_sides(image, near[:1], np.full((1, 4), 4.0), 12, 13)
    sides = fit_sides(image, first.corners_px, np.full((1, 4), 4.0), 20, 13)
    assert distance(sides.corners_px, quad)[0] < 0.1 + 0.15 * blur_px
    assert (sides.contrast > 110.0).all() and (sides.contrast < 170.0).all()
    assert (sides.coverage > 0.9).all() and (sides.step > 100.0).all()
    assert np.median(sides.blur_px) == pytest.approx(blur_px, abs=0.35)


def test_large_quadrilaterals_are_proposed_from_half_the_picture() -> None:
    quad = some_quad(3)
    proposed = find_quads(drawn(quad, 0.7), 40.0, 90.0)
    assert distance(proposed, quad).min() < 4.0


@pytest.mark.parametrize("side", [40.0, 110.0])
def test_local_corners_stay_close(side: float) -> None:
    quad = some_quad(5, side)
    moved = fit_local_corners(drawn(quad, 0.7), (quad + 0.4)[np.newaxis])[0]
    assert np.abs(moved - quad).max() < 0.4


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=12)
def test_corners_of_bent_paper_are_where_its_bent_sides_meet(seed: int) -> None:
    quad, sag_px = some_quad(seed, 50.0), 0.9
    way = np.linspace(0.0, 1.0, 30, endpoint=False)[:, np.newaxis]
    side = np.roll(quad, -1, axis=0) - quad
    outwards = (
        np.stack((side[:, 1], -side[:, 0]), axis=1) / np.linalg.norm(side, axis=1)[:, np.newaxis]
    )
    outline = np.concatenate(
        [
            q + way * s + 4.0 * sag_px * way * (1.0 - way) * n
            for q, s, n in zip(quad, side, outwards)
        ]
    )
    image = drawn(outline, 0.7)
    straight = fit_sides(image, quad[np.newaxis], np.full((1, 4), 4.0), 20, 13).corners_px
    bent = fit_local_corners(image, straight)
    assert distance(straight, quad)[0] > 0.4
    assert distance(bent, quad)[0] < 0.35


def test_more_points_are_sampled_than_opencv_takes_at_once() -> None:
    ramp = np.tile(np.arange(200, dtype=np.uint8), (4, 1))
    places = np.linspace(0.0, 199.0, 40_000)
    grey = sample_grey(ramp, np.stack((places, np.full_like(places, 1.5)), axis=1)[:, np.newaxis])
    assert grey.shape == (40_000, 1)
    assert grey[:, 0] == pytest.approx(places, abs=0.51)


def test_the_order_of_corners_gives_the_sign_of_the_area() -> None:
    square = np.array([[[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 2.0]]])
    assert area(square).tolist() == [6.0] and area(square[:, ::-1]).tolist() == [-6.0]
    assert lengths(square).tolist() == [[3.0, 2.0, 3.0, 2.0]]


@pytest.mark.parametrize("sigma", [4.0, 15.0])
def test_noise_is_measured(sigma: float) -> None:
    ramp = np.linspace(60.0, 180.0, 400) + np.zeros((300, 1))
    noisy = ramp + np.random.default_rng(0).normal(0.0, sigma, ramp.shape)
    level = noise_level(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    assert level == pytest.approx(sigma, rel=0.1)
    assert noise_level(np.zeros((2, 2), np.uint8)) == 0.0
