"""How large things are in the picture, from whatever tells it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tools.camera_setup.stage import CALIBRATION, PX_PER_M, options
from vsense.base.errors import UsageError
from vsense.tools.camera_setup._advice import blur_px
from vsense.tools.camera_setup.tuning import known_scale
from vsense.vision.cameras.camera import Camera


def test_blur_is_the_way_during_the_exposure() -> None:
    # 12 cm/s, 10 ms, 1.5 mm/px are 0.8 px. Source: reference/tracking.md, section 1.
    assert blur_px(10_000.0, 0.12, 1000.0 / 1.5) == pytest.approx(0.8)


def test_calibration_tells_the_scale_at_the_markers() -> None:
    scale = known_scale(options(), CALIBRATION)
    assert scale is not None and scale.px_per_m == pytest.approx(PX_PER_M, rel=1e-3)
    assert scale.source == "calibration of c"


def test_distortion_and_tilt_change_it_a_little_only() -> None:
    turn = np.radians(10.0)
    c, s = float(np.cos(turn)), float(np.sin(turn))
    tilted = (1.0, 0.0, 0.0, 0.0, -c, -s, 0.0, s, -c)
    camera = Camera("t", 640, 480, 1400.0, 1400.0, 319.5, 239.5, (-0.1, 0.02, 0, 0, 0), tilted,
                    (0.0, 0.0, 2.06))  # fmt: skip
    scale = known_scale(options(), camera)
    assert scale is not None and scale.px_per_m == pytest.approx(PX_PER_M, rel=0.05)


def test_the_user_knows_best() -> None:
    scale = known_scale(options(px_per_m=500.0, focal_px=1.0, height_m=1.0), CALIBRATION)
    assert scale is not None and (scale.px_per_m, scale.source) == (500.0, "--px-per-m")


def test_focal_length_and_height_go_together() -> None:
    scale = known_scale(options(focal_px=1600.0, height_m=2.0), None)
    assert scale is not None and scale.px_per_m == 800.0
    assert scale.source == "focal length 1600 px at 2 m"
    for half in ({"focal_px": 1600.0}, {"height_m": 2.0}):
        with pytest.raises(UsageError, match=r"--focal-px.*--height-m"):
            known_scale(options(**half), None)


def test_otherwise_markers_have_to_tell() -> None:
    assert known_scale(options(), None) is None
