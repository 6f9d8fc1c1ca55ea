"""The square detector on drawn pictures with exact truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.base.arena import UNNAMED, Frame, wrap_angle
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers._dictionary import SquareFamily
from vsense.vision.markers.families import FamilyError, load_family
from vsense.vision.tracking._detector import ArrowDetector, SquareDetector, make_detector
from vsense.vision.tracking._squares_edges import Sides
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.squares import SQUARE, SquareFinder, _distinct

ARUCO = load_family("aruco_4x4_50")
TAG36 = load_family("apriltag_36h11")
ASKEW = replace(TAG36, heading_deg=137.0, centre_mm=(2.0, -1.5))
CAMERA = Camera.looking_down("c", 0.2, -0.1, 2.43, 1620.0, (810, 610), (-0.12, 0.02, 0.0, 0.0, 0.0))
HARD = Look(psf_px=1.2, noise=5.0, exposure_s=0.03, light=0.6)


def crowd(family: SquareFamily, seed: int, speed_m_s: float = 0.0) -> list[Robot]:
    """Returns twelve robots that touch nobody, with tags of their own."""
    rng = np.random.default_rng(seed)
    tags = rng.choice(family.tags, 12, replace=False)
    places = [(x, y) for x in (-0.45, -0.22, 0.0, 0.22, 0.45) for y in (-0.3, -0.1, 0.1, 0.3)]
    chosen = rng.choice(len(places), 12, replace=False)
    return [
        Robot(
            int(tag),
            0.2 + places[k][0] + rng.uniform(-0.03, 0.03),
            -0.1 + places[k][1] + rng.uniform(-0.03, 0.03),
            float(rng.uniform(-np.pi, np.pi)),
            speed_m_s,
        )
        for tag, k in zip(tags, chosen, strict=True)
    ]


@pytest.mark.parametrize("family", [ARUCO, TAG36, ASKEW], ids=["aruco", "apriltag", "askew"])
@pytest.mark.parametrize(
    ("look", "speed", "place_m", "turn_rad"),
    [(Look(), 0.0, 0.0002, 0.003), (HARD, 0.12, 0.001, 0.04)],
    ids=["plain", "hard"],
)
def test_every_robot_is_found_where_it_is(
    family: SquareFamily, look: Look, speed: float, place_m: float, turn_rad: float
) -> None:
    for seed in range(2):
        robots = crowd(family, seed, speed)
        image = render(CAMERA, family, robots, look, seed)
        detector = make_detector(family, [robot.tag for robot in robots], HEIGHT_M)
        found = detector.detect(image, CAMERA)
        rows = {int(row["tag"]): row for row in found}
        assert sorted(rows) == sorted(robot.tag for robot in robots) and len(found) == 12
        for robot in robots:
            row = rows[robot.tag]
            place = CAMERA.to_plane(np.array([row["x_px"], row["y_px"]]), HEIGHT_M)
            assert np.hypot(*(place - (robot.x_m, robot.y_m))) < place_m
            assert abs(wrap_angle(row["yaw_rad"] - robot.yaw_rad)) < turn_rad
            assert row["covariance"].trace() < 0.01 and row["margin"] > 1.25


def test_a_tag_off_the_roster_has_no_name_and_twins_are_both_reported() -> None:
    robots = [Robot(7, 0.0, 0.0, 0.3), Robot(7, 0.3, 0.0, 2.0), Robot(9, 0.0, -0.2, -1.0)]
    image = render(CAMERA, ARUCO, robots, seed=4)
    found = make_detector(ARUCO, [7], HEIGHT_M).detect(image, CAMERA)
    assert sorted(found["tag"].tolist()) == [UNNAMED, 7, 7]
    assert SquareFinder(ARUCO.codes).find(image)["tag"].tolist() == [7, 7, 9]


def test_the_corners_are_those_of_the_upright_marker() -> None:
    robot = Robot(31, 0.1, -0.2, 0.7)
    image = render(CAMERA, ASKEW, [robot], seed=2)
    row = SquareFinder(ASKEW.codes).find(image)[0]
    half, turn = 0.0225, robot.yaw_rad - np.radians(137.0)
    up, right = np.array([np.cos(turn), np.sin(turn)]), np.array([np.sin(turn), -np.cos(turn)])
    c, s = np.cos(robot.yaw_rad), np.sin(robot.yaw_rad)
    middle = np.array([robot.x_m - 0.002 * c - 0.0015 * s, robot.y_m - 0.002 * s + 0.0015 * c])
    corners = [
        middle + half * (a * up + b * right) for a, b in ((1, -1), (1, 1), (-1, 1), (-1, -1))
    ]
    truth = CAMERA.project(np.column_stack((corners, np.full(4, HEIGHT_M))))
    assert np.abs(row["corners_px"] - truth).max() < 0.1


def test_a_marker_of_another_size_is_none_of_ours() -> None:
    image = render(CAMERA, ARUCO, [Robot(7, 0.1, -0.2, 0.3)], seed=4)
    small = replace(ARUCO, size_mm=20.0)
    assert len(make_detector(small, [7], HEIGHT_M).detect(image, CAMERA)) == 0


@pytest.mark.parametrize("shade", [0, 128, 255])
def test_an_empty_picture_has_no_markers(shade: int) -> None:
    image = np.full((60, 80), shade, dtype=np.uint8)
    assert SquareFinder(ARUCO.codes).find(image).dtype == SQUARE
    assert len(SquareFinder(ARUCO.codes).find(image)) == 0
    assert len(make_detector(ARUCO, [7], 0.0).detect(image, CAMERA)) == 0


def test_mere_noise_has_no_markers() -> None:
    rng = np.random.default_rng(8)
    noise = rng.integers(0, 256, (240, 320)).astype(np.uint8)
    for family in (ARUCO, TAG36):
        assert len(SquareFinder(family.codes).find(noise)) == 0


def test_a_tag_that_the_family_does_not_have_is_refused() -> None:
    with pytest.raises(FamilyError, match=r"tag 50:.*aruco_4x4_50.*0 to 49"):
        make_detector(ARUCO, [3, 50], HEIGHT_M)


def test_the_family_chooses_the_detector() -> None:
    assert isinstance(make_detector(load_family("arrow4x4"), [31], HEIGHT_M), ArrowDetector)
    assert isinstance(make_detector(TAG36, [31], HEIGHT_M), SquareDetector)


def test_the_arena_tracker_follows_square_markers() -> None:
    robots = crowd(TAG36, 5)
    heights = {robot.tag: HEIGHT_M for robot in robots}
    arena = ArenaTracker.for_family([CAMERA], TAG36, heights)
    image = render(CAMERA, TAG36, robots, seed=5)
    state = arena.update([Frame("c", image, 0, 0, 0)])
    arena.close()
    assert state.detected == 12 and state.unnamed == 0 and state.duplicates == ()
    assert state.robots["tag"].tolist() == sorted(heights)


def test_two_markers_with_one_number_are_flagged_and_neither_is_followed() -> None:
    robots = [Robot(7, 0.0, 0.0, 0.3), Robot(7, 0.3, 0.0, 2.0), Robot(9, 0.0, -0.2, -1.0)]
    arena = ArenaTracker.for_family([CAMERA], ARUCO, {7: HEIGHT_M, 9: HEIGHT_M})
    state = arena.update([Frame("c", render(CAMERA, ARUCO, robots, seed=4), 0, 0, 0)])
    arena.close()
    assert state.duplicates == (7,) and state.detected == 2
    assert state.robots["tag"].tolist() == [9]


def test_of_fits_at_one_place_the_best_is_left_whatever_their_order() -> None:
    square = 20.0 * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    shifts = [(0.0, 0.0), (100.0, 0.0), (0.4, 0.3), (-0.4, 0.0), (0.0, 50.0)]
    residuals = [0.3, 0.3, 0.1, 0.2, 0.4]
    for order in (range(5), range(4, -1, -1), (2, 0, 4, 1, 3)):
        corners = np.array([square + shifts[k] for k in order])
        left = np.array([[residuals[k]] * 4 for k in order])
        sides = Sides(corners, *(np.ones((5, 4)) for _ in range(3)), left, np.ones((5, 4)))
        assert sorted(order[k] for k in _distinct(sides)) == [1, 2, 4]
    larger = np.array([square, 1.2 * square - 2.0])
    sides = Sides(larger, *(np.ones((2, 4)) for _ in range(5)))
    assert _distinct(sides).tolist() == [0, 1], "one in the other is another one"
