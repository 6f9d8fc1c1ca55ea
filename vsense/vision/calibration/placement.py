"""First guesses for the bundle: lenses, and the poses of cameras and boards.

Cameras and boards are placed one after another, each by what it shares with those before. The
bundle then spreads the accumulated errors over all cameras.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from vsense.vision.calibration.lens import LENS_SIZE, project, undistorted
from vsense.vision.calibration.solution import CalibrationError
from vsense.vision.calibration.views import View
from vsense.vision.cameras.camera import Floats

_FOCAL_SHARES = np.geomspace(0.4, 5.0, 16)
"""Focal lengths that are tried, over the picture's width: 100 to 11 degrees of view."""
_PATIENCE_PX = 100.0
"""Points that are further off count as this."""


@dataclass(frozen=True, slots=True)
class BoardPose:
    """A body's pose: `turn` (3, 3) @ point + `shift` (3,) [m] takes its points to another frame."""

    turn: Floats
    shift: Floats

    def inverse(self) -> BoardPose:
        """Returns the inverse transform."""
        return BoardPose(self.turn.T, -self.turn.T @ self.shift)

    def after(self, first: BoardPose) -> BoardPose:
        """Returns this transform applied after another."""
        return BoardPose(self.turn @ first.turn, self.turn @ first.shift + self.shift)

    def apply(self, points: Floats) -> Floats:
        """Transforms (n, 3) points."""
        return np.asarray(points @ self.turn.T + self.shift)


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
