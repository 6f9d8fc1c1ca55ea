"""Where robots are in the pictures.

Thesis, 2.2: an ArenaElement has a position and an orientation in the image, too. What the cameras
see is kept as it was seen; for clients that ask for one image pose of every robot, arena poses are
put back through the cameras.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.arena import IMAGE_POSE
from vsense.tracking.camera import Camera
from vsense.tracking.views import Placed

Floats = NDArray[np.float64]

_AHEAD_M = 0.01


def image_poses(place: int, camera: Camera, placed: Placed) -> NDArray[np.void]:
    """Returns one camera's named detections as IMAGE_POSE rows, sorted by tag.

    Args:
        place: The camera's place in the arena state's `cameras`.
        camera: The camera.
        placed: What it sees.
    """
    rows, height_m, ground_m = placed
    poses = np.zeros(len(rows), dtype=IMAGE_POSE)
    if len(poses) == 0:
        return poses
    at_px = np.stack((rows["x_px"], rows["y_px"]), axis=-1)
    points = np.column_stack((ground_m, height_m))
    poses["tag"], poses["camera"] = rows["tag"], place
    poses["x_px"], poses["y_px"] = at_px.T
    poses["yaw_px_rad"] = _heading_px_rad(camera, points, at_px, rows["yaw_rad"])
    poses["x_m"], poses["y_m"] = ground_m.T
    poses["yaw_rad"] = rows["yaw_rad"]
    return poses


class ImagePoses:
    """Finds for each robot the picture that shows it best."""

    def __init__(self, cameras: Sequence[Camera], heights_m: Mapping[int, float]) -> None:
        """Takes the arena's cameras and the height of each tag's marker."""
        self._cameras = list(cameras)
        self._heights_m = dict(heights_m)

    def learn(self, heights_m: Mapping[int, float]) -> None:
        """Takes the heights of tags that have joined, too; any thread."""
        self._heights_m.update(heights_m)

    def __call__(self, robots: NDArray[np.void]) -> Floats:
        """Returns robots' poses in the picture whose middle they are nearest to.

        Args:
            robots: (n,) POSE.

        Returns:
            (n, 3) column and row of the disc's centre [px], and the heading in the picture
            [degrees], counter-clockwise in (-180, 180] and 0 to the right.
        """
        height = [self._heights_m.get(int(tag), 0.0) for tag in robots["tag"]]
        place = np.stack((robots["x_m"], robots["y_m"], np.array(height, dtype=float)), axis=-1)
        best = np.zeros((len(robots), 3))
        nearest = np.full(len(robots), np.inf)
        for camera in self._cameras:
            at_px = camera.project(place)
            theta = np.degrees(_heading_px_rad(camera, place, at_px, robots["yaw_rad"]))
            size = np.array((camera.width_px, camera.height_px))
            off = np.abs((at_px + 0.5) / size - 0.5).max(axis=1)
            better = off < nearest
            nearest[better] = off[better]
            best[better] = np.column_stack((at_px, theta))[better]
        return best


def _heading_px_rad(camera: Camera, points_m: Floats, at_px: Floats, yaw_rad: Floats) -> Floats:
    """Returns headings as a picture shows them, counter-clockwise in (-pi, pi], 0 to the right.

    Args:
        camera: The camera.
        points_m: (n, 3) the discs' centres in the arena.
        at_px: (n, 2) the same in the picture.
        yaw_rad: (n,) headings in the arena.
    """
    ahead = np.stack((np.cos(yaw_rad), np.sin(yaw_rad), np.zeros(len(points_m))), axis=-1)
    along = camera.project(points_m + _AHEAD_M * ahead) - at_px
    theta = -np.arctan2(along[:, 1], along[:, 0])
    return np.asarray(np.where(theta <= -np.pi, theta + 2.0 * np.pi, theta))
