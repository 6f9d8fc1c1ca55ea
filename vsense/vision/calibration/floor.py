"""The arena frame: a board on the floor, or points whose places are known."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from vsense.base.errors import ConfigError, UsageError
from vsense.vision.calibration.board import dictionary_name
from vsense.vision.calibration.placement import BoardPose
from vsense.vision.calibration.views import View, number_at, read_table
from vsense.vision.cameras.camera import Floats
from vsense.vision.cameras.picture import Image

POINT_COLUMNS = ("id", "x_m", "y_m", "z_m")
SEEN_COLUMNS = ("camera", "id", "x_px", "y_px")
POINT_SIGMA_M = 0.001
"""Of points measured by tape."""


@dataclass(frozen=True, slots=True)
class FloorReference:
    """What ties the pictures to the arena frame.

    Attributes:
        flat: Name patterns of the moments when the board lay on the floor, as in file names.
        origin: Place of the board's origin at the first of them: x, y [m] and yaw [rad].
        thickness_m: Height of the board's printed face above the floor.
        points_m: Name -> (3,) place of a known point.
        sightings: One per camera and known point, whose name is the moment.
        sigma_m: Standard deviation of the points' places.
    """

    flat: tuple[str, ...] = ()
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    thickness_m: float = 0.0
    points_m: dict[str, Floats] = field(default_factory=dict)
    sightings: tuple[View, ...] = ()
    sigma_m: float = POINT_SIGMA_M

    def moments(self, views: Sequence[View]) -> list[str]:
        """The floor's moments by pattern and name; raises UsageError if a pattern matches none."""
        names = sorted({view.moment for view in views})
        chosen: list[str] = []
        for pattern in self.flat:
            matching = fnmatch.filter(names, pattern)
            if not matching:
                some = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
                raise UsageError(
                    f"--floor {pattern}: the board was found at no such moment; there are: {some}"
                )
            chosen += [name for name in matching if name not in chosen]
        return chosen

    def flattened(self, pose: BoardPose) -> BoardPose:
        """A pose laid down on the floor."""
        yaw = math.atan2(pose.turn[1, 0], pose.turn[0, 0])
        return self.lying(pose.shift[0], pose.shift[1], yaw)

    def lying(self, x: float, y: float, yaw: float) -> BoardPose:
        """The pose of a board that lies at x, y [m] and yaw [rad]."""
        cos, sin = math.cos(yaw), math.sin(yaw)
        turn = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
        return BoardPose(turn, np.array((x, y, self.thickness_m)))


def read_points(path: Path) -> dict[str, Floats]:
    """Reads a file of known points, `id,x_m,y_m,z_m`; raises UsageError or ConfigError."""
    points: dict[str, Floats] = {}
    for line, (id, *place) in read_table(path, POINT_COLUMNS):
        if id in points:
            raise ConfigError(str(path), line, f"id: {id} is there twice")
        values = [number_at(path, line, n, text) for n, text in zip(POINT_COLUMNS[1:], place)]
        points[id] = np.array(values)
    if len(points) < 4:
        raise ConfigError(str(path), 1, f"{len(points)} points: expected 4 or more")
    return points


def read_seen(path: Path, points: dict[str, Floats], cameras: Sequence[str]) -> list[View]:
    """Reads where cameras see known points: `camera,id,x_px,y_px`; raises as `read_points`."""
    seen: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for line, (camera, id, *place) in read_table(path, SEEN_COLUMNS):
        if camera not in cameras:
            raise ConfigError(str(path), line, f"camera: '{camera}': expected {', '.join(cameras)}")
        if id not in points:
            raise ConfigError(str(path), line, f"id: '{id}' is not among the known points")
        x, y = (number_at(path, line, n, text) for n, text in zip(SEEN_COLUMNS[2:], place))
        seen.setdefault((camera, id), []).append((x, y))
    return [_point_view(camera, id, pixels) for (camera, id), pixels in sorted(seen.items())]


class TagFinder:
    """Finds the middles of ArUco or AprilTag markers that lie at known places."""

    def __init__(self, dictionary: str, ids: Sequence[str]) -> None:
        """Prepares OpenCV's detector; raises UsageError for an unknown id or dictionary."""
        wrong = [id for id in ids if not id.isdecimal()]
        if wrong:
            raise UsageError(f"--tags: known point '{wrong[0]}': expected the number of a tag")
        self._ids = set(ids)
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        name = f"DICT_{dictionary_name(dictionary)}"
        family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        self._detector = cv2.aruco.ArucoDetector(family, parameters)

    def find(self, image: Image) -> dict[str, Floats]:
        """Returns tag -> (2,) pixel of its middle; tags that are there twice are left out."""
        corners, ids, _ = self._detector.detectMarkers(image)
        names = [] if ids is None else [str(id) for id in ids.ravel()]
        return {
            name: _middle(np.asarray(square, dtype=np.float64).reshape(4, 2))
            for name, square in zip(names, corners)
            if name in self._ids and names.count(name) == 1
        }


def tag_views(found: Sequence[tuple[str, dict[str, Floats]]]) -> list[View]:
    """Combines the tags found in pictures of all cameras to one view per camera and tag."""
    seen: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for camera, tags in found:
        for id, (x, y) in tags.items():
            seen.setdefault((camera, id), []).append((x, y))
    # The tags do not move, so the median of all pictures is better than any of them.
    medians = {key: np.median(pixels, axis=0) for key, pixels in seen.items()}
    return [_point_view(c, id, [tuple(px.tolist())]) for (c, id), px in sorted(medians.items())]


def _point_view(camera: str, id: str, pixels: Sequence[tuple[float, ...]]) -> View:
    return View(camera, f"point {id}", np.zeros(len(pixels), np.int64), np.array(pixels))


def _middle(square: Floats) -> Floats:
    """The crossing of the diagonals, which perspective preserves."""
    first, second = square[2] - square[0], square[3] - square[1]
    along = np.linalg.solve(np.column_stack((first, -second)), square[1] - square[0])
    return np.asarray(square[0] + along[0] * first)
