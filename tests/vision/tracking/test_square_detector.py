"""Square markers on robots from picture to picture: windows, warm fits, carried names, joining."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.base.arena import Frame, wrap_angle
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._detector import make_detector
from vsense.vision.tracking._kernel import Kernel
from vsense.vision.tracking._prediction import SearchPlan
from vsense.vision.tracking.arena_tracker import ArenaTracker

ARUCO = load_family("aruco_4x4_50")
ASKEW = replace(load_family("apriltag_36h11"), heading_deg=137.0, centre_mm=(2.0, -1.5))
LENS = (-0.12, 0.02, 0.0, 0.0, 0.0)
CAMERA = Camera.looking_down("c", 0.0, 0.0, 2.43, 1620.0, (640, 480), LENS)
STEPS = 8


def robots(step: int) -> list[Robot]:
    """Returns robots that drive."""
    way = 0.008 * step
    return [
        Robot(3, -0.3 + way, 0.1, 0.0, 0.12),
        Robot(9, 0.1, -0.2 + way, np.pi / 2, 0.12),
        Robot(21, 0.25, 0.15, 2.0),
    ]


def images(family: object, cable_px: int = 0) -> list[np.ndarray]:
    shots = [render(CAMERA, family, robots(k), Look(litter=3), seed=k) for k in range(STEPS)]  # type: ignore[arg-type]
    for shot in shots[3:]:
        column = round(CAMERA.project(np.array((0.25, 0.15, HEIGHT_M)))[0]) + 3
        shot[:, column : column + cable_px] = 190
    return shots


def play(
    family: object, shots: list[np.ndarray], plan: SearchPlan, tags: tuple[int, ...] = (3, 9, 21)
) -> ArenaTracker:
    """Tracks a sequence; every robot of the roster is seen at its place in each picture."""
    arena = ArenaTracker.for_family([CAMERA], family, dict.fromkeys(tags, HEIGHT_M), plan=plan)  # type: ignore[arg-type]
    for step, shot in enumerate(shots):
        state = arena.update([Frame("c", shot, step, step * 66_000_000, 0)])
        for robot in robots(step):
            if robot.tag in tags:
                (row,) = state.robots[state.robots["tag"] == robot.tag]
                assert row["seen"], f"robot {robot.tag} at {step}"
                assert np.hypot(row["x_m"] - robot.x_m, row["y_m"] - robot.y_m) < 1e-3
                assert abs(wrap_angle(float(row["yaw_rad"]) - robot.yaw_rad)) < 0.03
    arena.close()
    return arena


@pytest.mark.parametrize("family", [ARUCO, ASKEW], ids=["aruco", "askew"])
@pytest.mark.parametrize("plan", [(1, 0.11, False), (4, 0.11, False), (4, 0.11, True)])
def test_every_plan_follows_every_robot(family: object, plan: tuple[int, float, bool]) -> None:
    play(family, images(family), SearchPlan(*plan))


def test_between_key_frames_only_squares_are_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[object] = []
    search = Kernel.search

    def spy(self: Kernel, *arguments: Any) -> np.ndarray:
        looked.append(arguments[3])
        return search(self, *arguments)

    monkeypatch.setattr(Kernel, "search", spy)
    play(ARUCO, images(ARUCO), SearchPlan(4, 0.11))
    assert [windows is None for windows in looked] == [k % 4 == 0 for k in range(STEPS)]
    for windows in looked:
        if isinstance(windows, np.ndarray):
            assert len(windows) == 3 and (windows[:, 2:] - windows[:, :2]).max() < 100


def test_a_light_cable_across_a_known_robot_does_not_lose_it() -> None:
    shots = images(ARUCO, cable_px=4)
    alone = make_detector(ARUCO, (21,), HEIGHT_M).detect(shots[4], CAMERA)
    assert 21 not in alone["tag"].tolist(), "a picture by itself does not tell"
    play(ARUCO, shots, SearchPlan())


def test_a_robot_off_the_roster_is_nameless_and_joins_in_the_end() -> None:
    shots = [image for image in images(ARUCO) for _ in range(2)]
    arena = ArenaTracker.for_family([CAMERA], ARUCO, dict.fromkeys((3, 9), HEIGHT_M))
    joined = []
    for step, shot in enumerate(shots):
        state = arena.update([Frame("c", shot, step, step * 100_000_000, 0)])
        assert state.unnamed == (0 if state.joined else 1)
        joined.append(state.joined)
    arena.close()
    assert joined == [()] * 11 + [(21,)] * 5 and arena.heights_m[21] == HEIGHT_M
