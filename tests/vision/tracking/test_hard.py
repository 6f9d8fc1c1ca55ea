"""Hard pictures, and sequences of moving robots with every way to search them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tests.bench.frames import FRAMES_PER_S, MARKER_M, FrameSet, Painter, cameras
from tests.bench.tracking import TABLE_2_1
from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.base.arena import UNNAMED, Frame
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import (
    MarkerFamily,
    SquareFamily,
    choose_tags,
    load_family,
    parse_tags,
)
from vsense.vision.tracking._detector import make_detector
from vsense.vision.tracking._prediction import SearchPlan
from vsense.vision.tracking.arena_tracker import ArenaTracker

FAMILIES = ("arrow4x4", "arrow4x4-thesis")
ROBOTS = 20
LENS = (-0.12, 0.02, 0.0, 0.0, 0.0)
WIDE = Camera.looking_down("wide", 0.0, 0.0, 2.43, 1620.0, (1620, 1220), LENS)
HARD = Look(psf_px=1.2, noise=5.0, exposure_s=0.03, light=0.6)


def arrows(name: str) -> tuple[MarkerFamily, list[int]]:
    """Returns a family and tags that stay apart under its hardest blur."""
    family = load_family(name)
    assert isinstance(family, MarkerFamily)
    return family, choose_tags(family, ROBOTS, 2.5, seed=14)


def crowd(tags: list[int], seed: int) -> list[Robot]:
    rng = np.random.default_rng(seed)
    spots: list[np.ndarray] = []
    while len(spots) < len(tags):
        spot = rng.uniform((-1.03, -0.75), (1.03, 0.75))
        if all(np.hypot(*(spot - other)) > 0.0705 for other in spots):
            spots.append(spot)
    return [
        Robot(tag, float(x), float(y), rng.uniform(-np.pi, np.pi), 0.12)
        for tag, (x, y) in zip(tags, spots, strict=True)
    ]


@pytest.mark.parametrize("name", FAMILIES)
def test_blur_noise_and_uneven_light_cost_at_most_one_name_in_a_hundred(name: str) -> None:
    family, tags = arrows(name)
    detector = make_detector(family, tags, HEIGHT_M)
    named = 0
    for seed in range(3):
        robots = {robot.tag: robot for robot in crowd(tags, 700 + seed)}
        found = detector.detect(render(WIDE, family, [*robots.values()], HARD, seed=seed), WIDE)
        found = found[found["tag"] != UNNAMED]
        places = WIDE.to_plane(np.stack((found["x_px"], found["y_px"]), axis=1), HEIGHT_M)
        for tag, place in zip(found["tag"].tolist(), places, strict=True):
            assert np.hypot(*(place - (robots[tag].x_m, robots[tag].y_m))) < 1e-3
        named += len(set(found["tag"].tolist()))
    assert named >= 3 * ROBOTS - 1


@pytest.fixture(scope="module", params=FAMILIES)
def walk(request: pytest.FixtureRequest) -> FrameSet:
    """60 pictures of 20 robots that drive, turn and spin below one camera."""
    _, tags = arrows(request.param)
    return Painter("walk", request.param, tuple(tags), cameras(1, 1)).walk(60)


@pytest.mark.parametrize("plan", [*TABLE_2_1, (15, 0.11, True)])
def test_every_plan_of_the_thesis_detects_20_of_20(
    walk: FrameSet, plan: tuple[int, float] | tuple[int, float, bool]
) -> None:
    camera = walk.cameras[0]
    family = load_family(walk.family)
    heights = dict.fromkeys(walk.tags, MARKER_M)
    tracker = ArenaTracker.for_family([camera], family, heights, plan=SearchPlan(*plan))
    for number, (image, truth) in enumerate(zip(walk.images, walk.truth, strict=True)):
        capture_ns = round(1e9 * number / FRAMES_PER_S)
        state = tracker.update([Frame(camera.id, image, number, capture_ns, capture_ns)])
        assert state.detected == ROBOTS and state.unnamed == 0 and state.robots["seen"].all()
        poses = state.robots
        seen = camera.project(
            np.column_stack((poses["x_m"], poses["y_m"], np.full(ROBOTS, MARKER_M)))
        )
        order = np.argsort(truth.tags)
        assert np.hypot(*(seen - truth.centres_px[order]).T).max() < 0.5
    tracker.close()


def test_a_cable_across_a_known_robot_does_not_lose_it() -> None:
    family, tags = arrows("arrow4x4")
    camera = Camera.looking_down("small", 0.0, 0.0, 2.43, 1620.0, (480, 360), LENS)
    tracker = ArenaTracker.for_family([camera], family, dict.fromkeys(tags, HEIGHT_M))
    lost = 0
    for step in range(12):
        robots = [
            Robot(tag, -0.2 + 0.1 * k + 0.008 * step, 0.05 * (k % 2), 0.0, 0.12)
            for k, tag in enumerate(tags[:4])
        ]
        picture = render(camera, family, robots, Look(litter=0), seed=step)
        if step >= 3:
            picture[:, 255:258] = 25
        state = tracker.update([Frame("small", picture, step, step * 66_000_000, 0)])
        lost += 4 - int(state.robots["seen"].sum())
        for row in state.robots[state.robots["seen"]]:
            (robot,) = (r for r in robots if r.tag == row["tag"])
            assert np.hypot(row["x_m"] - robot.x_m, row["y_m"] - robot.y_m) < 2e-3
    tracker.close()
    assert lost <= 3


OPENCV = {"apriltag_36h11": "DICT_APRILTAG_36h11", "aruco_4x4_50": "DICT_4X4_50"}


def under_an_edge(
    family: MarkerFamily | SquareFamily, tags: list[int], shade: int, seed: int
) -> tuple[np.ndarray, list[Robot]]:
    """Returns a picture in which dark sheets lie over a fifth of each marker's disc."""
    rng, camera = np.random.default_rng(seed), Camera.looking_down("c", 0, 0, 2.43, 1620.0, SHEETS)
    places = [(x, y) for x in (-0.36, 0.0, 0.36) for y in (-0.25, 0.0, 0.25)]
    robots = [
        Robot(tag, *(xy + rng.uniform(-0.03, 0.03, 2)), float(rng.uniform(-np.pi, np.pi)))
        for tag, xy in zip(tags, np.array(places))
    ]
    picture = render(camera, family, robots, Look(psf_px=0.0, noise=0.0, litter=0), seed)
    for robot in robots:
        turn = rng.uniform(-np.pi, np.pi)
        out, along = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        sides = [(0.0205, -0.07), (0.0205, 0.07), (0.07, 0.07), (0.07, -0.07)]
        corners = [np.array([robot.x_m, robot.y_m]) + a * out + b * along for a, b in sides]
        pixels = camera.project(np.column_stack((corners, np.full(4, HEIGHT_M))))
        cv2.fillConvexPoly(picture, np.rint(16 * pixels).astype(np.int32), shade, cv2.LINE_AA, 4)
    soft = cv2.GaussianBlur(picture, (0, 0), 0.6) + rng.normal(0.0, 2.5, picture.shape)
    return np.clip(np.rint(soft), 0, 255).astype(np.uint8), robots


SHEETS = (960, 720)


@pytest.mark.parametrize("name", ["arrow4x4", *OPENCV])
def test_a_marker_with_a_dark_edge_over_it_is_found_by_its_corners(name: str) -> None:
    family = load_family(name)
    tags = parse_tags("auto:12", family)
    camera = Camera.looking_down("c", 0, 0, 2.43, 1620.0, SHEETS)
    detector, ours, theirs, total = make_detector(family, tags, HEIGHT_M), 0, 0, 0
    for seed, shade in enumerate((10, 30, 45, 80)):
        picture, robots = under_an_edge(family, tags, shade, seed)
        seen = detector.detect(picture, camera)
        places = camera.to_plane(np.stack((seen["x_px"], seen["y_px"]), axis=1), HEIGHT_M)
        for tag, place in zip(seen["tag"].tolist(), places):
            (robot,) = (r for r in robots if r.tag == tag)
            assert np.hypot(*(place - (robot.x_m, robot.y_m))) < 1e-3
        ours, total = ours + len(seen), total + len(robots)
        if name in OPENCV:
            words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, OPENCV[name]))
            found = cv2.aruco.ArucoDetector(words).detectMarkers(picture)[1]
            theirs += 0 if found is None else len(found)
    assert ours >= (0.9 if name in OPENCV else 0.6) * total and ours > 2 * theirs
