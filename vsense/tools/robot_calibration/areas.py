"""Where a robot may move: free of walls, of robots that stand, and of what others were given.

Lengths in m, arena frame. A robot asks for an area before it moves, and has it alone until it gives
it back.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.world.entities import BODY_RADIUS_M
from vsense.world.physics.motion import obstacles

Floats = NDArray[np.float64]

STANDING_M = BODY_RADIUS_M + 0.012
"""Radius that is kept around a robot that stands: markers sit up to some millimetres off."""
STRAY_M = 0.022
"""A robot may stray so far from the way that it was given."""
TOUCHING_M = 2.0 * BODY_RADIUS_M + 0.002
"""Two robots this near to each other may touch, wherever their markers sit."""

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


def spot(x_m: float, y_m: float) -> Area:
    """The area of a robot that turns on the spot."""
    return Area(np.array([[x_m, y_m]]), BODY_RADIUS_M + STRAY_M)


def way(x_m: float, y_m: float, heading_rad: float, length_m: float) -> Area:
    """The area of a robot that drives straight ahead and back again."""
    along = np.arange(0.0, length_m + _STEP_M, _STEP_M)
    direction = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    return Area(np.array([x_m, y_m]) + along[:, None] * direction, BODY_RADIUS_M + STRAY_M)


class FreeFloor:
    """What stands in an experiment's arena, and who has which part of it.

    Attributes:
        places: x, y [m] of every known body by tag, as seen last.
    """

    def __init__(self, experiment: Experiment) -> None:
        boxes, cylinders = obstacles(experiment.boxes, experiment.cylinders)
        self._boxes, self._cylinders = boxes, cylinders
        arena = experiment.arena
        self._middle = np.array(arena.centre_m[:2])
        self._half = np.array(arena.size_m[:2]) / 2.0
        self._given: dict[int, Area] = {}
        self.places: dict[int, tuple[float, float]] = {}

    def clearance_m(self, points: Floats) -> float:
        """Distance of the nearest wall, thing or end of the arena from points (k, 2)."""
        nearest = float((self._half - np.abs(points - self._middle)).min())
        for x_m, y_m, yaw_rad, size_x_m, size_y_m in self._boxes:
            cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
            off = points - (x_m, y_m)
            across = np.abs(off @ np.array([[cos, -sin], [sin, cos]]))
            beyond = np.maximum(across - np.array([size_x_m, size_y_m]) / 2.0, 0.0)
            nearest = min(nearest, float(np.hypot(*beyond.T).min()))
        for x_m, y_m, radius_m in self._cylinders:
            nearest = min(nearest, float(np.hypot(*(points - (x_m, y_m)).T).min()) - radius_m)
        return nearest

    def is_free(self, tag: int, area: Area) -> bool:
        """Whether the robot `tag` can have an area.

        Where it stands too near to something already it may go where it comes no nearer, as long as
        the two do not touch.
        """
        here = Area(np.array([self.places[tag]]), BODY_RADIUS_M)
        least = min(area.radius_m, self.clearance_m(here.points) - _NEARER_M)
        if self.clearance_m(area.points) < max(least, TOUCHING_M / 2.0):
            return False
        for other in self._others(tag):
            kept = min(area.radius_m + other.radius_m, here.distance_m(other) - _NEARER_M)
            if area.distance_m(other) < max(kept, TOUCHING_M):
                return False
        return True

    def is_crowded(self, tag: int) -> bool:
        """Whether another body stands so near that the two may touch when one turns."""
        here = Area(np.array([self.places[tag]]), BODY_RADIUS_M)
        near_m = STANDING_M + BODY_RADIUS_M
        return any(here.distance_m(other) < near_m for other in self._others(tag))

    def is_alone(self, tag: int, place: tuple[float, float], radius_m: float) -> bool:
        """Whether nobody else stands, or may move, so near to a place."""
        there = Area(np.array([place]), radius_m)
        return all(
            there.distance_m(other) >= radius_m + other.radius_m for other in self._others(tag)
        )

    def is_blocked(self, tag: int, near_m: float, ahead_rad: float | None) -> bool:
        """Whether another body's middle is so near, and ahead of the robot where that is given."""
        x_m, y_m = self.places[tag]
        for other, (east, north) in self.places.items():
            away_m = math.hypot(east - x_m, north - y_m)
            if other == tag or away_m >= near_m:
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
        each = 2.0 * math.pi / _HEADINGS
        turns = sorted(range(-_HEADINGS // 2, _HEADINGS // 2), key=abs)
        headings = [yaw_rad + each * turn for turn in turns]
        if unlike_rad is not None:
            least = math.sin(_OTHER_WAY_RAD)
            headings = [h for h in headings if abs(math.sin(h - unlike_rad)) >= least]
        for length_m in lengths_m:
            for heading in headings:
                if self.is_free(tag, way(x_m, y_m, heading, length_m)):
                    return heading, length_m
        return None

    def _others(self, tag: int) -> Iterator[Area]:
        for other, place in self.places.items():
            if other != tag:
                given = self._given.get(other)
                yield Area(np.array([place]), STANDING_M)
                if given is not None:
                    yield given
