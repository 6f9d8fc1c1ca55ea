"""The picture of one arena state shows every camera, and every robot where it is."""

from __future__ import annotations

import numpy as np
import pytest

from vsense.base.arena import DETECTION, POSE, UNNAMED, ArenaState, Frame
from vsense.monitor.pictures import snapshot
from vsense.vision.cameras.camera import Camera

SIZE = (320, 240)
CAMERAS = [
    Camera.looking_down(f"cam {x} {y}", 0.6 * x, 0.5 * y, 2.0, 640.0, SIZE)
    for y in (0, 1)
    for x in (0, 1)
]
GREY = np.random.default_rng(0).integers(80, 160, SIZE[::-1], dtype=np.uint8)
HEIGHTS = {1: 0.05, 2: 0.05, 3: 0.05}


def state(*robots: tuple[int, float, float], duplicates: tuple[int, ...] = ()) -> ArenaState:
    poses = np.zeros(len(robots), dtype=POSE)
    for row, (tag, x_m, y_m) in zip(poses, robots):
        row["tag"], row["x_m"], row["y_m"], row["seen"] = tag, x_m, y_m, True
    return ArenaState(4, 0, poses, len(robots), 0, duplicates)


def rows(camera: Camera, *robots: tuple[int, float, float]) -> np.ndarray:
    found = np.zeros(len(robots), dtype=DETECTION)
    for row, (tag, x_m, y_m) in zip(found, robots):
        row["tag"] = tag
        row["x_px"], row["y_px"] = camera.project(np.array((x_m, y_m, 0.05)))
    return found


def coloured(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """Rows and columns of the panels' pixels of a colour, (n, 2)."""
    near = np.abs(picture.astype(int) - colour).max(axis=2) < 40
    near[:100] = False
    return np.argwhere(near)


def draw(arena: ArenaState, found: dict[str, np.ndarray], frames: int = 4) -> np.ndarray:
    pictures = [Frame(c.id, GREY, 4, 0, 0) for c in CAMERAS[:frames]]
    return snapshot.draw(arena, pictures, CAMERAS, found, HEIGHTS)


@pytest.mark.parametrize("number", range(4))
def test_a_named_robot_is_ringed_in_the_panel_of_its_camera(number: int) -> None:
    camera = CAMERAS[number]
    robot = (1, *camera.position_m[:2])
    found = {c.id: rows(c) for c in CAMERAS} | {camera.id: rows(camera, robot)}
    picture = draw(state(robot), found)
    middle = coloured(picture, snapshot._NAMED).mean(axis=0) / picture.shape[:2]
    # Columns run along +x, rows against +y.
    assert (middle[1] > 0.5, middle[0] < 0.5) == (number % 2 == 1, number >= 2)


def test_a_robot_seen_elsewhere_without_a_name_or_twice_has_its_own_colour() -> None:
    found = {c.id: rows(c) for c in CAMERAS}
    assert len(coloured(draw(state((1, 0.0, 0.0)), found), snapshot._CARRIED)) > 100
    found[CAMERAS[0].id] = rows(CAMERAS[0], (UNNAMED, 0.0, 0.0))
    assert len(coloured(draw(state(), found), snapshot._NAMELESS)) > 100
    found[CAMERAS[0].id] = rows(CAMERAS[0], (2, 0.0, 0.0), (2, 0.1, 0.0))
    twice = state((2, 0.0, 0.0), duplicates=(2,))
    assert len(coloured(draw(twice, found), snapshot._TWICE)) > 100


def test_a_camera_without_a_picture_and_robots_at_the_border_are_drawn_all_the_same() -> None:
    edge = [(tag, x, y) for tag, x, y in ((1, -0.48, 0.36), (2, 0.48, -0.36), (3, 9.0, 9.0))]
    found = {c.id: rows(c, *edge[:2]) for c in CAMERAS[:3]}
    picture = draw(state(*edge), found, frames=3)
    assert picture.dtype == np.uint8 and picture.shape[1] > 2 * snapshot.PANEL_PX
    assert draw(state(), {}, frames=0).shape == picture.shape
