"""Markers that do not sit on the middle of their robots: from the marker's pose to the robot's.

A marker that was put on by hand is some millimetres off the middle of the wheels' axle, and turned
by some degrees. With c, s the cosine and sine of the robot's heading and (x, y, yaw) the marker's
offset in the robot's frame, x forward and y left:

    robot's yaw = marker's yaw - yaw
    robot's x   = marker's x - (c x - s y)
    robot's y   = marker's y - (s x + c y)

The covariance follows with the derivatives of these (first order).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import wrap_angle

Floats = NDArray[np.float64]


class PlacedMarker(Protocol):
    """A marker's place in its robot's frame: its centre [m] and its heading [rad]."""

    @property
    def x_m(self) -> float: ...

    @property
    def y_m(self) -> float: ...

    @property
    def yaw_rad(self) -> float: ...


class MarkerOffsets:
    """The offsets of some tags' markers; those of all others are nothing."""

    def __init__(self, offsets: Mapping[int, PlacedMarker]) -> None:
        """`offsets` are by tag."""
        known = sorted(offsets.items())
        self._tags = np.array([tag for tag, _ in known], dtype=np.int64)
        rows = [(marker.x_m, marker.y_m, marker.yaw_rad) for _, marker in known]
        self._places = np.array(rows, dtype=np.float64).reshape(-1, 3)

    def to_robots(self, views: NDArray[np.void]) -> NDArray[np.void]:
        """Returns (n,) VIEW of robots from those of their markers."""
        rows, places = self._of(views["tag"])
        if len(rows) == 0:
            return views
        moved: NDArray[np.void] = views.copy()
        yaw_rad = wrap_angle(views["yaw_rad"][rows] - places[:, 2])
        arm_x, arm_y = turned(places, yaw_rad)
        moved["x_m"][rows] -= arm_x
        moved["y_m"][rows] -= arm_y
        moved["yaw_rad"][rows] = yaw_rad
        moved["covariance"][rows] = _carried(views["covariance"][rows], arm_y, -arm_x)
        return moved

    def to_markers(self, poses: NDArray[np.void]) -> NDArray[np.void]:
        """Returns (n,) rows with tag, x_m, y_m and yaw_rad of markers from those of robots."""
        rows, places = self._of(poses["tag"])
        if len(rows) == 0:
            return poses
        moved: NDArray[np.void] = poses.copy()
        arm_x, arm_y = turned(places, poses["yaw_rad"][rows])
        moved["x_m"][rows] += arm_x
        moved["y_m"][rows] += arm_y
        moved["yaw_rad"][rows] = wrap_angle(poses["yaw_rad"][rows] + places[:, 2])
        return moved

    def _of(self, tags: NDArray[np.integer]) -> tuple[NDArray[np.intp], Floats]:
        """The rows of `tags` whose offsets are known, and these (k, 3)."""
        if len(self._tags) == 0:
            return np.zeros(0, dtype=np.intp), np.zeros((0, 3))
        wanted = tags.astype(np.int64)
        place = np.minimum(np.searchsorted(self._tags, wanted), len(self._tags) - 1)
        rows = np.flatnonzero(self._tags[place] == wanted)
        return rows, self._places[place[rows]]


def turned(places: Floats, yaw_rad: Floats) -> tuple[Floats, Floats]:
    """Markers' places (k, 3) in the arena's directions: (k,) x and y [m] from their robots."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return cos * places[:, 0] - sin * places[:, 1], sin * places[:, 0] + cos * places[:, 1]


def _carried(covariance: Floats, by_x: Floats, by_y: Floats) -> Floats:
    """Covariances (k, 6) of x, y, yaw where x and y [m] go with the yaw's error by so much."""
    xx, xy, xt, yy, yt, tt = covariance.T
    return np.stack(
        (
            xx + 2.0 * by_x * xt + by_x**2 * tt,
            xy + by_x * yt + by_y * xt + by_x * by_y * tt,
            xt + by_x * tt,
            yy + 2.0 * by_y * yt + by_y**2 * tt,
            yt + by_y * tt,
            tt,
        ),
        axis=-1,
    )
