"""What a calibration says of itself, in numbers, lines and as a picture."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.vision.calibration.ideal import BOARD, CAMERAS
from vsense.base.canvas import Canvas, round_number
from vsense.vision.calibration import _report
from vsense.vision.calibration._report import alarm, heat
from vsense.vision.calibration._solution import Solution, ViewResult, bad_views, huber_limit_px, rms


def view(camera: str, moment: str, size: float, used: bool = True) -> ViewResult:
    rng = np.random.default_rng(len(moment))
    pixels = rng.uniform((100, 100), (900, 600), (24, 2))
    return ViewResult(camera, moment, pixels, np.full((24, 2), size / np.sqrt(2.0)), used)


SOLUTION = Solution(
    cameras=tuple(CAMERAS[:2]),
    views=(
        view("cam_0_0", "first", 0.1),
        view("cam_0_0", "second", 0.2),
        view("cam_0_1", "first", 0.3),
        view("cam_0_1", "second", 9.0, used=False),
    ),
    lens_sigma=dict.fromkeys(("cam_0_0", "cam_0_1"), np.full(9, 0.5)),
    floor_sigma_m={"cam_0_0": 0.0004, "cam_0_1": float("nan")},
    bodies={m: (np.eye(3), np.array((0.1, 0.2, 0.0))) for m in ("first", "second")},
    notes=("something to know",),
)


def test_numbers_are_those_of_the_views() -> None:
    data = json.loads(json.dumps(_report.as_json(SOLUTION, BOARD, None), allow_nan=False))
    assert data["board"] == str(BOARD)
    assert data["cameras"]["cam_0_0"]["rms_px"] == pytest.approx(
        np.sqrt((0.01 + 0.04) / 2), abs=1e-4
    )
    assert data["cameras"]["cam_0_1"]["rejected"] == 1 and data["cameras"]["cam_0_1"]["views"] == 1
    assert data["cameras"]["cam_0_1"]["floor_sigma_mm"] is None
    assert [v["used"] for v in data["views"]] == [True, True, True, False]
    assert data["rms_px"] == pytest.approx(np.sqrt((0.01 + 0.04 + 0.09) / 3), abs=1e-4)


def test_lines_name_cameras_what_was_left_out_and_notes() -> None:
    lines = _report.as_text(SOLUTION, None)
    assert lines[0].split()[:3] == ["camera", "rms", "px"]
    assert lines[1].startswith("cam_0_0") and "±0.40 mm" in lines[1]
    assert any(line.startswith("left out: cam_0_1 second, 9.00 px") for line in lines)
    assert lines[-1] == "note: something to know"


def test_picture_has_a_panel_per_camera_and_shows_larger_residuals_redder() -> None:
    image = _report.draw("title", "subtitle", SOLUTION, BOARD)
    assert image.shape[0] > 900 and image.shape[1] > 1200 and image.dtype == np.uint8
    calm = replace(
        SOLUTION, views=tuple(replace(v, residuals=v.residuals * 0) for v in SOLUTION.views)
    )
    quiet = _report.draw("title", "subtitle", calm, BOARD)
    assert quiet.shape == image.shape
    hue = [int((i[..., 2].astype(int) - i[..., 0] > 60).sum()) for i in (quiet, image)]
    assert hue[1] > hue[0]


def test_colours_and_scales() -> None:
    assert alarm(0.0) != alarm(1.0) and alarm(5.0) == alarm(1.0)
    assert heat(np.array(((0.0, 1.0),)))[0, 0].min() > heat(np.array(((0.0, 1.0),)))[0, 1].min()
    assert [round_number(v) for v in (0.05, 0.19, 3.0, 7.0, 10.0)] == [0.05, 0.1, 2.0, 5.0, 10.0]


def test_lines_land_where_they_are_drawn() -> None:
    canvas = Canvas(40, 30)
    canvas.lines(np.array(((10.0, 5.0), (10.0, 25.0))), (0, 0, 0), 2.0)
    dark = 255 - cv2.cvtColor(canvas.finished(), cv2.COLOR_BGR2GRAY).astype(float)
    column = (dark.sum(axis=0) * np.arange(40)).sum() / dark.sum()
    assert column == pytest.approx(9.75, abs=0.5)


def test_bad_views_stand_out_from_the_rest() -> None:
    assert not bad_views(np.array([0.2, 0.3, 0.25, 0.4])).any()
    assert bad_views(np.array([0.2, 0.3, 0.25, 4.0])).tolist() == [False, False, False, True]
    assert not bad_views(np.array([0.01, 0.01, 0.3])).any()
    assert bad_views(np.zeros(0)).shape == (0,)


def test_limit_of_plain_noise_is_beyond_most_of_it() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.5, (4000, 2))
    share = (np.linalg.norm(noise, axis=1) > huber_limit_px(noise)).mean()
    assert 0.0 < share < 0.03
    assert huber_limit_px(noise * 1e-3) == 0.3
    assert rms(noise) == pytest.approx(0.5 * np.sqrt(2.0), rel=0.05)
