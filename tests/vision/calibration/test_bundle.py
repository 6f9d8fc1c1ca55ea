"""The bundle finds the truth, leaves alone what is fixed, and knows how sure it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vision.calibration.ideal import BOARD, CAMERAS, PLAN, shoot
from vsense.vision.calibration._bundle import (
    CAMERA_SIZE,
    POSE_SIZE,
    Bundle,
    Estimate,
    Knowledge,
    lens_of,
)
from vsense.vision.calibration._solution import assemble
from vsense.vision.calibration.frame import turn

NAMES = [camera.id for camera in CAMERAS]
WIDE_PX = 1e3


def truth() -> Estimate:
    turns = np.array([np.reshape(camera.rotation, (3, 3)) for camera in CAMERAS])
    places = np.array([camera.position_m for camera in CAMERAS])
    return Estimate(
        np.array([lens_of(camera) for camera in CAMERAS]),
        turns,
        -np.einsum("cij,cj->ci", turns, places),
        np.array([pose.turn for _, pose in PLAN]),
        np.array([pose.shift for _, pose in PLAN]),
    )


def bundle(sigma_px: float, lenses_free: bool, limit_px: float = WIDE_PX, seed: int = 1) -> Bundle:
    views = shoot(PLAN, sigma_px=sigma_px, seed=seed).views
    points = [BOARD.points_m[view.ids] for view in views]
    seen = assemble(views, points, NAMES, [moment for moment, _ in PLAN])
    camera_free = np.ones((len(NAMES), CAMERA_SIZE), dtype=bool)
    camera_free[:, POSE_SIZE:] = lenses_free
    body_free = np.ones((len(PLAN), POSE_SIZE), dtype=bool)
    body_free[0] = False
    nothing = np.zeros((len(NAMES), 9))
    shift = np.zeros((len(PLAN), 3))
    return Bundle(seen, Knowledge(camera_free, body_free, nothing, nothing, shift, shift), limit_px)


def shaken(estimate: Estimate, seed: int, size: float) -> Estimate:
    """Everything but body 0 and the lenses moved and turned."""
    rng = np.random.default_rng(seed)
    cameras, bodies = len(estimate.camera_turn), len(estimate.body_turn)
    still = np.ones((bodies, 1))
    still[0] = 0.0
    return replace(
        estimate,
        camera_turn=turn(rng.normal(0, size, (cameras, 3))) @ estimate.camera_turn,
        camera_shift=estimate.camera_shift + rng.normal(0, size, (cameras, 3)),
        body_turn=turn(rng.normal(0, size, (bodies, 3)) * still) @ estimate.body_turn,
        body_shift=estimate.body_shift + rng.normal(0, size, (bodies, 3)) * still,
    )


@settings(max_examples=4)
@given(st.integers(0, 2**31))
def test_truth_is_found_from_nearby(seed: int) -> None:
    exact = bundle(0.0, lenses_free=True)
    found = exact.solve(shaken(truth(), seed, 0.03))
    assert np.abs(exact.residuals(found)).max() < 1e-6
    np.testing.assert_allclose(found.camera_shift, truth().camera_shift, atol=1e-7)
    np.testing.assert_allclose(found.lenses, truth().lenses, rtol=1e-6, atol=1e-6)


@settings(max_examples=5)
@given(st.integers(0, 2**31))
def test_solving_never_makes_it_worse_and_moves_only_what_is_free(seed: int) -> None:
    noisy = bundle(0.3, lenses_free=False, limit_px=0.5)
    start = shaken(truth(), seed, 0.05)
    found = noisy.solve(start)
    assert noisy.cost(found) <= noisy.cost(start)
    np.testing.assert_array_equal(found.lenses, start.lenses)
    np.testing.assert_array_equal(found.body_turn[0], start.body_turn[0])
    np.testing.assert_array_equal(found.body_shift[0], start.body_shift[0])


def test_one_wild_corner_does_little_harm() -> None:
    clean = bundle(0.04, lenses_free=False, limit_px=0.15)
    views = clean.sightings
    pixels = views.pixels.copy()
    pixels[10] += (40.0, -25.0)
    wild = Bundle(replace(views, pixels=pixels), clean._prior, 0.15)
    apart = clean.solve(truth()).camera_shift - wild.solve(truth()).camera_shift
    assert np.abs(apart).max() < 1e-3


def test_covariance_is_the_spread_of_many_calibrations() -> None:
    sigma_px, runs = 0.05, 24
    found = [bundle(sigma_px, False, seed=seed).solve(truth()) for seed in range(runs)]
    spread = np.std([estimate.camera_shift for estimate in found], axis=0)
    covariance = bundle(0.0, False).covariance(truth()) * sigma_px**2
    # A camera is turned about its own centre of coordinates first, then shifted.
    by_turn = [np.cross(np.eye(3), shift) for shift in truth().camera_shift]
    by_pose = np.concatenate((np.transpose(by_turn, (0, 2, 1)), np.tile(np.eye(3), (4, 1, 1))), 2)
    pose = covariance[:, :POSE_SIZE, :POSE_SIZE]
    told = np.sqrt(np.einsum("cij,cjk,cik->ci", by_pose, pose, by_pose))
    # 24 runs tell a standard deviation to 15 %.
    ratio = spread / told
    assert 0.7 < np.median(ratio) < 1.3
    assert ratio.min() > 0.4 and ratio.max() < 1.9


def test_knowledge_pulls_as_strongly_as_it_is_sure() -> None:
    plain = bundle(0.0, lenses_free=True)
    mean = truth().lenses + np.array([30.0, 30.0, 0, 0, 0, 0, 0, 0, 0])
    sure = np.full(mean.shape, 1e12)
    held = Bundle(plain.sightings, replace(plain._prior, lens_mean=mean, lens_weight=sure), WIDE_PX)
    assert held.solve(truth()).lenses == pytest.approx(mean, abs=1e-3)
    vague = replace(plain._prior, lens_mean=mean, lens_weight=sure * 1e-20)
    loose = Bundle(plain.sightings, vague, WIDE_PX)
    assert loose.solve(truth()).lenses == pytest.approx(truth().lenses, abs=1e-2)
