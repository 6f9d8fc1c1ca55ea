"""Cameras that look in at an angle: what is found, by the short axis of the discs in pictures."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.vision.tracking.synthetic import HEIGHT_M, INCLINED_PX, Look, Robot, inclined, render
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._kernel import Kernel

LOOK = Look(light=0.15, vignetting=0.2)
OPENCV = {"apriltag_36h11": "DICT_APRILTAG_36h11", "aruco_4x4_50": "DICT_4X4_50"}
FRONTAL = {"arrow4x4": 0.95, "apriltag_36h11": 0.85, "aruco_4x4_50": 0.98}
"""Shares that are found of 336 discs of 16 to 27 px below a camera that looks straight down."""


def short_axis_px(camera: Camera, x_m: float, y_m: float, disc_m: float) -> float:
    """Of the ellipse that a disc's picture is."""
    steps = np.array(
        [(x_m, y_m, HEIGHT_M), (x_m + 1e-3, y_m, HEIGHT_M), (x_m, y_m + 1e-3, HEIGHT_M)]
    )
    here, right, up = camera.project(steps)
    slopes = np.stack((right - here, up - here), axis=1) / 1e-3
    return float(disc_m * np.linalg.svd(slopes, compute_uv=False)[1])


def scatter(
    camera: Camera, tags: list[int], disc_m: float, rng: np.random.Generator
) -> list[Robot]:
    """Robots all over the picture, the far ones first."""
    robots: list[Robot] = []
    while len(robots) < len(tags):
        x, y = camera.to_plane(
            rng.uniform((60, 60), (INCLINED_PX[0] - 60, INCLINED_PX[1] - 60)), HEIGHT_M
        )
        apart = [(x - robot.x_m) ** 2 + (y - robot.y_m) ** 2 for robot in robots]
        if short_axis_px(camera, x, y, disc_m) >= 16.0 and min(apart, default=1.0) > 2 * disc_m**2:
            yaw = rng.uniform(-math.pi, math.pi)
            robots.append(Robot(tags[len(robots)], float(x), float(y), float(yaw)))
    return sorted(robots, key=lambda robot: robot.y_m)


def seen_by_opencv(name: str, image: NDArray[np.uint8]) -> set[int]:
    """Tags that OpenCV names in a picture."""
    if name not in OPENCV:
        return set()
    words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, OPENCV[name]))
    tags = cv2.aruco.ArucoDetector(words).detectMarkers(image)[1]
    return set() if tags is None else set(tags.ravel().tolist())


@pytest.mark.parametrize("name", FRONTAL)
@pytest.mark.parametrize(("lean_deg", "focal_px"), [(35, 1200.0), (50, 1500.0), (60, 1500.0)])
def test_what_is_large_enough_is_found_at_any_angle(
    name: str, lean_deg: int, focal_px: float
) -> None:
    family, camera = load_family(name), inclined(lean_deg, focal_px)
    kernel, disc_m = Kernel(family), 1e-3 * family.disc_diameter_mm
    rows: list[tuple[float, bool, bool]] = []
    for seed in range(5):
        robots = scatter(camera, list(range(1, 15)), disc_m, np.random.default_rng(seed))
        image = render(camera, family, robots, LOOK, seed)
        found, theirs = kernel.search(image, camera, HEIGHT_M), seen_by_opencv(name, image)
        for robot in robots:
            off_m = np.hypot(found["x_m"] - robot.x_m, found["y_m"] - robot.y_m)
            size_px = short_axis_px(camera, robot.x_m, robot.y_m, disc_m)
            rows.append((size_px, bool((off_m < 0.02).any()), robot.tag in theirs))
    size_px, ours, theirs_ = (np.array(column) for column in zip(*rows))
    small = size_px < 27.0
    assert small.sum() >= 15 and (~small).sum() >= 15
    assert ours[~small].all()
    # Of so few that a share of these differs by chance.
    assert ours[small].mean() >= FRONTAL[name] - 0.1
    assert ours[small].mean() >= theirs_[small].mean() - 0.05
    assert kernel.overflows == 0


def test_a_picture_with_the_horizon_in_it_is_searched() -> None:
    """The scale is 0 there, and noise has any size."""
    family, camera = load_family("arrow4x4"), inclined(60, 900.0)
    robots = [Robot(31, 0.0, 1.5, 0.3), Robot(18425, 0.3, 1.3, 2.0)]
    kernel = Kernel(family)
    found = kernel.search(render(camera, family, robots, LOOK), camera, HEIGHT_M)
    assert sorted(found["x_m"]) == pytest.approx([0.0, 0.3], abs=2e-3)
    assert kernel.overflows == 0
