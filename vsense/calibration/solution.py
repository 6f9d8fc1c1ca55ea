"""What a calibration found, and how well it explains every view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.calibration.bundle import Sightings
from vsense.calibration.views import View
from vsense.errors import VsenseError
from vsense.tracking.camera import Camera

Floats = NDArray[np.float64]

_REJECT_TIMES = 3.0
_REJECT_PX = 0.5
_HUBER_TIMES = 2.5
_HUBER_PX = 0.3


class CalibrationError(VsenseError):
    """Pictures that make no calibration; says what to shoot."""


@dataclass(frozen=True, slots=True)
class ViewResult:
    """One view after the calibration.

    Attributes:
        camera: The camera's name.
        moment: The moment's name.
        pixels: (n, 2) where the corners were seen.
        residuals: (n, 2) seen minus model [px].
        used: Whether the view took part; a bad one is left out.
    """

    camera: str
    moment: str
    pixels: Floats
    residuals: Floats
    used: bool

    @property
    def rms_px(self) -> float:
        """Root mean square length of the residuals."""
        return rms(self.residuals)


@dataclass(frozen=True, slots=True)
class Solution:
    """The result of a calibration.

    Attributes:
        cameras: In order of their names.
        views: All views, also those left out.
        lens_sigma: Camera -> (9,) standard deviation of its lens's numbers.
        floor_sigma_m: Camera -> worst standard deviation of a place on the floor that it sees;
            empty where only lenses are calibrated.
        bodies: Moment -> turn (3, 3) and shift (3,) of the board in the arena frame.
        notes: What the user should know.
    """

    cameras: tuple[Camera, ...]
    views: tuple[ViewResult, ...]
    lens_sigma: dict[str, Floats]
    floor_sigma_m: dict[str, float]
    bodies: dict[str, tuple[Floats, Floats]]
    notes: tuple[str, ...]

    def of(self, camera: str) -> list[ViewResult]:
        """The views of one camera that took part."""
        return [view for view in self.views if view.camera == camera and view.used]

    @property
    def rms_px(self) -> float:
        """Root mean square length of all residuals that took part."""
        return rms(np.concatenate([view.residuals for view in self.views if view.used]))

    @property
    def rejected(self) -> list[ViewResult]:
        """The views left out."""
        return [view for view in self.views if not view.used]


def rms(residuals: Floats) -> float:
    """Root mean square length of (n, 2) residuals."""
    return float(np.sqrt((residuals**2).sum(axis=-1).mean())) if residuals.size else 0.0


def huber_limit_px(residuals: Floats) -> float:
    """Beyond this length a residual is rather a mistake than noise."""
    # The median length of plane noise is 1.18 standard deviations.
    median = float(np.median(np.linalg.norm(residuals, axis=1)))
    return max(_HUBER_TIMES * median, _HUBER_PX)


def bad_views(view_rms_px: Floats) -> NDArray[np.bool_]:
    """Tells which views are so far off that the board was found wrongly, bent or blurred."""
    if view_rms_px.size == 0:
        return np.zeros(0, dtype=bool)
    limit = max(_REJECT_TIMES * float(np.median(view_rms_px)), _REJECT_PX)
    return np.asarray(view_rms_px > limit)


def assemble(
    views: Sequence[View], points: Sequence[Floats], cameras: Sequence[str], bodies: Sequence[str]
) -> Sightings:
    """Lays views side by side, for the bundle.

    Args:
        views: What was seen.
        points: Per view (n, 3), the places of what was seen in the body's frame [m].
        cameras: Names, in the bundle's order.
        bodies: Moments, in the bundle's order.
    """
    camera = {name: number for number, name in enumerate(cameras)}
    body = {name: number for number, name in enumerate(bodies)}
    return Sightings(
        np.array([camera[view.camera] for view in views], dtype=np.int64),
        np.array([body[view.moment] for view in views], dtype=np.int64),
        np.cumsum([0] + [len(view.ids) for view in views]),
        np.concatenate(points),
        np.concatenate([view.pixels for view in views]),
    )


def by_view(rows: Floats, seen: Sightings) -> list[Floats]:
    """Cuts rows, one per point, into one array per view."""
    return np.split(rows, seen.start[1:-1])
