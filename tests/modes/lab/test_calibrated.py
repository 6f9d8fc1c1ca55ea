"""Cameras that hang a little off, and how wrong robots are for cameras that are known a little off.

Expected values are the errors that were put in.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vsense.modes.lab import calibrated
from vsense.modes.lab._camera_spec import rig
from vsense.modes.lab.calibrated import as_hung, calibrate, errors
from vsense.vision.calibration.frame import FrameShift
from vsense.vision.cameras.camera import Camera
from vsense.world.entities import Arena

ARENA = Arena((3.0, 2.4, 1.0), (0.0, 0.0, 0.5))
IDEAL = rig(ARENA)
HEIGHT_M = 0.06


@pytest.mark.parametrize("seed", [1, 2])
def test_cameras_hang_off_and_still_see_everything(seed: int) -> None:
    hung = as_hung(IDEAL, ARENA, HEIGHT_M, seed)
    assert hung == as_hung(IDEAL, ARENA, HEIGHT_M, seed) != as_hung(IDEAL, ARENA, HEIGHT_M, 9)
    corners = np.array([(x, y, HEIGHT_M) for x in (-1.5, 1.5) for y in (-1.2, 1.2)])
    assert all(any(c.contains(c.project(corner)) for c in hung) for corner in corners)
    for camera, ideal in zip(hung, IDEAL):
        off_m = np.abs(np.subtract(camera.position_m, ideal.position_m))
        assert 0.0 < off_m.max() <= calibrated.HUNG_M
        assert 0.0 < abs(camera.fx_px / ideal.fx_px - 1.0) <= calibrated.FOCAL_SHARE
        assert camera.distortion[2] != 0.0 and camera.id == ideal.id


def test_a_tight_rig_hangs_less_off() -> None:
    # Two by one cameras that hang as high as they must see 5 cm more than the arena.
    wide = Arena((5.0, 2.0, 1.0), (0.0, 0.0, 0.5))
    ideal = rig(wide, (2, 1))
    hung = as_hung(ideal, wide, HEIGHT_M, 1)
    edge = np.array([(x, y, HEIGHT_M) for x in np.linspace(-2.5, 2.5, 40) for y in (-1.0, 1.0)])
    assert np.any([c.contains(c.project(edge)) for c in hung], axis=0).all()


def test_a_frame_that_is_off_is_off_everywhere_and_bends_nothing() -> None:
    off = FrameShift(0.003, -0.004)
    found = errors(IDEAL, [off.moved(camera) for camera in IDEAL], ARENA, HEIGHT_M)
    assert found["position_rms_mm"] == found["position_worst_mm"] == 5.0
    assert found["heading_worst_deg"] == found["shape_worst_mm"] == found["overlap_worst_mm"] == 0.0
    turned = [FrameShift(yaw_rad=np.radians(0.2)).moved(camera) for camera in IDEAL]
    found = errors(IDEAL, turned, ARENA, HEIGHT_M)
    assert found["heading_rms_deg"] == pytest.approx(0.2, abs=1e-3)
    corner_m = np.hypot(1.5, 1.2)
    assert found["position_worst_mm"] == pytest.approx(1e3 * corner_m * np.radians(0.2), abs=1e-3)


def test_one_camera_that_is_off_shows_where_two_see_one_place() -> None:
    def shifted(camera: Camera) -> Camera:
        return replace(camera, position_m=tuple(np.add(camera.position_m, (0.002, 0.0, 0.0))))

    found = errors(IDEAL, [shifted(IDEAL[0]), *IDEAL[1:]], ARENA, HEIGHT_M)
    assert found["overlap_worst_mm"] == found["position_worst_mm"] == 2.0
    assert 0.0 < found["shape_rms_mm"] < found["position_rms_mm"] < 2.0


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_the_calibration_finds_is_right_to_3_mm_and_1_degree(
    seed: int, tmp_path: Path
) -> None:
    told: list[str] = []
    known = calibrate(IDEAL, ARENA, HEIGHT_M, seed, tmp_path, told.append)
    figures = known.figures
    assert figures["position_rms_mm"] <= 3.0 and figures["heading_rms_deg"] <= 1.0
    assert figures["overlap_worst_mm"] <= 1.0 and figures["shape_worst_mm"] <= 1.0
    assert "solving" in told[-1] and f"{figures['views']} pictures" in known.in_words()
    for camera in known.solved:
        text = (tmp_path / "cameras" / f"{camera.id}.json").read_text()
        assert Camera.from_json(text) == camera
