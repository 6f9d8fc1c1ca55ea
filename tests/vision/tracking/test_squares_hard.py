"""Square markers in hard pictures: how many are named, and that none is named wrong.

`BEFORE` is how many of 20 the detector named that was here before the kernel looked for squares, in
exactly these pictures; it took ten times as long.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tests.vision.tracking.hard_sets import FOCAL_PX, LENS, square_crowd, square_family
from tests.vision.tracking.synthetic import HARD, HEIGHT_M, Look, Robot, render
from vsense.base.arena import UNNAMED
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking._detector import make_detector
from vsense.vision.tracking._workers import Picture, Workers

FAMILIES = ("aruco_4x4_50", "apriltag_36h11")
LOOKS = {
    "blurred": (Look(psf_px=2.0), FOCAL_PX),
    "noisy": (Look(noise=12.0), FOCAL_PX),
    "hard": (HARD, FOCAL_PX),
    "uneven": (Look(light=0.7, vignetting=0.5), FOCAL_PX),
    "small": (Look(), 0.59 * FOCAL_PX),
    "small and hard": (HARD, 0.59 * FOCAL_PX),
}
"""How hard, and the focal length: small cells are 2.2 px wide, or 3 px with fewer of them."""

BEFORE = {
    "blurred": (20, 19),
    "noisy": (20, 20),
    "hard": (20, 20),
    "uneven": (20, 20),
    "small": (20, 20),
    "small and hard": (18, 17),
    "veiled": (20, 20),
    "dark": (20, 20),
    "pale": (18, 19),
    "paler": (13, 12),
}
"""One of each family; in one blurred picture it gave a place that was off by more than a pixel."""
TONES = {
    "veiled": (0.5, 110.0, 2.0),
    "dark": (0.2, 2.0, 1.5),
    "pale": (0.2, 80.0, 2.0),
    "paler": (0.13, 100.0, 1.5),
}
"""Gain, offset and noise: black and white are 85, 34, 34 and 22 grey values apart."""


def shoot(name: str, look: Look, focal_px: float) -> tuple[Camera, list[Robot], np.ndarray]:
    """Draws a picture of 20 robots."""
    camera = Camera.looking_down("c", 0.0, 0.0, 2.43, focal_px, (1000, 760), LENS)
    robots = square_crowd(square_family(name), camera)
    return camera, robots, render(camera, square_family(name), robots, look, 3)


def check(name: str, camera: Camera, robots: list[Robot], image: np.ndarray, rms_px: float) -> int:
    """Returns how many are named; nothing is named that is not there."""
    family = square_family(name)
    found = make_detector(family, range(family.tags), HEIGHT_M).detect(image, camera)
    truth = {robot.tag: robot for robot in robots}
    named = found[found["tag"] != UNNAMED]
    assert set(named["tag"].tolist()) <= set(truth)
    places = np.array([(truth[tag].x_m, truth[tag].y_m, HEIGHT_M) for tag in named["tag"].tolist()])
    seen = np.stack((named["x_px"], named["y_px"]), axis=1)
    off = np.hypot(*(seen - camera.project(places)).T)
    assert off.max() < 1.0 and np.sqrt(np.mean(off**2)) < rms_px
    return len(named)


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("look", LOOKS)
def test_hard_pictures_cost_no_more_names_than_before(name: str, look: str) -> None:
    camera, robots, image = shoot(name, *LOOKS[look])
    assert check(name, camera, robots, image, 0.2) >= BEFORE[look][FAMILIES.index(name)]


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("tone", TONES)
def test_weak_contrast_costs_nothing(name: str, tone: str) -> None:
    gain, offset, noise = TONES[tone]
    camera, robots, image = shoot(name, Look(), FOCAL_PX)
    weak = gain * image + offset + np.random.default_rng(5).normal(0.0, noise, image.shape)
    image = np.clip(np.rint(weak), 0, 255).astype(np.uint8)
    named = check(name, camera, robots, image, 0.1)
    assert named == 20 >= BEFORE[tone][FAMILIES.index(name)]


@pytest.mark.parametrize(("name", "least"), [("aruco_4x4_50", 16), ("apriltag_36h11", 19)])
def test_names_in_a_glare(name: str, least: int) -> None:
    """A spot of light on each disc, up to 110 grey values; before, 16 and 20 were named."""
    camera, robots, image = shoot(name, Look(), FOCAL_PX)
    glare = np.zeros(image.shape, dtype=np.float32)
    rng = np.random.default_rng(5)
    for robot in robots:
        spot = camera.project(np.array((robot.x_m, robot.y_m, HEIGHT_M))) + rng.uniform(-12, 12, 2)
        x, y = np.rint(spot).astype(int)
        glare[np.clip(y, 0, image.shape[0] - 1), np.clip(x, 0, image.shape[1] - 1)] += 1.0
    glare = cv2.GaussianBlur(glare, (0, 0), 8.0)
    shone = np.clip(image + 110.0 / glare.max() * glare, 0, 255).astype(np.uint8)
    assert check(name, camera, robots, shone, 0.1) >= least


def test_large_markers_are_as_precise_as_small_ones() -> None:
    camera = Camera.looking_down("c", 0.0, 0.0, 2.43, 5.0 * FOCAL_PX, (800, 600), LENS)
    robots = [Robot(3, -0.07, 0.0, 0.0), Robot(4, 0.0301, 0.0107, 1.6)]
    image = render(camera, square_family("aruco_4x4_50"), robots, Look(litter=0), 3)
    assert check("aruco_4x4_50", camera, robots, image, 0.15) == 2


def test_more_threads_change_not_a_bit() -> None:
    family = square_family("apriltag_36h11")
    rig = [
        Camera.looking_down(id, x, 0.0, 2.43, FOCAL_PX, (640, 480), LENS)
        for id, x in (("left", -0.2), ("right", 0.2))
    ]
    robots = [Robot(7 * k, 0.12 * k - 0.5, 0.1 * (k % 3) - 0.1, float(k), 0.12) for k in range(9)]
    pictures = [Picture(render(camera, family, robots, HARD, 1), camera) for camera in rig]
    tags = [robot.tag for robot in robots]
    seen = []
    for number in (1, 2, 3):
        workers = Workers(number)
        found = make_detector(family, tags, HEIGHT_M, workers=workers).detect_all(pictures)
        workers.close()
        seen.append([shot.rows.tobytes() for shot in found])
    assert all(seen[0]) and seen[0] == seen[1] == seen[2]
