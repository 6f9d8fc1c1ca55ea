"""How precise a fitted marker is: the covariance of its place and heading.

The residuals of an outline's samples give the error of each of them; the outline's shape gives the
resulting error of place and heading. Blur adds an error of its own where white cells or the disc's
rim shine through to the edge.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsense.vision.markers.codes import BLURS_U, normal_share
from vsense.vision.markers.families import MarkerFamily, SquareFamily
from vsense.vision.tracking.outlines import EDGE_REACH_U, OutlineShape, sample_outline, shape_of

Floats = NDArray[np.float64]

LEAST_M = 1e-5
"""No fit is believed to be more precise than this [m]."""

_CORRELATION = 1.1
_BLURRED, _PER_BLUR = 0.30, 5.0
_LEAK_U = 0.9
_LEAST_COVERAGE = 0.3
"""Fitted to the errors of rendered markers of the shipped families, from sharp to hard pictures;
see `tests/vision/tracking/test_covariance.py`."""


class OutlineCovariance:
    """The precision of one family's outline."""

    def __init__(self, family: MarkerFamily | SquareFamily) -> None:
        shape = shape_of(family)
        points, normals = sample_outline(shape)
        points_m = 1e-3 * (points - shape.origin_mm)
        turn = normals[:, 1] * points_m[:, 0] - normals[:, 0] * points_m[:, 1]
        growth = (normals * points_m).sum(axis=1)
        design = np.column_stack((normals, turn, growth))
        self._shape = np.linalg.inv(design.T @ design)[:3, :3]
        self._unit_m = 1e-3 * shape.unit_mm
        gap_u = _gap_u(family, shape, points) - EDGE_REACH_U
        self._leak_m = self._unit_m * _LEAK_U * normal_share(-gap_u / BLURS_U) ** 2
        self._lever = np.eye(3)
        if isinstance(family, SquareFamily):
            # What turns about the square's middle shifts a disc's centre that lies elsewhere.
            x, y = 1e-3 * family.disc_centre_mm
            self._lever[0, 2], self._lever[1, 2] = -y, x

    def covariance(
        self, markers: NDArray[np.void], ahead: NDArray[np.intp], left: NDArray[np.intp]
    ) -> Floats:
        """Returns the covariance of x, y [m] and yaw [rad] in the arena frame, (n, 3, 3).

        `markers` are (n,) MARKER; `ahead` and `left` their blurs along and across the heading,
        (n,) indices of `codes.BLURS_U`.
        """
        blur = 0.5 * (BLURS_U[ahead] + BLURS_U[left])
        factor = _CORRELATION + _PER_BLUR * np.maximum(blur - _BLURRED, 0.0)
        sample = (factor * markers["residual_m"]) ** 2
        sample /= np.maximum(markers["coverage"], _LEAST_COVERAGE)
        covariance = sample[:, np.newaxis, np.newaxis] * self._shape
        for axis, place in enumerate((ahead, left)):
            covariance[:, axis, axis] += self._leak_m[place] ** 2 + LEAST_M**2
        covariance = self._lever @ covariance @ self._lever.T
        return turn_into_arena(covariance, markers["ahead_x"], markers["ahead_y"])


def turn_into_arena(covariance: Floats, ahead_x: Floats, ahead_y: Floats) -> Floats:
    """Turns (n, 3, 3) covariances of shifts ahead and to the left, and yaw, into the arena frame.

    `ahead_x` and `ahead_y` are the headings' unit vectors, (n,) each.
    """
    turn = np.zeros_like(covariance)
    turn[:, 0, 0], turn[:, 0, 1] = ahead_x, -ahead_y
    turn[:, 1, 0], turn[:, 1, 1] = ahead_y, ahead_x
    turn[:, 2, 2] = 1.0
    return np.asarray(turn @ covariance @ turn.transpose(0, 2, 1))


def _gap_u(family: MarkerFamily | SquareFamily, shape: OutlineShape, points_mm: Floats) -> float:
    """Returns how near to the outline white cells or the disc's rim come, in units u.

    A square's frame is one cell wide, and the rim comes near to its corners alone.
    """
    if isinstance(family, SquareFamily):
        return 1.0
    rim = 0.5 * family.disc_diameter_mm - np.hypot(*(points_mm - shape.origin_mm).T).max()
    return float(min(rim, shape.frame_mm) / family.unit_mm)
