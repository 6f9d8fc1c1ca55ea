"""Markers that change robots while something lies on their cells: unnamed, never a wrong name.

People lift robots and set others down, and hold cables and hands over them meanwhile. Where a robot
was says nothing then, and what is seen of the cells may say little.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, cell_corners, lay_over, render
from vsense.base.arena import ArenaState, Frame
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, choose_tags, load_family
from vsense.vision.tracking._prediction import SearchPlan
from vsense.vision.tracking.arena_tracker import ArenaTracker

CAMERA = Camera.looking_down("a", 0.0, 0.0, 2.43, 1620.0, (800, 600))
SPOTS = [(x, y) for x in (-0.4, -0.13, 0.13, 0.4) for y in (-0.25, 0.0, 0.25)]
BEFORE, AFTER = 4, 5
SHADES = (20, 60, 120, 200, 235)


def cover(picture: np.ndarray, robot: Robot, corners: np.ndarray, rng: np.random.Generator) -> None:
    """Lays something over a fifth of the cells to all of them, from one side."""
    covered, axis, end = corners.copy(), rng.integers(2), rng.integers(2)
    share = rng.uniform(0.2, 1.0)
    covered[1 - end, axis] += (1.0 - share) * (corners[end, axis] - corners[1 - end, axis])
    lay_over(picture, CAMERA, robot, covered, int(rng.choice(SHADES)))


def exchanged(robots: list[Robot]) -> list[Robot]:
    """Neighbours with each other's markers."""
    changed = []
    for one, other in zip(robots[::2], robots[1::2]):
        for marker, place in ((other, one), (one, other)):
            changed.append(Robot(marker.tag, place.x_m, place.y_m, place.yaw_rad))
    return changed


def strays(state: ArenaState, robots: list[Robot]) -> list[int]:
    """Tags that are seen where their robots are not."""
    true = {robot.tag: (robot.x_m, robot.y_m) for robot in robots}
    rows = state.robots[state.robots["seen"]]
    places = zip(rows["tag"].tolist(), rows["x_m"].tolist(), rows["y_m"].tolist())
    return [tag for tag, x, y in places if np.hypot(x - true[tag][0], y - true[tag][1]) > 0.03]


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.campaign) for seed in (1, 2))]
)
@pytest.mark.parametrize("name", ["arrow4x4", "arrow4x4-thesis", "apriltag_36h11", "aruco_4x4_50"])
def test_no_name_is_carried_onto_another_robot(name: str, seed: int) -> None:
    family, rng = load_family(name), np.random.default_rng(seed)
    is_arrow = isinstance(family, MarkerFamily)
    tags = choose_tags(family, len(SPOTS), 2.2, seed=14) if is_arrow else range(len(SPOTS))
    robots = [Robot(tag, x, y, float(rng.uniform(-3.0, 3.0))) for tag, (x, y) in zip(tags, SPOTS)]
    tracker = ArenaTracker.for_family([CAMERA], family, dict.fromkeys(tags, HEIGHT_M))
    for step in range(BEFORE + AFTER):
        if step == BEFORE:
            assert tracker.state.robots["seen"].all()
            robots = exchanged(robots)
        picture = render(CAMERA, family, robots, Look(litter=0), 100 * seed + step)
        covers = np.random.default_rng(seed)
        for robot in robots if step >= BEFORE else ():
            cover(picture, robot, cell_corners(family), covers)
        state = tracker.update([Frame("a", picture, step, (1 + step) * 100_000_000, 0)])
        assert strays(state, robots) == []
    tracker.close()


@pytest.mark.parametrize(("name", "tags"), [("arrow4x4", (31, 1843)), ("apriltag_36h11", (1, 2))])
def test_a_robot_in_another_s_place_is_one_marker_though_both_are_expected_there(
    name: str, tags: tuple[int, int]
) -> None:
    family, (gone, moved) = load_family(name), tags
    warm, heights_m = SearchPlan(3, warm=True), dict.fromkeys(tags, HEIGHT_M)
    tracker = ArenaTracker.for_family([CAMERA], family, heights_m, plan=warm)
    seen = []
    for step in range(24):
        robots = [Robot(moved, -0.2, 0.0, 0.3)]
        if step < BEFORE:
            robots = [Robot(gone, -0.2, 0.0, 0.3), Robot(moved, 0.2, 0.0, 0.3)]
        picture = render(CAMERA, family, robots, Look(litter=0), step)
        state = tracker.update([Frame("a", picture, step, step * 33_000_000, 0)])
        assert state.duplicates == () and strays(state, robots) == []
        seen.append(moved in state.robots["tag"][state.robots["seen"]])
    tracker.close()
    assert all(seen[:BEFORE]) and not seen[BEFORE] and all(seen[14:])
