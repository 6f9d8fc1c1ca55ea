"""Drawn markers in real photographs: the arrow has no public pictures of its own."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from tests.vision.tracking import real
from tests.vision.tracking.composite import Character, character, compose, noise_of
from tests.vision.tracking.synthetic import HEIGHT_M, Robot
from vsense.base.arena import UNNAMED, wrap_angle
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._detector import make_detector

ARROW_TAGS = [31, 1843, 4334, 7167, 7488, 10084, 12689, 13103]
ARROW_TAGS += [16011, 16577, 18425, 29783, 34415, 39011, 40223, 52447]
ROSTERS = {
    "arrow4x4": ARROW_TAGS,
    "arrow4x4-thesis": ARROW_TAGS,
    "aruco_4x4_50": list(range(50)),
}
EACH, EVERY = 12, 3


def above(photo: np.ndarray) -> Camera:
    return Camera.looking_down("c", 0.0, 0.0, 2.43, 1620.0, photo.shape[::-1])


def scattered(camera: Camera, roster: list[int], seed: int) -> list[Robot]:
    """Returns robots all over the picture, wholly in it and apart from each other."""
    rng = np.random.default_rng(seed)
    columns = np.linspace(60, camera.width_px - 60, 5)
    rows = np.linspace(60, camera.height_px - 60, 4)
    places = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    places = rng.permutation(places)[:EACH] + rng.uniform(-15.0, 15.0, (EACH, 2))
    tags = rng.choice(roster, EACH, replace=False)
    ground = camera.to_plane(places, HEIGHT_M)
    return [
        Robot(int(tag), float(x), float(y), float(rng.uniform(-np.pi, np.pi)))
        for tag, (x, y) in zip(tags, ground, strict=True)
    ]


@pytest.mark.parametrize("name", ROSTERS)
def test_markers_laid_into_photographs_are_named_where_they_lie(name: str) -> None:
    family = load_family(name)
    detector = make_detector(family, ROSTERS[name], HEIGHT_M)
    total, found, off_m, off_rad = 0, 0, [], []
    for seed, (photo, _) in enumerate(islice(real.wall_photos(), 0, None, EVERY)):
        look = character(photo)
        if look is None:
            continue
        camera = above(photo)
        robots = scattered(camera, ROSTERS[name], seed)
        image = compose(photo, camera, family, robots, look, HEIGHT_M, seed)
        truth = {robot.tag: robot for robot in robots}
        rows = detector.detect(image, camera)
        rows = rows[rows["tag"] != UNNAMED]
        assert len(set(rows["tag"].tolist())) == len(rows)
        ground = camera.to_plane(np.stack((rows["x_px"], rows["y_px"]), axis=-1), HEIGHT_M)
        for row, (x, y) in zip(rows, ground, strict=True):
            robot = truth[int(row["tag"])]
            off_m.append(np.hypot(x - robot.x_m, y - robot.y_m))
            off_rad.append(abs(float(wrap_angle(row["yaw_rad"] - robot.yaw_rad))))
        total, found = total + len(robots), found + len(rows)
    assert total >= 10 * EACH and found >= 0.985 * total
    assert np.sqrt(np.mean(np.square(off_m))) < 2e-4 and max(off_m) < 2e-3
    assert np.degrees(np.sqrt(np.mean(np.square(off_rad)))) < 0.3


@pytest.mark.parametrize("name", ["arrow4x4", "arrow4x4-thesis"])
def test_real_photographs_without_arrows_have_none(name: str) -> None:
    detector = make_detector(load_family(name), ARROW_TAGS, HEIGHT_M)
    photos = [photo for photo, _ in real.wall_photos()]
    photos += [photo for _, photo, _ in real.swarm_photos()]
    photos.append(real.grey(real.DATA / "kilobots" / "swarm.png"))
    for photo in photos:
        for tag in detector.detect(photo, above(photo))["tag"]:
            assert tag == UNNAMED


def test_a_photographs_noise_and_blur_are_recovered() -> None:
    photo = np.full((300, 400), 150, np.uint8)
    family = load_family("apriltag_36h11")
    camera = above(photo)
    robots = [Robot(k, 0.15 * (k - 1), 0.0, 0.4 + k) for k in range(3)]
    given = Character(1.1, 0.0, 40.0, 200.0)
    image = compose(photo, camera, family, robots, given, HEIGHT_M, 0)
    read = character(image)
    assert read is not None
    assert read.psf_px == pytest.approx(1.1, abs=0.25)
    assert (read.black, read.white) == pytest.approx((40.0, 200.0), abs=15.0)
    noise = np.random.default_rng(0).normal(0.0, 4.0, image.shape)
    assert noise_of(np.clip(image + noise, 0, 255).astype(np.uint8)) == pytest.approx(4.0, abs=0.5)
