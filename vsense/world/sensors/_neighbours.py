"""Which robots notice which: pairs within reach and in sight, and their places in a reading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import wrap_angle
from vsense.base.xml.element import Element
from vsense.world.sensors.base import Robots
from vsense.world.sensors.geometry import field_of_view, rows_of, within
from vsense.world.sensors.quality import Floats
from vsense.world.sightings import NEVER_NS
from vsense.world.world import World

_MAX_RANGE_M = 1000.0


@dataclass(frozen=True, slots=True)
class Pairs:
    """Pairs of receiver and sender, ordered by receiver; arrays (p,).

    Attributes:
        receiver: rows of the robots that were asked about.
        sender: rows of `world.robots`.
        distance_m: between the centres.
        bearing_rad: of the sender as the receiver sees it, in (-pi, pi].
    """

    receiver: NDArray[np.intp]
    sender: NDArray[np.intp]
    distance_m: Floats
    bearing_rad: Floats

    def __len__(self) -> int:
        return len(self.receiver)

    def select(self, choice: NDArray[np.bool_] | NDArray[np.intp]) -> Pairs:
        """Gives some of the pairs: those of a mask, or in the order of indices."""
        return Pairs(
            self.receiver[choice],
            self.sender[choice],
            self.distance_m[choice],
            self.bearing_rad[choice],
        )

    def first(self, count: int, order: Floats) -> Pairs:
        """Keeps at most `count` pairs of each receiver: those of the least `order` (p,)."""
        pairs = self.select(np.lexsort((order, self.receiver)))
        return pairs.select(pairs.rank() < count)

    def rank(self) -> NDArray[np.intp]:
        """Counts each receiver's pairs: (p,) from 0."""
        begins = np.searchsorted(self.receiver, self.receiver)
        return np.arange(len(self.receiver)) - begins

    def counts(self, receivers: int) -> NDArray[np.intp]:
        """Gives how many pairs each of the receivers has."""
        return np.bincount(self.receiver, minlength=receivers)

    def reading(self, receivers: int, places: int, columns: Floats) -> Floats:
        """Lays numbers (p, w) of each pair out as readings, (receivers, 1 + places * w).

        A reading is the count of a receiver's pairs, at most `places`, then their numbers; 0 where
        there is none.
        """
        width = columns.shape[1]
        reading: Floats = np.zeros((receivers, 1 + places * width))
        reading[:, 0] = self.counts(receivers)
        first = 1 + width * self.rank()
        reading[self.receiver[:, None], first[:, None] + np.arange(width)] = columns
        return reading


@dataclass(frozen=True, slots=True)
class Reach:
    """The robots that a robot notices at all.

    Attributes:
        range_m: they are nearer than this.
        field_of_view_rad: they are within this angle around straight ahead.
        height_m: lines of sight are this high above the floor; None: nothing is in the way.
    """

    range_m: float
    field_of_view_rad: float
    height_m: float | None

    @classmethod
    def from_xml(cls, element: Element, range_key: str, default_m: float, height_m: float) -> Reach:
        """Reads `range_key` [m], `vs:field_of_view` [deg] and `check_occlusions`."""
        return cls(
            element.number(range_key, 0.001, _MAX_RANGE_M, "m", default_m),
            field_of_view(element),
            height_m if element.boolean("check_occlusions", True) else None,
        )

    def pairs(
        self,
        world: World,
        robots: Robots,
        candidates: NDArray[np.bool_],
        reaches_m: Floats | None = None,
    ) -> Pairs:
        """Finds the pairs of `robots` (n,) and `candidates` (m,), a mask of `world.robots`.

        A robot that no camera sees now is where it was seen last. Each candidate is noticed up to
        its own of `reaches_m` (m,), where that is not 0.
        """
        own, poses = rows_of(world, robots), world.robots
        east = poses["x_m"] - robots["x_m"][:, None]
        north = poses["y_m"] - robots["y_m"][:, None]
        range_m: Floats | float = self.range_m
        if reaches_m is not None:
            range_m = np.where(reaches_m > 0.0, reaches_m, range_m)
        near = east * east + north * north < np.square(range_m)
        near &= candidates & (poses["capture_ns"] != NEVER_NS)
        near[np.arange(len(own)), own] = False
        # Only few of all pairs are near: the others need no bearing.
        receiver, sender = np.nonzero(near)
        east, north = east[near], north[near]
        bearing = wrap_angle(np.arctan2(north, east) - robots["yaw_rad"][receiver])
        pairs = Pairs(receiver, sender, np.hypot(east, north), bearing)
        pairs = pairs.select(within(bearing, self.field_of_view_rad))
        if self.height_m is None or len(pairs) == 0:
            return pairs
        lines = np.empty((2, len(pairs), 3))
        for line, ends in zip(lines, (robots[pairs.receiver], poses[pairs.sender])):
            line[:, 0], line[:, 1], line[:, 2] = ends["x_m"], ends["y_m"], self.height_m
        both = np.stack((own[pairs.receiver], pairs.sender), axis=1)
        return pairs.select(~world.bodies().blocked(lines[0], lines[1], both))


def without_empty(readings: Floats, places: int) -> Floats:
    """Sets what lies beyond each reading's count to 0, as `Pairs.reading` has it."""
    width = (readings.shape[1] - 1) // places
    place = np.repeat(np.arange(places), width)
    tidy: Floats = readings.copy()
    tidy[:, 1:][place >= np.rint(readings[:, :1])] = 0.0
    return tidy
