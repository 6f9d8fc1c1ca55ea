"""The result of a calibration, its residuals, and its accuracy in the arena."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.errors import VsenseError
from vsense.vision.calibration._bundle import Sightings, lens_of, project, undistorted
from vsense.vision.calibration._views import View
from vsense.vision.calibration.board import Board
from vsense.vision.cameras.camera import Camera

_REJECT_TIMES = 3.0
_REJECT_PX = 0.5
_HUBER_TIMES = 2.5
_HUBER_PX = 0.3


class CalibrationError(VsenseError):
    """Pictures that make no calibration; says what to shoot."""


@dataclass(frozen=True, slots=True)
class ViewResult:
    """One view after the calibration; a bad one is not `used`.

    `pixels` (n, 2) are where the corners were seen, `residuals` (n, 2) seen minus model [px].
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
        notes: Remarks for the user.
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
    """Returns the length from which a residual is rather a mistake than noise."""
    # The median length of plane noise is 1.18 standard deviations.
    median = float(np.median(np.linalg.norm(residuals, axis=1)))
    return max(_HUBER_TIMES * median, _HUBER_PX)


def bad_views(view_rms_px: Floats) -> NDArray[np.bool_]:
    """Whether views are so far off that the board was misread, bent or blurred."""
    if view_rms_px.size == 0:
        return np.zeros(0, dtype=bool)
    limit = max(_REJECT_TIMES * float(np.median(view_rms_px)), _REJECT_PX)
    return np.asarray(view_rms_px > limit)


def assemble(
    views: Sequence[View], points: Sequence[Floats], cameras: Sequence[str], bodies: Sequence[str]
) -> Sightings:
    """Concatenates views for the bundle.

    `points` are per view (n, 3) in the body's frame [m]; `cameras` and `bodies` (moments) give the
    bundle's order.
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


_GRID = 7
_FARTHEST = 4.0
"""Largest distance of a place on the floor, in heights of the camera."""


@dataclass(frozen=True, slots=True)
class BoardCheck:
    """The board as the cameras see it together, without its plan.

    Attributes:
        corners: Corners that two or more cameras saw at the same moment.
        reprojection_px: Root mean square of their residuals.
        distances: Pairs of corners of the same moment.
        median_mm: Median of the absolute errors of the pairs' distances.
        sd_mm: Standard deviation of the errors.
    """

    corners: int
    reprojection_px: float
    distances: int
    median_mm: float
    sd_mm: float


def floor_sigma_m(camera: Camera, covariance: Floats) -> float:
    """Returns the worst standard deviation of a place on the floor that a camera sees.

    NaN where it sees no floor. `covariance` is (15, 15), of its turn, shift and lens.
    """
    axes = [np.linspace(0.0, size - 1.0, _GRID) for size in (camera.width_px, camera.height_px)]
    pixels = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    turn = np.reshape(camera.rotation, (3, 3))
    slopes = undistorted(lens_of(camera), pixels)
    rays = np.column_stack((slopes, np.ones(len(slopes)))) @ turn
    seen = pixels[-rays[:, 2] * _FARTHEST > np.linalg.norm(rays, axis=1)]
    if len(seen) == 0:
        return float("nan")
    floor = np.column_stack((camera.to_plane(seen, 0.0), np.zeros(len(seen))))
    points = (floor - np.array(camera.position_m)) @ turn.T
    lenses = np.broadcast_to(lens_of(camera), (len(points), 9))
    _, by_point, by_lens = project(lenses, points)
    by_camera = np.concatenate((np.cross(points[:, None], by_point), by_point, by_lens), axis=2)
    to_floor = np.linalg.inv((by_point @ turn)[:, :, :2]) @ by_camera
    spread = np.einsum("nij,jk,nlk->nil", to_floor, covariance, to_floor)
    return float(np.sqrt(np.linalg.eigvalsh(spread)[:, -1].max()))


def check_board(
    cameras: Sequence[Camera], views: Sequence[View], board: Board
) -> BoardCheck | None:
    """Triangulates all corners that several cameras saw, and measures the board with them.

    Returns None where no corner was seen by two cameras at once.
    """
    by_name = {camera.id: camera for camera in cameras}
    sights: dict[tuple[str, int], list[tuple[Camera, Floats]]] = {}
    for view in views:
        if view.camera in by_name:
            for corner, pixel in zip(view.ids.tolist(), view.pixels):
                sights.setdefault((view.moment, corner), []).append((by_name[view.camera], pixel))
    points: dict[str, dict[int, Floats]] = {}
    residuals = []
    for (moment, corner), seen in sights.items():
        if len(seen) > 1:
            point = triangulated(seen)
            points.setdefault(moment, {})[corner] = point
            residuals += [pixel - camera.project(point) for camera, pixel in seen]
    if not residuals:
        return None
    errors = np.concatenate([_distance_errors_m(spots, board) for spots in points.values()]) * 1e3
    if errors.size == 0:
        return None
    return BoardCheck(
        corners=sum(len(spots) for spots in points.values()),
        reprojection_px=rms(np.array(residuals)),
        distances=errors.size,
        median_mm=float(np.median(np.abs(errors))),
        sd_mm=float(errors.std()),
    )


def triangulated(sights: Sequence[tuple[Camera, Floats]]) -> Floats:
    """Returns the (3,) arena point nearest to its sights, each a camera and a (2,) pixel.

    Source: Hartley and Zisserman, Multiple View Geometry, 12.2: the linear method.
    """
    rows = []
    for camera, pixel in sights:
        x, y = undistorted(lens_of(camera), pixel[np.newaxis])[0]
        turn = np.reshape(camera.rotation, (3, 3))
        matrix = np.column_stack((turn, -turn @ np.array(camera.position_m)))
        rows += [x * matrix[2] - matrix[0], y * matrix[2] - matrix[1]]
    point = np.linalg.svd(np.array(rows))[2][-1]
    return np.asarray(point[:3] / point[3])


def _distance_errors_m(corners: dict[int, Floats], board: Board) -> Floats:
    """Measured minus printed distance of every pair of corners."""
    first, second = np.triu_indices(len(corners), 1)
    places, plan = np.array(list(corners.values())), board.points_m[list(corners)]
    measured = np.linalg.norm(places[first] - places[second], axis=1)
    return np.asarray(measured - np.linalg.norm(plan[first] - plan[second], axis=1))
