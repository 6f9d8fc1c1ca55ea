"""First guesses: the pose of a board in one picture, and a lens of which nothing is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.calibration.lens import LENS_SIZE, project, undistorted

Floats = NDArray[np.float64]

_FOCAL_SHARES = np.geomspace(0.4, 5.0, 16)
"""Focal lengths that are tried, over the picture's width: 100 to 11 degrees of view."""
_PATIENCE_PX = 100.0
"""A point that is further off counts no more than this."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a body is: `turn @ point + shift` takes its points to another frame.

    Attributes:
        turn: (3, 3) rotation.
        shift: (3,) [m].
    """

    turn: Floats
    shift: Floats

    def inverse(self) -> Pose:
        """The way back."""
        return Pose(self.turn.T, -self.turn.T @ self.shift)

    def after(self, first: Pose) -> Pose:
        """This pose behind another: first `first`, then this one."""
        return Pose(self.turn @ first.turn, self.turn @ first.shift + self.shift)

    def apply(self, points: Floats) -> Floats:
        """Takes (n, 3) points along."""
        return np.asarray(points @ self.turn.T + self.shift)


def poses_in_camera(lens: Floats, points: Floats, pixels: Floats) -> list[Pose]:
    """Returns the poses of a body that one picture allows, the best first.

    A flat body far away looks nearly the same tilted to either side: then there are two.

    Args:
        lens: (9,).
        points: (n, 3) in the body's frame, 4 or more.
        pixels: (n, 2).
    """
    flat = bool(np.ptp(points[:, 2]) == 0.0)
    # Slopes grow without bounds where the model of the lens is bent back on itself.
    slopes = np.clip(np.nan_to_num(undistorted(lens, pixels)), -20.0, 20.0)
    method = cv2.SOLVEPNP_IPPE if flat else cv2.SOLVEPNP_SQPNP
    try:
        _, turns, shifts, _ = cv2.solvePnPGeneric(points, slopes, np.eye(3), None, flags=method)
    except cv2.error:
        return []
    poses = [
        Pose(np.asarray(cv2.Rodrigues(t)[0], np.float64), np.asarray(s, np.float64).ravel())
        for t, s in zip(turns, shifts)
    ]
    good = [p for p in poses if np.all(np.isfinite(p.turn)) and np.all(np.isfinite(p.shift))]
    return sorted(good, key=lambda pose: miss_px(lens, pose, points, pixels))


def miss_px(lens: Floats, pose: Pose, points: Floats, pixels: Floats) -> float:
    """Root mean square distance of pixels from where a pose in the camera puts the points."""
    seen = project(np.broadcast_to(lens, (len(points), LENS_SIZE)), pose.apply(points))[0]
    squared = np.minimum(((seen - pixels) ** 2).sum(axis=1), _PATIENCE_PX**2)
    return float(np.sqrt(squared.mean()))


def first_lens(size: tuple[int, int], sights: Sequence[tuple[Floats, Floats]]) -> Floats:
    """Guesses a lens without distortion.

    Args:
        size: Width and height [px].
        sights: Points and pixels, as in `poses_in_camera`, of each picture.

    Returns:
        (9,) the lens that explains the pictures best, of those that are tried.
    """
    middle = ((size[0] - 1) / 2.0, (size[1] - 1) / 2.0)
    best, least = np.zeros(LENS_SIZE), np.inf
    for share in _FOCAL_SHARES:
        focal = share * size[0]
        lens = np.array([focal, focal, *middle, 0.0, 0.0, 0.0, 0.0, 0.0])
        misses = []
        for points, pixels in sights:
            poses = poses_in_camera(lens, points, pixels)
            misses.append(miss_px(lens, poses[0], points, pixels) if poses else _PATIENCE_PX)
        total = float(np.sum(np.square(misses)))
        if total < least:
            best, least = lens, total
    return best
