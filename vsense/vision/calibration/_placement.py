"""First guesses for the bundle: lenses, and the poses of cameras and boards.

Cameras and boards are placed one after another, each by what it shares with those before. The
bundle then spreads the accumulated errors over all cameras.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from vsense.base.arena import Floats, Image
from vsense.base.errors import ConfigError, UsageError
from vsense.vision.calibration._bundle import LENS_SIZE, project, undistorted
from vsense.vision.calibration._solution import CalibrationError
from vsense.vision.calibration._views import View, number_at, read_table
from vsense.vision.calibration.frame import BoardPose
from vsense.vision.markers._dictionary import dictionary_name

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
                shown = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
                raise UsageError(
                    f"--floor {pattern}: the board was found at no such moment; there are: {shown}"
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
    points = places_by_id(path, read_table(path, POINT_COLUMNS), POINT_COLUMNS[1:])
    if len(points) < 4:
        raise ConfigError(str(path), 1, f"{len(points)} points: expected 4 or more")
    return points


def places_by_id(
    path: Path, rows: Iterable[tuple[int, list[str]]], columns: Sequence[str]
) -> dict[str, Floats]:
    """Places (3,) from rows of id and coordinates; raises ConfigError. Without z they lie at 0."""
    places: dict[str, Floats] = {}
    for line, (id, *place) in rows:
        if id in places:
            raise ConfigError(str(path), line, f"id: {id} is there twice")
        values = [number_at(path, line, name, text) for name, text in zip(columns, place)]
        places[id] = np.array([*values, 0.0][:3])
    return places


def read_pixels(
    path: Path, points: Collection[str], cameras: Collection[str], known: str
) -> Iterator[tuple[str, str, tuple[float, float]]]:
    """Yields camera, point and pixel of a file `camera,id,x_px,y_px`; `known` names the points.

    Raises UsageError or ConfigError.
    """
    for line, (camera, id, *place) in read_table(path, SEEN_COLUMNS):
        if camera not in cameras:
            raise ConfigError(str(path), line, f"camera: '{camera}': expected {', '.join(cameras)}")
        if id not in points:
            raise ConfigError(str(path), line, f"id: '{id}' is not among {known}")
        x, y = (number_at(path, line, n, text) for n, text in zip(SEEN_COLUMNS[2:], place))
        yield camera, id, (x, y)


def read_seen(path: Path, points: dict[str, Floats], cameras: Sequence[str]) -> list[View]:
    """Reads where cameras see known points: `camera,id,x_px,y_px`; raises as `read_points`."""
    seen: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for camera, id, pixel in read_pixels(path, points, cameras, "the known points"):
        seen.setdefault((camera, id), []).append(pixel)
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


def tag_views(pictures: Sequence[tuple[str, dict[str, Floats]]]) -> list[View]:
    """Combines the tags found in pictures of all cameras to one view per camera and tag."""
    seen: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for camera, tags in pictures:
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


_FOCAL_SHARES = np.geomspace(0.4, 5.0, 16)
"""Focal lengths that are tried, over the picture's width: 100 to 11 degrees of view."""
_PATIENCE_PX = 100.0
"""Points that are further off count as this."""


def poses_in_camera(lens: Floats, points: Floats, pixels: Floats) -> list[BoardPose]:
    """Returns the poses of a body that one picture allows, the best first.

    A flat body far away looks nearly the same tilted to either side: then there are two. `lens` is
    (9,), `points` are (n, 3) in the body's frame, 4 or more, `pixels` (n, 2).
    """
    flat = bool(np.ptp(points[:, 2]) == 0.0)
    # Slopes grow without bounds where the lens model is not invertible.
    slopes = np.clip(np.nan_to_num(undistorted(lens, pixels)), -20.0, 20.0)
    method = cv2.SOLVEPNP_IPPE if flat else cv2.SOLVEPNP_SQPNP
    try:
        _, turns, shifts, _ = cv2.solvePnPGeneric(points, slopes, np.eye(3), None, flags=method)
    except cv2.error:
        return []
    poses = [
        BoardPose(np.asarray(cv2.Rodrigues(t)[0], np.float64), np.asarray(s, np.float64).ravel())
        for t, s in zip(turns, shifts)
    ]
    good = [p for p in poses if np.all(np.isfinite(p.turn)) and np.all(np.isfinite(p.shift))]
    return sorted(good, key=lambda pose: miss_px(lens, pose, points, pixels))


def miss_px(lens: Floats, pose: BoardPose, points: Floats, pixels: Floats) -> float:
    """Root mean square distance of pixels from where a pose in the camera puts the points."""
    seen = project(np.broadcast_to(lens, (len(points), LENS_SIZE)), pose.apply(points))[0]
    squared = np.minimum(((seen - pixels) ** 2).sum(axis=1), _PATIENCE_PX**2)
    return float(np.sqrt(squared.mean()))


def first_lens(size: tuple[int, int], sights: Sequence[tuple[Floats, Floats]]) -> Floats:
    """Returns the (9,) lens without distortion, of some tried, that explains pictures best.

    `size` is width and height [px]; `sights` are points and pixels of each picture, as in
    `poses_in_camera`.
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


_LEAST_POINTS = 4
_CANDIDATES, _JUDGES = 12, 40
"""How many of the fullest views propose a camera's pose, and how many select the best."""


@dataclass(slots=True)
class Placement:
    """Poses so far: cameras from the arena to their frame, bodies by moment to the arena."""

    cameras: dict[str, BoardPose] = field(default_factory=dict)
    bodies: dict[str, BoardPose] = field(default_factory=dict)


class Placer:
    """Places a whole rig."""

    def __init__(
        self, lenses: dict[str, Floats], views: Sequence[View], points: Sequence[Floats]
    ) -> None:
        """Estimates the poses of every view by itself.

        `lenses` are camera -> (9,), `points` per view the (n, 3) corners in the board's frame [m].
        """
        self._lenses = lenses
        self._views = list(views)
        self._points = list(points)
        self._alone = [
            poses_in_camera(lenses[v.camera], p, v.pixels) for v, p in zip(views, points)
        ]

    def place(self, done: Placement) -> None:
        """Adds all poses linked to placed ones; raises CalibrationError if some are not."""
        anchored = dict(done.bodies)
        while True:
            self._place_bodies(done, anchored)
            waiting = self._links(done)
            if not waiting:
                break
            camera = max(sorted(waiting), key=lambda name: waiting[name])
            done.cameras[camera] = self._camera_pose(camera, done)
        left = sorted(set(self._lenses) - set(done.cameras))
        if left:
            raise CalibrationError(self._unlinked(left))

    def _links(self, done: Placement) -> dict[str, int]:
        """Cameras to be placed -> corners that they see on boards that are placed."""
        links: dict[str, int] = {}
        for view, alone in zip(self._views, self._alone):
            if view.camera not in done.cameras and view.moment in done.bodies and alone:
                links[view.camera] = links.get(view.camera, 0) + len(view.ids)
        return links

    def _place_bodies(self, done: Placement, anchored: dict[str, BoardPose]) -> None:
        """Places every board that placed cameras see where it fits all of them best."""
        seen: dict[str, list[int]] = {}
        for number, view in enumerate(self._views):
            if view.camera in done.cameras and view.moment not in anchored:
                seen.setdefault(view.moment, []).append(number)
        for moment, numbers in seen.items():
            candidates = [
                done.cameras[self._views[n].camera].inverse().after(pose)
                for n in numbers
                for pose in self._alone[n]
            ]
            if candidates:
                done.bodies[moment] = min(
                    candidates, key=lambda body: self._miss(numbers, done.cameras, {moment: body})
                )

    def _camera_pose(self, camera: str, done: Placement) -> BoardPose:
        """The pose that fits all placed boards that a camera sees best."""
        numbers = [
            n
            for n, view in enumerate(self._views)
            if view.camera == camera and view.moment in done.bodies and self._alone[n]
        ]
        numbers = sorted(numbers, key=lambda n: -len(self._views[n].ids))[:_JUDGES]
        candidates = [
            pose.after(done.bodies[self._views[n].moment].inverse())
            for n in numbers[:_CANDIDATES]
            for pose in self._alone[n]
        ]
        return min(candidates, key=lambda pose: self._miss(numbers, {camera: pose}, done.bodies))

    def _miss(
        self, numbers: Sequence[int], cameras: dict[str, BoardPose], bodies: dict[str, BoardPose]
    ) -> float:
        """How far off some views are if cameras and boards are there [px, summed]."""
        total = 0.0
        for view, points in ((self._views[n], self._points[n]) for n in numbers):
            pose = cameras[view.camera].after(bodies[view.moment])
            total += miss_px(self._lenses[view.camera], pose, points, view.pixels)
        return total

    def _unlinked(self, left: Sequence[str]) -> str:
        blind = [c for c in left if all(view.camera != c for view in self._views)]
        if blind:
            return (
                f"{', '.join(blind)}: the board was found in none of the pictures, and no "
                f"{_LEAST_POINTS} known points are seen; one of both is needed"
            )
        groups = " | ".join(", ".join(group) for group in self.groups())
        return (
            f"these groups of cameras never see the board at the same moment: {groups}; lay it "
            "where cameras of both groups see it, and take a picture with all of them"
        )

    def groups(self) -> list[list[str]]:
        """Cameras that are linked by common moments, group by group."""
        group = {camera: {camera} for camera in self._lenses}
        first: dict[str, str] = {}
        for view in self._views:
            other = first.setdefault(view.moment, view.camera)
            if group[other] is not group[view.camera]:
                merged = group[other] | group[view.camera]
                group.update(dict.fromkeys(merged, merged))
        return sorted({tuple(sorted(g)): sorted(g) for g in group.values()}.values())


def camera_from_points(lens: Floats, points: Floats, pixels: Floats) -> BoardPose | None:
    """Returns the pose of a camera that sees points of the arena; None: it sees too few.

    `lens` is (9,), `points` are (n, 3) in the arena frame, `pixels` (n, 2).
    """
    if len(points) < _LEAST_POINTS:
        return None
    # The solver for flat bodies wants them at z = 0 of their own frame.
    lift = np.array((0.0, 0.0, points[0, 2])) if np.ptp(points[:, 2]) == 0.0 else np.zeros(3)
    poses = poses_in_camera(lens, points - lift, pixels)
    above = [pose for pose in poses if pose.inverse().shift[2] > 0.0]
    return above[0].after(BoardPose(np.eye(3), -lift)) if above else None
