"""Which part of the floor a body takes up, and how far two such parts are from each other."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vsense.config.specs import Pose
from vsense.world.entities import (
    BODY_HEIGHT_M,
    BODY_RADIUS_M,
    Arena,
    Box,
    Cylinder,
    Entity,
    VirtualRobot,
)

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Footprint:
    """A disc or a rectangle, and the heights between which it stands.

    Attributes:
        what: its name in messages.
        x_m: its middle.
        y_m: its middle.
        low_m: its lowest point.
        high_m: its highest point.
        radius_m: of a disc; 0: it is a rectangle.
        half_m: half the extent of a rectangle along its own x and y.
        yaw_rad: the rectangle's turn.
    """

    what: str
    x_m: float
    y_m: float
    low_m: float
    high_m: float
    radius_m: float = 0.0
    half_m: Point = (0.0, 0.0)
    yaw_rad: float = 0.0

    def distance_m(self, other: Footprint) -> float:
        """Measures how far two footprints are apart, negative where they overlap.

        Between two rectangles that face each other with corners it is less than the distance, by
        at most 30 %. Bodies above each other are infinitely far apart.
        """
        if self.high_m <= other.low_m or other.high_m <= self.low_m:
            return math.inf
        if self.radius_m and other.radius_m:
            apart_m = math.hypot(other.x_m - self.x_m, other.y_m - self.y_m)
            return apart_m - self.radius_m - other.radius_m
        if self.radius_m:
            return other.distance_to_point_m(self.x_m, self.y_m) - self.radius_m
        if other.radius_m:
            return self.distance_to_point_m(other.x_m, other.y_m) - other.radius_m
        return max(self._gap_m(other), other._gap_m(self))

    def distance_to_point_m(self, x_m: float, y_m: float) -> float:
        """Measures how far a point is from the rectangle, 0 inside."""
        x, y = x_m - self.x_m, y_m - self.y_m
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        beyond_x = abs(x * cosine + y * sine) - self.half_m[0]
        beyond_y = abs(y * cosine - x * sine) - self.half_m[1]
        return math.hypot(max(beyond_x, 0.0), max(beyond_y, 0.0))

    def is_inside(self, arena: Arena, gap_m: float) -> bool:
        """Tells whether it lies in the arena, at least gap_m from its border."""
        if self.radius_m:
            return arena.contains(self.x_m, self.y_m, self.radius_m + gap_m)
        return all(arena.contains(x, y, gap_m) for x, y in self._corners())

    def _corners(self) -> list[Point]:
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        half_x, half_y = self.half_m
        return [
            (self.x_m + u * cosine - v * sine, self.y_m + u * sine + v * cosine)
            for u, v in (
                (half_x, half_y), (-half_x, half_y), (-half_x, -half_y), (half_x, -half_y),
            )
        ]  # fmt: skip

    def _gap_m(self, other: Footprint) -> float:
        """Gives the widest gap to another rectangle along this one's own axes."""
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        gaps = []
        for (x, y), half_m in (((cosine, sine), self.half_m[0]), ((-sine, cosine), self.half_m[1])):
            along = [(cx - self.x_m) * x + (cy - self.y_m) * y for cx, cy in other._corners()]
            gaps.append(max(min(along), -max(along)) - half_m)
        return max(gaps)


def of_robot(what: str, pose: Pose) -> Footprint:
    """Gives the footprint of an e-puck or a tagged object."""
    return Footprint(what, pose.x_m, pose.y_m, 0.0, BODY_HEIGHT_M, BODY_RADIUS_M)


def of_entity(entity: Entity) -> Footprint | None:
    """Gives the footprint of an entity, None of one without a body."""
    if isinstance(entity, Box):
        x_m, y_m, low_m = entity.position_m
        half_m = (entity.size_m[0] / 2.0, entity.size_m[1] / 2.0)
        high_m = low_m + entity.size_m[2]
        what = f"box {entity.id!r}"
        return Footprint(what, x_m, y_m, low_m, high_m, 0.0, half_m, entity.yaw_rad)
    if isinstance(entity, Cylinder):
        x_m, y_m, low_m = entity.position_m
        high_m = low_m + entity.height_m
        return Footprint(f"cylinder {entity.id!r}", x_m, y_m, low_m, high_m, entity.radius_m)
    if isinstance(entity, VirtualRobot):
        pose = Pose(entity.x_m, entity.y_m, entity.yaw_rad)
        return of_robot(f"virtual robot {entity.id!r}", pose)
    return None
