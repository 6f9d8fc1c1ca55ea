"""Lenses: found from good pictures, refused from poor ones with the word what to shoot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.rigs.places import DATA
from tests.vision.calibration.ideal import BOARD, CAMERAS, SIZE, see
from vsense.modes.lab.board_studio import board_at
from vsense.vision.calibration._bundle import lens_of
from vsense.vision.calibration._intrinsics import calibrate_lens, calibrate_lenses
from vsense.vision.calibration._placement import first_lens, poses_in_camera
from vsense.vision.calibration._solution import CalibrationError
from vsense.vision.calibration._views import BoardViews, View
from vsense.vision.calibration.board import Board, CornerFinder
from vsense.vision.calibration.frame import BoardPose

CHESSBOARDS = DATA / "wall-tags-chessboards"
CAMERA = CAMERAS[0]
NAME = CAMERA.id

Draw = Callable[[np.random.Generator], BoardPose]


def pose(rng: np.random.Generator, reach: float, low: float, high: float, tilt: float) -> BoardPose:
    place = rng.uniform((-0.8, -0.6), (0.8, 0.6)) * reach + CAMERA.position_m[:2]
    leaning = np.array((*rng.uniform(-tilt, tilt, 2), 0.0))
    return board_at(
        BOARD, np.array((*place, rng.uniform(low, high))), leaning, rng.uniform(-np.pi, np.pi)
    )


def views(count: int, draw: Draw, seed: int = 1) -> list[View]:
    rng = np.random.default_rng(seed)
    shape = (len(BOARD.points_m), 2)
    taken = [see(CAMERA, f"{k:02d}", draw(rng), rng.normal(0, 0.04, shape)) for k in range(count)]
    return [view for view in taken if len(view.ids) >= 8]


def good(rng: np.random.Generator) -> BoardPose:
    return pose(rng, 1.0, 0.2, 0.9, 0.6)


def fit(found: list[View]):
    return calibrate_lens(NAME, SIZE, BOARD, found, len(found))


@pytest.mark.parametrize("seed", range(4))
def test_lens_is_found_as_well_as_it_says(seed: int) -> None:
    result = fit(views(20, good, seed))
    off = (result.lens - lens_of(CAMERA)) / result.sigma
    assert np.abs(off).max() < 5.0
    assert np.abs(result.lens[:2] - 1620.0).max() < 6.0


def test_bad_views_are_left_out_and_reported() -> None:
    found = views(20, good)
    rng = np.random.default_rng(5)
    bent = found[7].pixels + rng.normal(0.0, 4.0, found[7].pixels.shape)
    found[7] = replace(found[7], pixels=bent)
    result = fit(found)
    assert [number for number, view in enumerate(result.views) if not view.used] == [7]
    np.testing.assert_allclose(result.lens[:2], 1620.0, atol=6.0)
    assert 2.0 < np.sqrt((result.views[7].residuals ** 2).sum(axis=1).mean()) < 12.0


@pytest.mark.parametrize(
    ("count", "draw", "said"),
    [
        (3, good, "found in 3 of 3 pictures; shoot 10 to 20"),
        (20, lambda rng: STILL, "1 different places"),
        (20, lambda rng: pose(rng, 0.12, 0.0, 0.1, 0.6), "bring it into the corners"),
        (20, lambda rng: pose(rng, 1.0, 0.0, 0.0, 0.0), "tilt it by 20 to 45 degrees"),
        (20, lambda rng: pose(rng, 1.0, 0.0, 0.9, 0.0), "tilt it by 20 to 45 degrees"),
        (8, lambda rng: pose(rng, 1.0, 0.0, 0.0, 0.1), "leave the focal length open"),
    ],
    ids=["few", "one pose", "centre", "floor", "levels", "slight tilts"],
)
def test_poor_pictures_are_refused_with_what_to_shoot(count: int, draw: Draw, said: str) -> None:
    with pytest.raises(CalibrationError) as refusal:
        fit(views(count, draw))
    text = str(refusal.value)
    assert text.startswith(f"{NAME}: ") and said in text and "\n" not in text


STILL = pose(np.random.default_rng(3), 0.3, 0.3, 0.4, 0.5)


def test_every_poor_camera_is_named() -> None:
    nothing = BoardViews({"a": SIZE, "b": SIZE}, [], {"a": 4, "b": 0})
    with pytest.raises(CalibrationError, match=r"a:.*4.*0"):
        calibrate_lenses(nothing, BOARD)


def test_first_guess_is_near() -> None:
    sights = [(BOARD.points_m[view.ids], view.pixels) for view in views(12, good)]
    assert 0.7 < first_lens(SIZE, sights)[0] / 1620.0 < 1.4


def test_pose_of_a_board_is_found() -> None:
    for view in views(6, good):
        points = BOARD.points_m[view.ids]
        best = poses_in_camera(lens_of(CAMERA), points, view.pixels)[0]
        matrix = np.reshape(CAMERA.rotation, (3, 3))
        world = (best.apply(points) @ matrix) + CAMERA.position_m
        assert np.abs(CAMERA.project(world) - view.pixels).max() < 0.3


def test_real_chessboards() -> None:
    """Source: the data's README: rms 0.18 px, fx within 1 % of 765."""
    board = Board.parse("chessboard:7x5:30mm")
    finder = CornerFinder(board)
    found = []
    for path in sorted(CHESSBOARDS.glob("*.jpg")):
        seen = finder.find(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
        assert seen is not None, path.name
        found.append(View("phone", path.stem, *seen))
    assert len(found) == 17
    shoot = BoardViews({"phone": (816, 612)}, found, {"phone": 17})
    solution = calibrate_lenses(shoot, board)
    assert not solution.rejected
    assert solution.rms_px <= 0.20
    camera = solution.cameras[0]
    assert camera.fx_px == pytest.approx(765.0, rel=0.01)
    assert camera.fy_px == pytest.approx(764.18, rel=0.01)
    assert camera.cx_px == pytest.approx(393.72, abs=12.0)
    assert camera.cy_px == pytest.approx(304.66, abs=12.0)
    assert "phone: the board covers only" in solution.notes[0]
