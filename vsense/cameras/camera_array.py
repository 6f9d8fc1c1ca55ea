"""Many cameras at once: what `Camera` computes, for points that belong to different cameras.

NumPy's calls cost more than their work on the few points of one picture; here all pictures of a
timestep share them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.cameras.camera import Camera, distort, undistort

Floats = NDArray[np.float64]
Places = NDArray[np.intp]


class CameraArray:
    """Cameras, each known by its place among them.

    Attributes:
        cameras: The cameras.
        position_m: (c, 3) their centres in the arena frame.
        size_px: (c, 2) width and height of their pictures.
    """

    def __init__(self, cameras: Sequence[Camera]) -> None:
        self.cameras = tuple(cameras)
        self.position_m = np.array([c.position_m for c in cameras], dtype=np.float64)
        self.size_px = np.array([(c.width_px, c.height_px) for c in cameras], dtype=np.float64)
        self._focal_px = np.array([(c.fx_px, c.fy_px) for c in cameras])
        self._centre_px = np.array([(c.cx_px, c.cy_px) for c in cameras])
        self._rotation = np.array([c.rotation for c in cameras]).reshape(-1, 3, 3)
        self._distortion = np.array([c.distortion for c in cameras])

    def project(self, points_m: Floats, camera: Places) -> Floats:
        """Returns the (n, 2) pixels of (n, 3) arena points, each in a camera's picture.

        `camera` is (n,) the cameras' places; the points are in front of them.
        """
        away = points_m - self.position_m[camera]
        seen = np.einsum("nij,nj->in", self._rotation[camera], away)
        x, y = distort(seen[0] / seen[2], seen[1] / seen[2], self._distortion[camera].T)
        flat = np.stack((x, y), axis=-1)
        return np.asarray(self._focal_px[camera] * flat + self._centre_px[camera])

    def to_plane(self, points_px: Floats, height_m: Floats, camera: Places) -> Floats:
        """Returns arena x and y [m] of what (n, 2) pixels show of horizontal planes, (n, 2).

        `height_m` is (n,) the planes' heights above the floor, `camera` (n,) the cameras' places.
        """
        flat = (points_px - self._centre_px[camera]) / self._focal_px[camera]
        x, y = undistort(flat[:, 0], flat[:, 1], self._distortion[camera].T)
        rays = np.einsum(
            "nj,nji->ni", np.stack((x, y, np.ones_like(x)), axis=-1), self._rotation[camera]
        )
        centre = self.position_m[camera]
        reach = (height_m - centre[:, 2]) / rays[:, 2]
        return np.asarray(centre[:, :2] + reach[:, np.newaxis] * rays[:, :2])
