"""The lens model's derivatives are those of the model, and rotations rotate."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.vision.calibration.ideal import CAMERAS
from vsense.vision.calibration._bundle import camera_of, lens_of, project, undistorted
from vsense.vision.calibration.frame import turn

seeds = st.integers(0, 2**32 - 1)


def lens_and_points(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A random lens for each of five random points in front of it."""
    rng = np.random.default_rng(seed)
    lens = np.array([900.0, 880.0, 640.0, 360.0, -0.1, 0.02, 1e-3, -1e-3, 0.005])
    points = np.column_stack((rng.uniform(-0.6, 0.6, (5, 2)), rng.uniform(0.8, 2.0, 5)))
    return lens * rng.uniform(0.8, 1.2, (5, 9)), points


@given(seeds)
def test_derivative_by_the_point_is_the_slope(seed: int) -> None:
    lens, points = lens_and_points(seed)
    _, by_point, _ = project(lens, points)
    for axis in range(3):
        step = np.eye(3)[axis] * 1e-6
        slope = (project(lens, points + step)[0] - project(lens, points - step)[0]) / 2e-6
        np.testing.assert_allclose(by_point[:, :, axis], slope, rtol=1e-5, atol=1e-3)


@given(seeds)
def test_derivative_by_the_lens_is_the_slope(seed: int) -> None:
    lens, points = lens_and_points(seed)
    _, _, by_lens = project(lens, points)
    for number in range(9):
        step = np.eye(9)[number] * 1e-5
        slope = (project(lens + step, points)[0] - project(lens - step, points)[0]) / 2e-5
        np.testing.assert_allclose(by_lens[:, :, number], slope, rtol=1e-5, atol=1e-3)


@given(seeds)
def test_projection_is_the_cameras(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera = CAMERAS[0]
    middle = np.array((*camera.position_m[:2], 0.0))
    points = middle + rng.uniform((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0), (9, 3))
    matrix = np.reshape(camera.rotation, (3, 3))
    inside = (points - np.array(camera.position_m)) @ matrix.T
    pixels = project(np.tile(lens_of(camera), (9, 1)), inside)[0]
    np.testing.assert_allclose(pixels, camera.project(points), atol=1e-9)
    np.testing.assert_allclose(
        undistorted(lens_of(camera), pixels), inside[:, :2] / inside[:, 2:], atol=1e-8
    )


@given(seeds)
def test_turn_is_a_rotation_by_the_vectors_length(seed: int) -> None:
    vectors = np.random.default_rng(seed).normal(size=(4, 3))
    turns = turn(vectors)
    np.testing.assert_allclose(
        turns @ np.transpose(turns, (0, 2, 1)), np.tile(np.eye(3), (4, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.einsum("nij,nj->ni", turns, vectors), vectors, atol=1e-12)
    np.testing.assert_allclose(turn(-vectors), np.transpose(turns, (0, 2, 1)), atol=1e-12)
    angle = np.linalg.norm(vectors, axis=1)
    np.testing.assert_allclose(np.trace(turns, axis1=1, axis2=2), 1 + 2 * np.cos(angle), atol=1e-12)


def test_no_turn_is_the_identity() -> None:
    np.testing.assert_array_equal(turn(np.zeros((1, 3)))[0], np.eye(3))


def test_camera_survives_lens_and_back() -> None:
    for camera in CAMERAS:
        matrix = np.reshape(camera.rotation, (3, 3))
        shift = -matrix @ np.array(camera.position_m)
        again = camera_of(camera.id, (1620, 1220), lens_of(camera), matrix, shift)
        assert again.id == camera.id and again.width_px == 1620 and again.height_px == 1220
        np.testing.assert_allclose(again.position_m, camera.position_m, atol=1e-12)
        np.testing.assert_allclose(again.rotation, camera.rotation, atol=1e-12)
        np.testing.assert_array_equal(lens_of(again), lens_of(camera))
