"""Where robots are in the pictures: arena poses put back through the cameras.

Thesis, 2.2: an ArenaElement has a position and an orientation in the image, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.tracking.camera import Camera

_AHEAD_M = 0.01


class ImagePoses:
    """Finds for each robot the picture that shows it best."""

    def __init__(self, cameras: Sequence[Camera], heights_m: Mapping[int, float]) -> None:
        """Takes the arena's cameras and the height of each tag's marker."""
        self._cameras = list(cameras)
        self._heights_m = dict(heights_m)

    def __call__(self, robots: NDArray[np.void]) -> NDArray[np.float64]:
        """Returns robots' poses in the picture whose middle they are nearest to.

        Args:
            robots: (n,) POSE.

        Returns:
            (n, 3) column and row of the disc's centre [px], and the heading in the picture
            [degrees], counter-clockwise in (-180, 180] and 0 to the right.
        """
        height = [self._heights_m.get(int(tag), 0.0) for tag in robots["tag"]]
        place = np.stack((robots["x_m"], robots["y_m"], np.array(height, dtype=float)), axis=-1)
        yaw = robots["yaw_rad"]
        ahead = np.stack((np.cos(yaw), np.sin(yaw), np.zeros(len(robots))), axis=-1)
        best = np.zeros((len(robots), 3))
        nearest = np.full(len(robots), np.inf)
        for camera in self._cameras:
            at_px = camera.project(place)
            along = camera.project(place + _AHEAD_M * ahead) - at_px
            size = np.array((camera.width_px, camera.height_px))
            off = np.abs((at_px + 0.5) / size - 0.5).max(axis=1)
            theta = -np.degrees(np.arctan2(along[:, 1], along[:, 0]))
            theta = np.where(theta <= -180.0, theta + 360.0, theta)
            better = off < nearest
            nearest[better] = off[better]
            best[better] = np.column_stack((at_px, theta))[better]
        return best
