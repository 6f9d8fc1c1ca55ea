"""Places cameras and boards one after another, each by what it shares with those before.

Errors pile up along the way; that does no harm, as the bundle starts from here and shares them
out among all cameras at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vsense.calibration.solution import CalibrationError
from vsense.calibration.start import Pose, miss_px, poses_in_camera
from vsense.calibration.views import View

Floats = NDArray[np.float64]

_LEAST_POINTS = 4
_CANDIDATES, _JUDGES = 12, 40
"""How many views propose a camera's pose, and how many tell which is best: the fullest ones."""


@dataclass(slots=True)
class Placement:
    """Where things are so far.

    Attributes:
        cameras: Camera -> pose that takes arena to camera frame.
        bodies: Moment -> pose that takes the board's to the arena frame.
    """

    cameras: dict[str, Pose] = field(default_factory=dict)
    bodies: dict[str, Pose] = field(default_factory=dict)


class Placer:
    """Places a whole rig."""

    def __init__(
        self, lenses: dict[str, Floats], views: Sequence[View], points: Sequence[Floats]
    ) -> None:
        """Looks at every view by itself.

        Args:
            lenses: Camera -> (9,).
            views: Who saw the board when.
            points: Per view (n, 3), the corners in the board's frame [m].
        """
        self._lenses = lenses
        self._views = list(views)
        self._points = list(points)
        self._alone = [
            poses_in_camera(lenses[v.camera], p, v.pixels) for v, p in zip(views, points)
        ]

    def place(self, start: Placement) -> Placement:
        """Places everything that is linked to what is placed already.

        Raises:
            CalibrationError: Some cameras share no moment with the others.
        """
        done = start
        anchored = dict(start.bodies)
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
        return done

    def _links(self, done: Placement) -> dict[str, int]:
        """Cameras to be placed -> corners that they see on boards which are placed."""
        links: dict[str, int] = {}
        for view, alone in zip(self._views, self._alone):
            if view.camera not in done.cameras and view.moment in done.bodies and alone:
                links[view.camera] = links.get(view.camera, 0) + len(view.ids)
        return links

    def _place_bodies(self, done: Placement, anchored: dict[str, Pose]) -> None:
        """Places every board that a placed camera sees, where all of those see it best."""
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

    def _camera_pose(self, camera: str, done: Placement) -> Pose:
        """The pose at which a camera sees all the boards that are placed best."""
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
        self, numbers: Sequence[int], cameras: dict[str, Pose], bodies: dict[str, Pose]
    ) -> float:
        """How far off some views are if cameras and boards are there [px, summed]."""
        total = 0.0
        for number in numbers:
            view = self._views[number]
            pose = cameras[view.camera].after(bodies[view.moment])
            total += miss_px(self._lenses[view.camera], pose, self._points[number], view.pixels)
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


def camera_from_points(lens: Floats, points: Floats, pixels: Floats) -> Pose | None:
    """Returns the pose of a camera that sees points of the arena, None if it sees too few.

    Args:
        lens: (9,).
        points: (n, 3) in the arena frame.
        pixels: (n, 2).
    """
    if len(points) < _LEAST_POINTS:
        return None
    # The solver for flat bodies wants them at z = 0 of their own frame.
    lift = np.array((0.0, 0.0, points[0, 2])) if np.ptp(points[:, 2]) == 0.0 else np.zeros(3)
    above = [p for p in poses_in_camera(lens, points - lift, pixels) if _from_above(p)]
    return above[0].after(Pose(np.eye(3), -lift)) if above else None


def _from_above(pose: Pose) -> bool:
    """Whether a camera stands on the side that z points to."""
    return bool(pose.inverse().shift[2] > 0.0)
