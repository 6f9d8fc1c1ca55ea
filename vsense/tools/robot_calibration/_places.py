"""Where a robot may move: free of walls, of robots that stand, and of what others were given.

Lengths in m, arena frame. A robot asks for an area before it moves, and has it alone until it gives
it back.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vsense.base.arena import Floats, Point
from vsense.base.errors import UsageError
from vsense.config.arena import floor_of
from vsense.config.specs import Experiment
from vsense.run.homing.floor import DrivingFloor
from vsense.tools.robot_calibration._sensor_fit import wall_m
from vsense.world.entities import Arena, Box
from vsense.world.physics.motion import obstacles
from vsense.world.robot_models import RobotModel

AROUND_M = 0.012
"""Kept around the body of a robot that stands: markers sit up to some millimetres off."""
STRAY_M = 0.022
"""A robot may stray so far from the way that it was given."""
TOUCHING_M = 0.002
"""Two bodies this near to each other may touch, wherever their markers sit."""

_STEP_M = 0.01
_NEARER_M = 0.004
_HEADINGS = 24
_OTHER_WAY_RAD = math.radians(60.0)
"""A second way leads at least so much elsewhere: what is wrong with a camera shows up."""


@dataclass(frozen=True, slots=True)
class Area:
    """Points (k, 2) and a radius around them: all that a moving robot may cover."""

    points: Floats
    radius_m: float

    def strays(self, x_m: float, y_m: float) -> float:
        """How far a place is from the points."""
        return float(np.hypot(self.points[:, 0] - x_m, self.points[:, 1] - y_m).min())

    def distance_m(self, other: Area) -> float:
        """How near their points come."""
        between = self.points[:, None] - other.points[None]
        return float(np.hypot(between[..., 0], between[..., 1]).min())


def spot(x_m: float, y_m: float, body_m: float) -> Area:
    """The area of a robot of radius `body_m` that turns on the spot."""
    return Area(np.array([[x_m, y_m]]), body_m + STRAY_M)


def way(x_m: float, y_m: float, heading_rad: float, length_m: float, body_m: float) -> Area:
    """The area of a robot of radius `body_m` that drives straight ahead and back again."""
    along = np.arange(0.0, length_m + _STEP_M, _STEP_M)
    direction = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    return Area(np.array([x_m, y_m]) + along[:, None] * direction, body_m + STRAY_M)


class FreeFloor:
    """What stands in an experiment's arena, and who has which part of it.

    Attributes:
        places: x, y [m] of every known body by tag, as seen last.
        models: of all bodies, by tag.
    """

    def __init__(self, experiment: Experiment) -> None:
        self._floor = DrivingFloor.of(experiment)
        self._given: dict[int, Area] = {}
        self.places: dict[int, tuple[float, float]] = {}
        self.models = experiment.models

    def clearance_m(self, points: Floats) -> float:
        """Distance of the nearest wall, thing or end of the arena from points (k, 2)."""
        return float(self._floor.clearance_m(points).min())

    def is_free(self, tag: int, area: Area) -> bool:
        """Whether the robot `tag` can have an area.

        Where it stands too near to something already it may go where it comes no nearer, as long as
        the two do not touch.
        """
        here = Area(np.array([self.places[tag]]), self.models[tag].radius_m)
        least = min(area.radius_m, self.clearance_m(here.points) - _NEARER_M)
        if self.clearance_m(area.points) < max(least, here.radius_m + TOUCHING_M / 2.0):
            return False
        for body_m, other in self._other_areas(tag):
            allowed_m = min(area.radius_m + other.radius_m, here.distance_m(other) - _NEARER_M)
            if area.distance_m(other) < max(allowed_m, here.radius_m + body_m + TOUCHING_M):
                return False
        return True

    def is_crowded(self, tag: int) -> bool:
        """Whether another body stands so near that the two may touch when one turns."""
        here = Area(np.array([self.places[tag]]), self.models[tag].radius_m)
        return any(
            here.distance_m(other) < body_m + AROUND_M + here.radius_m
            for body_m, other in self._other_areas(tag)
        )

    def is_alone(self, tag: int, place: tuple[float, float], radius_m: float) -> bool:
        """Whether nobody else stands, or may move, so near to a place."""
        there = Area(np.array([place]), radius_m)
        return all(
            there.distance_m(other) >= radius_m + other.radius_m
            for _, other in self._other_areas(tag)
        )

    def is_blocked(self, tag: int, near_m: float, ahead_rad: float | None) -> bool:
        """Whether another body is so near, and ahead of the robot where that is given."""
        x_m, y_m = self.places[tag]
        for other, (east, north) in self.places.items():
            bodies_m = self.models[tag].radius_m + self.models[other].radius_m
            away_m = math.hypot(east - x_m, north - y_m)
            if other == tag or away_m >= bodies_m + near_m:
                continue
            bearing = math.atan2(north - y_m, east - x_m)
            if ahead_rad is None or math.cos(bearing - ahead_rad) > 0.0:
                return True
        return False

    def give(self, tag: int, area: Area) -> None:
        """Gives a robot an area in place of the one that it had."""
        self._given[tag] = area

    def take(self, tag: int) -> None:
        """Takes a robot's area back: it stands."""
        self._given.pop(tag, None)

    def longest_way(
        self, tag: int, lengths_m: Iterable[float], yaw_rad: float, unlike_rad: float | None = None
    ) -> tuple[float, float] | None:
        """The heading and length of the longest free way of a robot; None: there is none.

        Args:
            lengths_m: those that it may have, longest first.
            yaw_rad: of the robot; of ways of one length it needs to turn least for the one given.
            unlike_rad: the way must lead elsewhere than this, and than back from there.
        """
        x_m, y_m = self.places[tag]
        step = 2.0 * math.pi / _HEADINGS
        turns = sorted(range(-_HEADINGS // 2, _HEADINGS // 2), key=abs)
        headings = [yaw_rad + step * turn for turn in turns]
        if unlike_rad is not None:
            least = math.sin(_OTHER_WAY_RAD)
            headings = [h for h in headings if abs(math.sin(h - unlike_rad)) >= least]
        for length_m in lengths_m:
            for heading in headings:
                if self.is_free(tag, way(x_m, y_m, heading, length_m, self.models[tag].radius_m)):
                    return heading, length_m
        return None

    def discs(self, tag: int) -> Floats:
        """All other bodies with what is kept around them, (k, 3) x, y, radius."""
        discs = [
            (*place, self.models[other].radius_m + AROUND_M)
            for other, place in self.places.items()
            if other != tag
        ]
        return np.array(discs).reshape(-1, 3)

    def _other_areas(self, tag: int) -> Iterator[tuple[float, Area]]:
        """The radius of each other body, and what it may cover."""
        for other, place in self.places.items():
            if other != tag:
                given, body_m = self._given.get(other), self.models[other].radius_m
                yield body_m, Area(np.array([place]), body_m + AROUND_M)
                if given is not None:
                    yield body_m, given


_GAP_SHARES = (3.0, 2.0, 1.4, 1.0)
_ALONE_M = 0.015
SPOT_STEP_M = 0.05
"""Spots along a wall are so far apart."""
_FAR_M = 1000.0
"""An arena's border is no thing that sensors see."""


def gaps_m(model: RobotModel) -> list[float]:
    """Between body and wall, at which a robot turns on the spot; the farthest first."""
    return [share * wall_m(model) for share in _GAP_SHARES]


def stage_m(model: RobotModel) -> float:
    """How far a robot's middle is from the wall where it comes to a spot and leaves it."""
    return model.radius_m + max(STRAY_M + 0.005, gaps_m(model)[0] - 0.003)


def alone_m(model: RobotModel) -> float:
    """Nothing but the wall may be so near to a robot that measures: as far as sensors see."""
    return model.radius_m + model.ring.table_m[-1] + _ALONE_M


def room_m(model: RobotModel) -> float:
    """Clearance of the ways there."""
    return model.radius_m + STRAY_M + 0.004


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


def spots(experiment: Experiment, model: RobotModel, wall: str | None = None) -> list[WallSpot]:
    """All spots for robots of a model before an experiment's walls, or before the one named.

    Raises:
        UsageError: there is no such wall, or no room before any.
    """
    boxes = [box for box in experiment.boxes if wall in (None, box.id)]
    if not boxes:
        ids = ", ".join(box.id for box in experiment.boxes)
        raise UsageError(
            f"--wall {wall}: expected one of {ids}"
            if ids
            else "no wall to measure proximity before: expected a <box> with vs:physical='true'"
        )
    wall_spots = [spot for box in boxes for spot in _before(box, experiment, model)]
    if not wall_spots:
        raise UsageError(
            "no room to measure proximity: expected a straight wall (a <box>) with nothing within"
            f" {100 * alone_m(model):g} cm of the places before it, for a robot of the model"
            f" {model.name}"
        )
    return wall_spots


def _before(box: Box, experiment: Experiment, model: RobotModel) -> Iterator[WallSpot]:
    boxes = [other for other in experiment.boxes if other is not box]
    open_field = Arena((_FAR_M, _FAR_M, 1.0), experiment.arena.centre_m)
    other_bodies = DrivingFloor(open_field, *obstacles(boxes, experiment.cylinders))
    floor = DrivingFloor.of(experiment)
    for turn in range(4):
        outward = box.yaw_rad + turn * math.pi / 2.0
        half_m, along_m = (box.size_m[(turn + k) % 2] / 2.0 for k in (0, 1))
        normal = np.array([math.cos(outward), math.sin(outward)])
        beside = np.array([-normal[1], normal[0]])
        middle = np.array(box.position_m[:2]) + half_m * normal
        count = math.floor((along_m - alone_m(model)) / 2.0 / SPOT_STEP_M)
        for k in range(-count, count + 1):
            foot = middle + k * SPOT_STEP_M * beside
            spot = WallSpot(box.id, (float(foot[0]), float(foot[1])), outward + math.pi)
            near = np.array([spot.before(model.radius_m), spot.before(stage_m(model))])
            inside = np.abs(near - experiment.arena.centre_m[:2])
            inside = inside < np.array(experiment.arena.size_m[:2]) / 2.0
            free = other_bodies.clearance_m(near) >= alone_m(model)
            if inside.all() and free.all() and floor.clearance_m(near[1]) >= room_m(model):
                yield spot


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
    needed_m = max(room_m(robot.model) for robot in experiment.robots)
    places = []
    for name, place in (("white", white), ("black", black)):
        chosen = _on_floor(experiment, floor, name, needed_m) if place is None else place
        free_m = float(floor.clearance_m(np.array(chosen)))
        if free_m < needed_m:
            raise UsageError(
                f"--{name} {chosen[0]:g},{chosen[1]:g}: expected a place in the arena, with"
                f" {100 * needed_m:.0f} cm free around it; got {100 * free_m:.1f} cm"
            )
        places.append(chosen)
    if math.dist(*places) < 0.02:
        raise UsageError("--white and --black: expected two places, got one")
    return GroundPlaces(*places)


PATCH_M = 0.03
"""The floor must have the colour so far around a place, for three sensors and a robot's errors."""


def _on_floor(experiment: Experiment, floor: DrivingFloor, name: str, needed_m: float) -> Point:
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
    fits = free >= needed_m
    for off in ((0.0, 0.0), *((_ROUND[k], _ROUND[k - 2]) for k in range(8))):
        levels = painted.sample(points + PATCH_M * np.array(off))[:, :3]
        fits &= (levels > 200.0).all(axis=1) if name == "white" else (levels < 55.0).all(axis=1)
    if not fits.any():
        raise UsageError(f"{words}; the experiment's floor has no such place of 6 cm")
    best = points[int(np.argmax(np.where(fits, free, -1.0)))]
    return float(best[0]), float(best[1])


_ROUND: Sequence[float] = [math.cos(k * math.pi / 4.0) for k in range(8)]
