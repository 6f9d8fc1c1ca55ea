"""How many pixels a metre of the arena takes in a picture, and what that makes of movement."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from vsense.errors import UsageError
from vsense.tracking.camera import Camera

SPEED_M_S = 0.13
"""An e-puck's greatest speed. Source: reference/epuck.md."""
_STEP_M = 0.01


@dataclass(frozen=True, slots=True)
class Scale:
    """The size of things in a picture.

    Attributes:
        px_per_m: pixels per metre, at the height of the markers.
        source: where that is known from, for the user's eyes.
    """

    px_per_m: float
    source: str


def known_scale(options: argparse.Namespace, calibration: Camera | None) -> Scale | None:
    """Gives the scale that the user tells, None where markers have to.

    Args:
        options: `px_per_m`, `focal_px` with `height_m`, and `marker_height`.
        calibration: the camera's.

    Raises:
        UsageError: one of a pair is missing.
    """
    if options.px_per_m is not None:
        return Scale(options.px_per_m, "--px-per-m")
    if (options.focal_px is None) != (options.height_m is None):
        raise UsageError("expected --focal-px together with --height-m")
    if options.focal_px is not None:
        return of_lens(options.focal_px, options.height_m)
    return None if calibration is None else of_camera(calibration, options.marker_height)


def of_camera(camera: Camera, height_m: float) -> Scale:
    """Gives the scale in the middle of a calibrated camera's picture.

    Args:
        camera: the camera.
        height_m: of the markers above the floor.
    """
    middle = np.array([(camera.width_px - 1) / 2.0, (camera.height_px - 1) / 2.0])
    x, y = camera.to_plane(middle, height_m)
    steps = [(x, y, height_m), (x + _STEP_M, y, height_m), (x, y + _STEP_M, height_m)]
    here, right, up = camera.project(np.array(steps))
    area = abs(float(np.linalg.det(np.stack((right - here, up - here)))))
    return Scale(area**0.5 / _STEP_M, f"calibration of {camera.id}")


def of_lens(focal_px: float, away_m: float) -> Scale:
    """Gives the scale of a camera that looks straight down.

    Args:
        focal_px: focal length.
        away_m: from the lens to the markers.
    """
    return Scale(focal_px / away_m, f"focal length {focal_px:g} px at {away_m:g} m")


def blur_px(exposure_us: float, speed_m_s: float, px_per_m: float) -> float:
    """Gives how far something moves in the picture while it is exposed."""
    return speed_m_s * 1e-6 * exposure_us * px_per_m
