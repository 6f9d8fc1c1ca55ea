"""Camera health: every trouble that pictures show is noticed, and good pictures are none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.base.arena import DETECTION, UNNAMED, Frame
from vsense.vision.cameras._camera_array import CameraArray
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.health import (
    Agreement,
    CameraHealth,
    Health,
    Steadiness,
    marker_places,
)
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._detector import make_detector

SIZE = (810, 610)
CAMERA = Camera.looking_down("a", 0.0, 0.0, 2.4, 810.0, SIZE)


def arena(timestep: int, light: float = 1.0, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """A picture of a littered floor with robots that drive, with its own noise."""
    way = 0.012 * timestep
    robots = [Robot(k + 1, 0.2 * k - 0.8 + way, 0.15 * k - 0.6, 0.7) for k in range(8)]
    look = Look(noise=0.0)
    picture = render(CAMERA, load_family("arrow4x4"), robots, look, seed=3).astype(np.float32)
    moved = np.float32([[1, 0, shift[0]], [0, 1, shift[1]]])
    picture = cv2.warpAffine(picture, moved, SIZE, borderMode=cv2.BORDER_REFLECT)
    noise = np.random.default_rng(timestep).normal(0.0, 2.5, picture.shape)
    return np.clip(light * picture + noise, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def good() -> list[np.ndarray]:
    return [arena(k) for k in range(8)]


def kinds(camera: CameraHealth, pictures: list[np.ndarray]) -> list[tuple[int, str]]:
    """What is told, with the place of the picture that it is told at."""
    return [
        (place, event.kind)
        for place, image in enumerate(pictures)
        for event in [*camera.update(image), *camera.check_place(image)]
    ]


def test_good_pictures_of_driving_robots_are_no_event(good: list[np.ndarray]) -> None:
    assert kinds(CameraHealth(CAMERA), good) == []


@pytest.mark.parametrize("dark", ["black", "capped"])
def test_a_dark_camera_is_told_once_and_its_end_once(good: list[np.ndarray], dark: str) -> None:
    level = 4.0 if dark == "black" else 90.0
    nothing = [
        np.clip(np.random.default_rng(k).normal(level, 1.0, good[0].shape), 0, 255).astype(np.uint8)
        for k in range(6)
    ]
    told = kinds(CameraHealth(CAMERA), [*good[:2], *nothing, *good[2:6]])
    assert [t for t in told if t[1] in ("dark", "light")] == [(4, "dark"), (10, "light")]


def exposed(gain: float, ground: float, timestep: int = 0) -> np.ndarray:
    """A picture of 32 robots on a floor of this grey, `gain` times as long exposed."""
    robots = [Robot(k + 1, 0.24 * (k % 8) - 0.85, 0.3 * (k // 8) - 0.6, 0.7 + k) for k in range(32)]
    look = Look(noise=0.0, light=0.2, ground=ground)
    picture = gain * render(CAMERA, load_family("arrow4x4"), robots, look, seed=1)
    noise = np.random.default_rng(timestep).normal(0.0, 2.5, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def plain(grey: int, share: float = 1.0, rest: int = 100) -> np.ndarray:
    """A picture of one grey in its upper `share`, and of another below."""
    picture = np.full(SIZE[::-1], rest, np.uint8)
    picture[: round(share * SIZE[1])] = grey
    return picture


@pytest.mark.parametrize("gain", [3.5, 8.0, 30.0])
def test_a_saturated_camera_is_told_once_and_its_end_once(
    good: list[np.ndarray], gain: float
) -> None:
    white = [exposed(gain, 118.0, k) for k in range(6)]
    camera = CameraHealth(CAMERA)
    told = kinds(camera, [*good[:2], *white, *good[2:6]])
    assert told == [(4, "saturated"), (10, "exposed")]


def test_a_saturated_camera_is_told_with_how_much() -> None:
    camera = CameraHealth(CAMERA)
    told = [str(event) for _ in range(3) for event in camera.update(plain(255, 0.9))]
    assert told == ["camera a: is overexposed: 90 % of its picture is at full scale"]


@pytest.mark.parametrize(
    ("gain", "ground", "named", "kind"),
    [
        (1.0, 205.0, 32, None),
        (1.5, 205.0, 32, None),
        (3.0, 205.0, 19, "saturated"),
        (1.5, 118.0, 32, None),
        (2.0, 118.0, 31, None),
        (3.0, 118.0, 19, "saturated"),
        (3.25, 118.0, 11, "saturated"),
    ],
)
def test_saturated_is_where_markers_cannot_be_read(
    gain: float, ground: float, named: int, kind: str | None
) -> None:
    picture = exposed(gain, ground)
    rows = make_detector(load_family("arrow4x4"), range(1, 33), HEIGHT_M).detect(picture, CAMERA)
    assert np.count_nonzero(rows["tag"] != UNNAMED) == pytest.approx(named, abs=3)
    camera = CameraHealth(CAMERA)
    assert [e.kind for _ in range(3) for e in camera.update(picture)] == ([kind] if kind else [])


@pytest.mark.parametrize(
    ("picture", "kind"),
    [
        (plain(255), "saturated"),
        (plain(250), "saturated"),
        (plain(249), "dark"),
        (plain(128), "dark"),
        (plain(0), "dark"),
        (plain(255, 0.82), "saturated"),
        (plain(255, 0.82, rest=0), "saturated"),
        (plain(255, 0.75), None),
        (plain(240, 0.95), None),
        (plain(255, 0.06, rest=10), None),
        (plain(255, 0.02, rest=5), "dark"),
    ],
)
def test_too_much_light_too_little_and_enough(picture: np.ndarray, kind: str | None) -> None:
    camera = CameraHealth(CAMERA)
    noise = np.zeros_like(picture)
    told = []
    for k in range(3):
        # One pixel that differs: this is about light, not about standstill.
        noise[0, 0] = k % 2
        told += [event.kind for event in camera.update(picture ^ noise)]
    assert told == ([kind] if kind else [])


def test_paper_and_a_lamp_on_the_floor_are_no_trouble(good: list[np.ndarray]) -> None:
    pictures = [image.copy() for image in good]
    for image in pictures:
        image[60:360, 90:500] = 255
        cv2.circle(image, (640, 450), 60, 255, -1)
    assert kinds(CameraHealth(CAMERA), pictures) == []


@pytest.mark.parametrize("grey", [0, 255])
def test_one_grey_all_over_is_not_taken_for_standstill(grey: int) -> None:
    told = kinds(CameraHealth(CAMERA), [plain(grey)] * 8)
    assert told == [(2, "saturated" if grey else "dark")]


def test_every_trouble_of_light_and_standstill_is_told_at_its_third_picture(
    good: list[np.ndarray],
) -> None:
    troubles = {
        "dark": [plain(3)] * 3,
        "saturated": [plain(255)] * 3,
        # The picture before is a good one: it is the first of the four that are the same.
        "frozen": [good[1]] * 3,
    }
    for kind, pictures in troubles.items():
        told = kinds(CameraHealth(CAMERA), [*good[:2], *pictures, *good[2:5]])
        assert [place for place, each in told if each == kind] == [4], kind
        assert len(told) == 2 and told[1][0] == 7, kind


def test_a_frozen_camera_is_told_once_and_its_end_once(good: list[np.ndarray]) -> None:
    told = kinds(CameraHealth(CAMERA), [*good[:2], *[good[1]] * 5, *good[2:6]])
    assert told == [(4, "frozen"), (9, "running")]


@pytest.mark.parametrize("shift", [(3.0, 0.0), (-2.0, 2.5), (14.0, 9.0), (180.0, 90.0)])
def test_a_camera_that_was_knocked_is_told_within_a_few_pictures(
    good: list[np.ndarray], shift: tuple[float, float]
) -> None:
    knocked = [arena(k + 8, shift=shift) for k in range(4)]
    told = kinds(CameraHealth(CAMERA), [*good[:4], *knocked, *good[4:8]])
    assert told == [(6, "moved"), (10, "steady")]


@pytest.mark.parametrize("shift", [(0.0, 0.0), (1.0, -0.5), (4.0, 3.0), (-11.0, 6.0)])
def test_the_shift_is_measured_to_a_fraction_of_a_pixel(
    good: list[np.ndarray], shift: tuple[float, float]
) -> None:
    steadiness = Steadiness(SIZE)
    assert steadiness.shift_px(good[0]) is None
    measured = steadiness.shift_px(arena(5, shift=shift))
    assert measured == pytest.approx(np.hypot(*shift), abs=0.3)


@pytest.mark.parametrize("light", [0.5, 0.8, 1.3])
def test_a_lamp_is_no_movement(good: list[np.ndarray], light: float) -> None:
    steadiness = Steadiness(SIZE)
    steadiness.shift_px(good[0])
    measured = steadiness.shift_px(arena(4, light))
    assert measured is not None and measured < 0.5


def test_a_floor_without_anything_on_it_says_nothing() -> None:
    steadiness = Steadiness(SIZE)
    plain = np.full(SIZE[::-1], 120, np.uint8)
    assert [steadiness.shift_px(plain) for _ in range(3)] == [None] * 3


def detections(camera: Camera, places: dict[int, tuple[float, float]]) -> np.ndarray:
    rows = np.zeros(len(places), dtype=DETECTION)
    points = np.array([(*place, 0.06) for place in places.values()]).reshape(-1, 3)
    rows["tag"] = list(places)
    rows["x_px"], rows["y_px"] = camera.project(points).T
    return rows


def neighbours() -> tuple[Camera, Camera]:
    left = Camera.looking_down("left", -0.5, 0.0, 2.4, 810.0, SIZE)
    return left, Camera.looking_down("right", 0.5, 0.0, 2.4, 810.0, SIZE)


def events(places: dict[str, dict[int, tuple[float, float]]], times: int) -> list[str]:
    """What is told when two cameras see markers at these places again and again."""
    agreement, heights = Agreement(), dict.fromkeys(range(5), 0.06)
    cameras = CameraArray(neighbours())
    pictures = {c.id: detections(c, places[c.id]) for c in cameras.cameras}
    found = marker_places(cameras, pictures, heights)
    return [str(e) for _ in range(times) for e in agreement.compare(found)]


def test_cameras_that_disagree_about_common_markers_are_told_with_how_much() -> None:
    seen = {1: (0.0, 0.1), 2: (0.05, -0.2), 3: (-0.03, 0.3)}
    shifted = {tag: (x + 0.009, y + 0.012) for tag, (x, y) in seen.items()}
    assert events({"left": seen, "right": shifted}, 30) == [
        "camera left: and camera right disagree by 15 mm: one of them has moved"
    ]


def test_one_marker_that_is_misplaced_or_there_twice_accuses_no_camera() -> None:
    seen = {k: (0.02 * k, 0.1 * k - 0.2) for k in range(5)}
    one = {**seen, 3: (0.02 * 3 + 0.1, 0.1)}
    assert events({"left": seen, "right": one}, 30) == []
    assert events({"left": seen, "right": {}}, 5) == []
    assert events({"left": {1: (0.0, 0.0)}, "right": {1: (0.1, 0.0)}}, 80) == []


def test_many_cameras_are_checked_for_movement_by_turns() -> None:
    cameras = [Camera.looking_down(str(k), k, 0.0, 2.4, 810.0, SIZE) for k in range(5)]
    health = Health(cameras, {})
    looked: list[str] = []
    for camera in cameras:
        watch = health._cameras[camera.id]
        watch.check_place = lambda image, rows, id=camera.id: looked.append(id) or []  # type: ignore
    frames = [Frame(c.id, np.zeros(SIZE[::-1], np.uint8), 0, 0, 0) for c in cameras]
    for _ in range(5):
        health.update(frames, {})
    assert sorted(looked) == sorted("01234" * 2)
