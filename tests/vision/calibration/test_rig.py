"""Rigs: all cameras in one frame, from boards and from known points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.vision.calibration.ideal import (
    BOARD,
    CAMERAS,
    ORIGIN,
    PLAN,
    arena_errors_m,
    arena_grid,
    shoot,
)
from vsense.base.errors import UsageError
from vsense.vision.calibration._bundle import lens_of
from vsense.vision.calibration._placement import FloorReference
from vsense.vision.calibration._rig import Rig, RigSolver, Trust
from vsense.vision.calibration._solution import CalibrationError, Solution, check_board
from vsense.vision.calibration._views import BoardViews, View
from vsense.vision.calibration.frame import BoardPose

LENSES = {camera.id: lens_of(camera) for camera in CAMERAS}
FLOOR = FloorReference(flat=("floor_*",), origin=ORIGIN)
SHOOT = shoot(PLAN)
SHIFT = np.array((15.0, -9.0))
WRONG = (1.004, 1.004, 1.008, 0.993, 1.2, 1.0, 1.0, 1.0, 1.0)


def solve(
    seen: BoardViews = SHOOT,
    floor: FloorReference = FLOOR,
    trust: Trust = Trust.HOLD,
    lenses=LENSES,
) -> Solution:
    return RigSolver(Rig(seen, BOARD, floor, lenses, trust)).solve()


@pytest.mark.parametrize("trust", list(Trust))
def test_robots_are_where_they_are_in_every_camera(trust: Trust) -> None:
    solution = solve(trust=trust)
    worst, step = arena_errors_m(solution.cameras)
    assert worst <= 1e-3 and step <= 1e-3
    assert not solution.rejected and not solution.notes
    told = max(solution.floor_sigma_m.values())
    assert worst < 6.0 * told + 1e-4


def test_wrong_lenses_are_mended_if_they_may() -> None:
    wrong = {name: lens * np.array(WRONG) for name, lens in LENSES.items()}
    held, _ = arena_errors_m(solve(lenses=wrong).cameras)
    refined, _ = arena_errors_m(solve(lenses=wrong, trust=Trust.REFINE).cameras)
    assert refined < 5e-4 and refined < held


def test_order_of_views_changes_nothing() -> None:
    shuffled = list(SHOOT.views)
    np.random.default_rng(2).shuffle(shuffled)
    one, other = solve(), solve(replace(SHOOT, views=shuffled))
    for first, second in zip(one.cameras, other.cameras):
        assert first.position_m == pytest.approx(second.position_m, abs=1e-6)


def test_origin_turns_and_moves_the_whole_arena() -> None:
    turned = replace(FLOOR, origin=(1.0, -2.0, np.pi / 2))
    for old, new in zip(solve().cameras, solve(floor=turned).cameras):
        x, y = np.array(old.position_m[:2]) - ORIGIN[:2]
        assert new.position_m == pytest.approx((1.0 - y, -2.0 + x, old.position_m[2]), abs=1e-6)


def test_thick_board_raises_the_cameras() -> None:
    thick = replace(FLOOR, thickness_m=0.02)
    for old, new in zip(solve().cameras, solve(floor=thick).cameras):
        assert new.position_m[2] - old.position_m[2] == pytest.approx(0.02, abs=1e-6)


def test_without_a_floor_the_best_moment_is_the_frame_and_is_named() -> None:
    solution = solve(floor=FloorReference())
    assert "no floor was given" in solution.notes[0]
    best = next(m for m, (turn, _) in solution.bodies.items() if np.array_equal(turn, np.eye(3)))
    assert best in solution.notes[0]


def test_views_that_contradict_all_others_are_left_out() -> None:
    views = list(SHOOT.views)
    number = next(k for k, v in enumerate(views) if v.moment == "floor_03")
    views[number] = replace(views[number], pixels=views[number].pixels + SHIFT)
    solution = solve(replace(SHOOT, views=views))
    assert {view.moment for view in solution.rejected} == {"floor_03"}
    assert arena_errors_m(solution.cameras)[0] < 1e-3


def test_cameras_without_overlap_are_refused_with_their_groups() -> None:
    alone = [v for v in SHOOT.views if not (v.camera < "cam_1" and _shared(v, "cam_1"))]
    with pytest.raises(CalibrationError) as refusal:
        solve(replace(SHOOT, views=alone))
    text = str(refusal.value)
    assert "cam_0_0, cam_0_1 | cam_1_0, cam_1_1" in text and "lay it where" in text


def _shared(view: View, others: str) -> bool:
    return any(o.moment == view.moment and o.camera.startswith(others) for o in SHOOT.views)


def test_camera_that_never_saw_the_board_is_named() -> None:
    views = [view for view in SHOOT.views if view.camera != "cam_1_1"]
    with pytest.raises(CalibrationError, match=r"cam_1_1:.*board"):
        solve(replace(SHOOT, views=views))


def test_floor_that_is_no_moment_is_refused() -> None:
    with pytest.raises(UsageError, match=r"--floor.*floor_00, floor_01"):
        solve(floor=replace(FLOOR, flat=("x*",)))


def known(sigma_m: float) -> FloorReference:
    """Twelve points or more per camera, measured as well as `sigma_m`."""
    rng = np.random.default_rng(4)
    true = {str(k): point for k, point in enumerate(arena_grid(0.3, 0.0))}
    views = []
    for camera in CAMERAS:
        for id, point in true.items():
            pixel = camera.project(point) + rng.normal(0.0, 0.05, 2)
            if camera.contains(pixel[np.newaxis], 4.0)[0]:
                views.append(View(camera.id, f"point {id}", np.zeros(1, np.int64), pixel[None]))
    measured = {id: point + rng.normal(0.0, sigma_m, 3) for id, point in true.items()}
    return FloorReference(points_m=measured, sightings=tuple(views), sigma_m=max(sigma_m, 1e-4))


@pytest.mark.parametrize(("sigma_m", "limit_m"), [(0.0, 5e-4), (1e-3, 2e-3)])
def test_known_points_alone_place_all_cameras(sigma_m: float, limit_m: float) -> None:
    solution = solve(replace(SHOOT, views=[]), known(sigma_m))
    assert arena_errors_m(solution.cameras)[0] < limit_m


def test_known_points_and_boards_together_are_better() -> None:
    points = known(2e-3)
    alone = solve(replace(SHOOT, views=[]), points)
    both = solve(floor=points)
    assert arena_errors_m(both.cameras)[1] < arena_errors_m(alone.cameras)[1]
    assert arena_errors_m(both.cameras)[0] < 2e-3


def test_too_few_known_points_are_refused() -> None:
    points = known(0.0)
    few = tuple(v for v in points.sightings if v.camera != "cam_0_0")
    with pytest.raises(CalibrationError, match=r"cam_0_0:.*4.*points"):
        solve(replace(SHOOT, views=[]), replace(points, sightings=few))


def test_board_measures_itself() -> None:
    check = check_board(CAMERAS, SHOOT.views, BOARD)
    assert check is not None
    assert check.reprojection_px == pytest.approx(0.04 * np.sqrt(2.0) * np.sqrt(0.3), rel=0.6)
    assert check.sd_mm < 0.2
    assert check_board(CAMERAS, SHOOT.of("cam_0_0"), BOARD) is None


def test_one_camera_above_one_board_is_a_rig() -> None:
    one = CAMERAS[:1]
    lying = [("here", BoardPose(np.eye(3), np.array((-0.8, -0.6, 0.0))))]
    seen = shoot(lying, one)
    floor = FloorReference(flat=("here",), origin=(-0.8, -0.6, 0.0))
    solution = RigSolver(
        Rig(seen, BOARD, floor, {one[0].id: LENSES[one[0].id]}, Trust.HOLD)
    ).solve()
    assert solution.cameras[0].position_m == pytest.approx(one[0].position_m, abs=5e-3)
