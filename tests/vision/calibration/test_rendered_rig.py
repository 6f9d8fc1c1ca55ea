"""The whole way: a rendered rig of four cameras, from pictures to where robots are."""

from __future__ import annotations

import numpy as np
import pytest

from tests.vision.calibration.ideal import BOARD, CAMERAS, arena_errors_m
from vsense.modes.lab.board_studio import BoardStudio, board_plan
from vsense.vision.calibration._bundle import lens_of
from vsense.vision.calibration._intrinsics import calibrate_lenses
from vsense.vision.calibration._placement import FloorReference
from vsense.vision.calibration._rig import Rig, RigSolver, Trust
from vsense.vision.calibration._views import BoardViews, View
from vsense.vision.calibration.board import CornerFinder

PLAN = board_plan(CAMERAS, BOARD, 8, 14, 3)
POSES = dict(PLAN)


@pytest.fixture(scope="module")
def shoot() -> BoardViews:
    """What is found in about 40 rendered pictures."""
    studio, finder = BoardStudio(CAMERAS, BOARD, 3), CornerFinder(BOARD)
    views = []
    counts = dict.fromkeys((camera.id for camera in CAMERAS), 0)
    for moment, pose in PLAN:
        for camera, image in studio.take(pose):
            counts[camera] += 1
            found = finder.find(image)
            if found is not None:
                views.append(View(camera, moment, *found))
    views.sort(key=lambda view: (view.camera, view.moment))
    return BoardViews({c.id: (c.width_px, c.height_px) for c in CAMERAS}, views, counts)


def test_corners_are_found_to_a_twentieth_of_a_pixel(shoot: BoardViews) -> None:
    cameras = {camera.id: camera for camera in CAMERAS}
    errors = [
        view.pixels
        - cameras[view.camera].project(POSES[view.moment].apply(BOARD.points_m[view.ids]))
        for view in shoot.views
    ]
    size = np.linalg.norm(np.concatenate(errors), axis=1)
    assert len(shoot.views) >= 0.9 * sum(shoot.pictures.values())
    assert np.sqrt(np.mean(size**2)) < 0.07 and np.median(size) < 0.05


def test_robots_anywhere_are_right_to_2_mm_and_step_less_than_1_mm(shoot: BoardViews) -> None:
    found = calibrate_lenses(shoot, BOARD)
    lenses = {camera.id: lens_of(camera) for camera in found.cameras}
    x, y, _ = PLAN[0][1].shift
    floor = FloorReference(flat=("floor_*",), origin=(float(x), float(y), 0.0))
    solution = RigSolver(Rig(shoot, BOARD, floor, lenses, Trust.FREE)).solve()
    for height_m in (0.0, 0.06, 0.12):
        worst, step = arena_errors_m(solution.cameras, height_m)
        assert worst <= 2e-3
        assert step <= 1e-3
