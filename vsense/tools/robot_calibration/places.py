"""Where robots are taken to be calibrated: spots before walls, and places on white and on black.

Lengths in m, arena frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import UsageError
from vsense.config.arena import floor_of
from vsense.config.specs import Experiment
from vsense.run.homing.floor import DrivingFloor
from vsense.tools.robot_calibration.areas import STRAY_M
from vsense.world.entities import BODY_RADIUS_M, Arena, Box

Floats = NDArray[np.float64]
Point = tuple[float, float]

STAGE_M = BODY_RADIUS_M + STRAY_M + 0.005
"""The axle's middle is so far from the wall where a robot comes to the spot and leaves it."""
ALONE_M = 0.12
"""Nothing but the wall may be so near to a robot that measures: sensors see 7 cm far."""
BESIDE_M = 0.05
"""Spots along a wall are so far apart."""
_FAR_M = 1000.0
"""An arena's border is no thing that sensors see."""
ROOM_M = BODY_RADIUS_M + STRAY_M + 0.004
"""Clearance of the ways there."""


@dataclass(frozen=True, slots=True)
class WallSpot:
    """A spot before a wall.

    Attributes:
        wall: the box's name.
        foot: the point of the wall's face that is measured from.
        heading_rad: from there into the wall.
    """

    wall: str
    foot: Point
    heading_rad: float

    @property
    def stage(self) -> Point:
        """Where a robot comes to it."""
        return self.before(STAGE_M)

    def before(self, distance_m: float) -> Point:
        """The point so far in front of the wall."""
        return (
            self.foot[0] - distance_m * math.cos(self.heading_rad),
            self.foot[1] - distance_m * math.sin(self.heading_rad),
        )

    def distance_m(self, x_m: float, y_m: float) -> float:
        """How far a point is from the wall's face."""
        east, north = self.foot[0] - x_m, self.foot[1] - y_m
        return east * math.cos(self.heading_rad) + north * math.sin(self.heading_rad)


def spots(experiment: Experiment, wall: str | None = None) -> list[WallSpot]:
    """All spots before an experiment's walls, or before the one named.

    Raises:
        UsageError: there is no such wall, or no room before any.
    """
    boxes = [box for box in experiment.boxes if wall in (None, box.id)]
    if not boxes:
        known = ", ".join(box.id for box in experiment.boxes)
        raise UsageError(
            f"--wall {wall}: expected one of {known}"
            if known
            else "no wall to measure proximity before: expected a <box> with vs:physical='true'"
        )
    found = [spot for box in boxes for spot in _before(box, experiment)]
    if not found:
        raise UsageError(
            "no room to measure proximity: expected a straight wall (a <box>) with nothing within"
            f" {100 * ALONE_M:g} cm of the places before it"
        )
    return found


def _before(box: Box, experiment: Experiment) -> Iterator[WallSpot]:
    others = DrivingFloor(
        Arena((_FAR_M, _FAR_M, 1.0), experiment.arena.centre_m),
        [_row(other) for other in experiment.boxes if other is not box],
        [(*post.position_m[:2], post.radius_m) for post in experiment.cylinders],
    )
    whole = DrivingFloor.of(experiment)
    for turn in range(4):
        outward = box.yaw_rad + turn * math.pi / 2.0
        half_m, along_m = (box.size_m[(turn + k) % 2] / 2.0 for k in (0, 1))
        normal = np.array([math.cos(outward), math.sin(outward)])
        beside = np.array([-normal[1], normal[0]])
        middle = np.array(box.position_m[:2]) + half_m * normal
        count = math.floor((along_m - ALONE_M) / 2.0 / BESIDE_M)
        for k in range(-count, count + 1):
            foot = middle + k * BESIDE_M * beside
            spot = WallSpot(box.id, (float(foot[0]), float(foot[1])), outward + math.pi)
            near = np.array([spot.before(BODY_RADIUS_M), spot.stage])
            inside = np.abs(near - experiment.arena.centre_m[:2])
            inside = inside < np.array(experiment.arena.size_m[:2]) / 2.0
            free = others.clearance_m(near) >= ALONE_M
            if inside.all() and free.all() and whole.clearance_m(near[1]) >= ROOM_M:
                yield spot


def _row(box: Box) -> tuple[float, ...]:
    return (*box.position_m[:2], box.yaw_rad, *box.size_m[:2])


@dataclass(frozen=True, slots=True)
class GroundPlaces:
    """Where it is white and where it is black."""

    white: Point
    black: Point


def ground_places(experiment: Experiment, white: Point | None, black: Point | None) -> GroundPlaces:
    """The places that the user names, or that the experiment's floor has.

    Raises:
        UsageError: one is not named and the floor has none, or robots cannot stand there.
    """
    floor = DrivingFloor.of(experiment)
    found = []
    for name, place in (("white", white), ("black", black)):
        chosen = _on_floor(experiment, floor, name) if place is None else place
        room_m = float(floor.clearance_m(np.array(chosen)))
        if room_m < ROOM_M:
            raise UsageError(
                f"--{name} {chosen[0]:g},{chosen[1]:g}: expected a place in the arena, with"
                f" {100 * ROOM_M:.0f} cm free around it; got {100 * room_m:.1f} cm"
            )
        found.append(chosen)
    if math.dist(*found) < 0.02:
        raise UsageError("--white and --black: expected two places, got one")
    return GroundPlaces(*found)


PATCH_M = 0.03
"""The floor must have the colour so far around a place, for three sensors and a robot's errors."""


def _on_floor(experiment: Experiment, floor: DrivingFloor, name: str) -> Point:
    """The roomiest place where the picture on the experiment's floor has a colour."""
    words = f"--{name} X,Y: expected where it is {name}"
    if experiment.floor is None or experiment.floor.path is None:
        raise UsageError(f"{words}; the experiment has no picture on its floor")
    painted = floor_of(experiment)
    half_x, half_y = (size / 2.0 for size in experiment.arena.size_m[:2])
    centre_x, centre_y = experiment.arena.centre_m[:2]
    xs, ys = np.arange(-half_x, half_x, 0.02), np.arange(-half_y, half_y, 0.02)
    points = np.stack(np.meshgrid(centre_x + xs, centre_y + ys), axis=-1).reshape(-1, 2)
    free = floor.clearance_m(points)
    fits = free >= ROOM_M
    for off in ((0.0, 0.0), *((_ROUND[k], _ROUND[k - 2]) for k in range(8))):
        levels = painted.sample(points + PATCH_M * np.array(off))[:, :3]
        fits &= (levels > 200.0).all(axis=1) if name == "white" else (levels < 55.0).all(axis=1)
    if not fits.any():
        raise UsageError(f"{words}; the experiment's floor has no such place of 6 cm")
    best = points[int(np.argmax(np.where(fits, free, -1.0)))]
    return float(best[0]), float(best[1])


_ROUND: Sequence[float] = [math.cos(k * math.pi / 4.0) for k in range(8)]
