"""Markers are found and read before anything is calibrated, and tell the picture's scale."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tools.camera_setup.stage import CALIBRATION, PX_PER_M, TAGS, arena
from tests.vision.tracking.synthetic import Look, Robot, render
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.marker_finder import MarkerFinder


def test_markers_are_read_and_tell_the_scale() -> None:
    finder = MarkerFinder(load_family("arrow4x4"))
    found = finder.find(arena())
    assert found.tags == TAGS and found.count == len(TAGS)
    assert finder.px_per_m == pytest.approx(PX_PER_M, rel=0.06)


def test_where_they_are_is_where_they_were_drawn() -> None:
    poses = MarkerFinder(load_family("arrow4x4")).find(arena()).poses()
    assert poses["tag"].tolist() == list(TAGS)
    points = np.array(
        [(-0.25, -0.15, 0.06), (0.2, -0.2, 0.06), (-0.2, 0.2, 0.06), (0.25, 0.1, 0.06)]
    )
    at_px = np.stack((poses["x_px"], poses["y_px"]), axis=-1)
    assert np.abs(at_px - CALIBRATION.project(points)).max() < 0.5
    turned = np.angle(np.exp(1j * (poses["yaw_px_rad"] - np.arange(4))))
    assert np.abs(turned).max() < 0.05


@pytest.mark.parametrize("px_per_m", [450.0, 900.0, 1500.0])
def test_any_size_is_found(px_per_m: float) -> None:
    camera = Camera.looking_down("c", 0, 0, 2.06, 2.0 * px_per_m, (640, 480))
    image = render(camera, load_family("arrow4x4"), [Robot(31, 0.02, 0.01, 1.0)], seed=3)
    finder = MarkerFinder(load_family("arrow4x4"))
    assert finder.find(image).tags == (31,)
    assert finder.px_per_m == pytest.approx(px_per_m, rel=0.08)


def test_square_markers_are_found_too() -> None:
    family = load_family("aruco_4x4_50")
    image = render(CALIBRATION, family, [Robot(7, 0.1, 0.1, 1.0), Robot(9, -0.1, 0.0, 2.0)], seed=3)
    finder = MarkerFinder(family)
    assert finder.find(image).tags == (7, 9)
    assert finder.px_per_m == pytest.approx(PX_PER_M, rel=0.15)


def test_a_calibrated_camera_needs_no_search() -> None:
    finder = MarkerFinder(load_family("arrow4x4"), CALIBRATION, 0.06)
    assert finder.find(arena()).tags == TAGS
    assert finder.px_per_m is None


def test_no_markers_tell_nothing_and_are_not_sought_in_every_picture() -> None:
    empty = render(CALIBRATION, load_family("arrow4x4"), [], Look(litter=0), seed=3)
    finder = MarkerFinder(load_family("arrow4x4"))
    assert finder.find(empty).count == 0 and finder.px_per_m is None
    assert finder.find(arena()).count == 0, "it has just searched in vain"
    assert any(finder.find(arena()).tags == TAGS for _ in range(20))


def test_a_tiny_picture_holds_no_marker() -> None:
    found = MarkerFinder(load_family("arrow4x4")).find(np.zeros((8, 8), np.uint8))
    assert found.count == 0 and len(found.poses()) == 0
