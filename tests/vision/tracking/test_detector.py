"""The arrow detector on drawn pictures with exact truth."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.base.arena import UNNAMED, Frame, wrap_angle
from vsense.vision.cameras._camera_array import CameraArray
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import FamilyError, load_family
from vsense.vision.tracking._detector import make_detector
from vsense.vision.tracking.arena_tracker import ArenaTracker

ARROW = load_family("arrow4x4")
ROSTER = [31, 1843, 4334, 7167, 7488, 10084, 12689, 13103]
ROSTER += [16011, 16577, 18425, 29783, 34415, 39011, 40223, 52447]
LENS = (-0.12, 0.02, 0.0, 0.0, 0.0)
WIDE = Camera.looking_down("wide", 0.5, -0.3, 2.43, 1620.0, (1620, 1220), LENS)
SMALL = Camera.looking_down("small", 0.0, 0.0, 2.43, 1620.0, (480, 360), LENS)
DETECTOR = make_detector(ARROW, ROSTER, HEIGHT_M)


@pytest.fixture(autouse=True, scope="module")
def one_thread() -> None:
    cv2.setNumThreads(1)


def errors(found: np.ndarray, robots: list[Robot], camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Returns position [m] and heading [rad] errors of detections that name the robots."""
    by_tag = {int(row["tag"]): row for row in found if row["tag"] != UNNAMED}
    assert sorted(by_tag) == sorted(robot.tag for robot in robots)
    rows = np.array([by_tag[robot.tag] for robot in robots])
    ground = camera.to_plane(np.stack((rows["x_px"], rows["y_px"]), axis=-1), HEIGHT_M)
    truth = np.array([(robot.x_m, robot.y_m) for robot in robots])
    yaw = np.array([robot.yaw_rad for robot in robots])
    return np.hypot(*(ground - truth).T), np.abs(wrap_angle(rows["yaw_rad"] - yaw))


def crowd(seed: int) -> list[Robot]:
    """Returns 16 robots over the wide camera's picture; every second one touches another."""
    rng = np.random.default_rng(seed)
    spots: list[np.ndarray] = []
    while len(spots) < len(ROSTER):
        spot = rng.uniform((-1.05, -0.75), (1.05, 0.75))
        if len(spots) % 2:
            turn = rng.uniform(-np.pi, np.pi)
            spot = spots[-1] + 0.0701 * np.array([np.cos(turn), np.sin(turn)])
        if np.all(np.abs(spot) < (1.06, 0.77)) and all(
            np.hypot(*(spot - other)) > 0.07 for other in spots
        ):
            spots.append(spot)
    return [
        Robot(tag, spot[0] + 0.5, spot[1] - 0.3, rng.uniform(-np.pi, np.pi), 0.12)
        for tag, spot in zip(ROSTER, spots, strict=True)
    ]


@pytest.mark.parametrize("family", ["arrow4x4", "arrow4x4-thesis"])
def test_touching_robots_among_litter_are_all_named_and_measured(family: str) -> None:
    marker = load_family(family)
    robots = crowd(seed=4)
    picture = render(WIDE, marker, robots, seed=4)
    found = make_detector(marker, ROSTER, HEIGHT_M).detect(picture, WIDE)
    position, heading = errors(found, robots, WIDE)
    assert np.sqrt((position**2).mean()) < 2e-4 and position.max() < 5e-4
    assert np.sqrt((heading**2).mean()) < np.radians(0.3)


@pytest.mark.parametrize(
    "look",
    [
        Look(psf_px=1.2, noise=5.0, exposure_s=0.03, light=0.5),
        Look(black=60.0, white=150.0),
        Look(ground=30.0),
        Look(ground=200.0),
        Look(psf_px=0.0, noise=0.0, light=0.0, vignetting=0.0),
    ],
    ids=["blurred", "pale", "dark floor", "white floor", "ideal"],
)
def test_hard_light_costs_no_name(look: Look) -> None:
    robots = crowd(seed=5)
    found = DETECTOR.detect(render(WIDE, ARROW, robots, look, seed=5), WIDE)
    position, heading = errors(found, robots, WIDE)
    assert position.max() < 1e-3 and heading.max() < np.radians(1.5)


def test_every_heading_is_measured_also_along_the_pixels() -> None:
    spots = [(x, y) for x in (-0.2, 0.0, 0.2) for y in (-0.15, 0.15)]
    clean = Look(litter=0)
    for turn in np.arange(0.0, 360.0, 15.0):
        robots = [
            Robot(tag, x, y, float(wrap_angle(np.radians(turn + 180.0 * (k % 2)))))
            for k, (tag, (x, y)) in enumerate(zip(ROSTER, spots, strict=False))
        ]
        found = DETECTOR.detect(render(SMALL, ARROW, robots, clean, seed=int(turn)), SMALL)
        position, heading = errors(found, robots, SMALL)
        assert position.max() < 3e-4 and heading.max() < np.radians(0.7)


def test_litter_alone_is_no_robot() -> None:
    for seed in range(3):
        picture = render(WIDE, ARROW, [], Look(litter=60), seed=seed)
        assert len(DETECTOR.detect(picture, WIDE)) == 0


@pytest.mark.parametrize("shade", [0, 128, 255])
def test_an_even_picture_shows_nothing(shade: int) -> None:
    picture = np.full((360, 480), shade, np.uint8)
    assert len(DETECTOR.detect(picture, SMALL)) == 0


def test_a_tag_that_is_not_in_the_roster_is_seen_and_not_named() -> None:
    picture = render(SMALL, ARROW, [Robot(27525, 0.0, 0.1, 2.0)], Look(litter=0))
    assert DETECTOR.detect(picture, SMALL)["tag"].tolist() == [UNNAMED]


def test_both_markers_with_the_same_tag_are_reported() -> None:
    robots = [Robot(31, -0.1, 0.0, 0.0), Robot(31, 0.1, 0.05, 3.0)]
    found = DETECTOR.detect(render(SMALL, ARROW, robots, Look(litter=0)), SMALL)
    assert found["tag"].tolist() == [31, 31]


def test_a_marker_cut_by_the_border_is_not_reported() -> None:
    edge = SMALL.to_plane(np.array([479.0, 180.0]), HEIGHT_M)[0]
    for inside in np.arange(-0.03, 0.034, 0.008):
        robot = Robot(31, edge - inside, 0.0, 0.0)
        picture = render(SMALL, ARROW, [robot], Look(litter=0))
        assert len(DETECTOR.detect(picture, SMALL)) == 0
    robot = Robot(31, edge - 0.042, 0.0, 0.0)
    found = DETECTOR.detect(render(SMALL, ARROW, [robot], Look(litter=0)), SMALL)
    assert errors(found, [robot], SMALL)[0].max() < 3e-4


def test_detecting_twice_gives_the_same_bytes() -> None:
    picture = render(WIDE, ARROW, crowd(seed=6), seed=6)
    first = DETECTOR.detect(picture, WIDE)
    again = make_detector(ARROW, ROSTER[::-1], HEIGHT_M).detect(picture.copy(), WIDE)
    assert first.tobytes() == again.tobytes()


@pytest.mark.parametrize(("name", "last"), [("arrow4x4", 65535), ("apriltag_36h11", 586)])
@pytest.mark.parametrize("beyond", [1, 1 << 31, 1 << 63])
def test_a_tag_that_the_family_has_not_is_refused_however_large(
    name: str, last: int, beyond: int
) -> None:
    with pytest.raises(FamilyError, match=f"tag {last + beyond}: the family {name} has 0 to"):
        make_detector(load_family(name), [1, last + beyond], HEIGHT_M)


def test_a_camera_that_comes_and_goes_is_not_measured_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera with half the others' rate would else cost more than the pictures."""
    cameras = [
        Camera.looking_down(id, x, 0.0, 2.43, 1620.0, (400, 300))
        for id, x in (("a", 0.0), ("b", 5.0))
    ]
    family, measured = load_family("arrow4x4"), [0]
    for kind in (Camera, CameraArray):

        def spy(self: object, points_px: np.ndarray, *more: object, of: Any = kind.to_plane) -> Any:
            measured[0] += points_px.size // 2
            return of(self, points_px, *more)

        monkeypatch.setattr(kind, "to_plane", spy)
    tracker = ArenaTracker.for_family(cameras, family, {31: 0.071}, open_roster=False)
    picture = render(cameras[0], family, [Robot(31, 0.0, 0.0, 0.5)], Look(litter=0), 1, 0.071)
    each = []
    for step in range(8):
        measured[0] = 0
        frames = [Frame(camera.id, picture, step, step * 16_000_000, 0) for camera in cameras]
        assert tracker.update(frames[: 1 + step % 2]).robots["seen"].any()
        each.append(measured[0])
    tracker.close()
    assert all(0 < points <= 2 for points in each[4:])
