"""Somewhere that a sensor points to: a tagged thing, a virtual entity, or a fixed point."""

from __future__ import annotations

from dataclasses import dataclass

from vsense.base.errors import instead
from vsense.base.xml.element import Element
from vsense.world.entities import Box, Cylinder, Light
from vsense.world.pollution import DEFAULT_MEMORY_NS
from vsense.world.sensors.base import Scope
from vsense.world.world import World

PlacePose = tuple[float, float, float]
"""x [m], y [m], yaw [rad] in the arena; yaw is 0 for what has no heading."""

_MAX_M = 1000.0


@dataclass(frozen=True, slots=True)
class FixedPlace:
    """A point of the arena."""

    fixed: PlacePose

    def pose(self, world: World) -> PlacePose | None:
        return self.fixed


@dataclass(frozen=True, slots=True)
class TaggedPlace:
    """A robot or another tagged thing, None where its last sighting is older than `memory_ns`."""

    tag: int
    memory_ns: int

    def pose(self, world: World) -> PlacePose | None:
        pose = world.pose(self.tag)
        if pose is None or world.capture_ns - int(pose["capture_ns"]) > self.memory_ns:
            return None
        return float(pose["x_m"]), float(pose["y_m"]), float(pose["yaw_rad"])


@dataclass(frozen=True, slots=True)
class EntityPlace:
    """A virtual thing, which a loop function may move; None while it is not in the world."""

    id: str

    def pose(self, world: World) -> PlacePose | None:
        entity = world.entities.get(self.id)
        if entity is None:
            return None
        if isinstance(entity, (Cylinder, Light)):
            return entity.position_m[0], entity.position_m[1], 0.0
        if isinstance(entity, Box):
            return entity.position_m[0], entity.position_m[1], entity.yaw_rad
        return entity.x_m, entity.y_m, entity.yaw_rad


AnyPlace = FixedPlace | TaggedPlace | EntityPlace
"""Its `pose(world)` is where it is now, or None while that is not known."""


def read_memory_ns(element: Element) -> int:
    """Reads `vs:memory` [s]: how old the last sighting of a tagged thing may be."""
    return round(1e9 * element.number("vs:memory", 0.0, 3600.0, "s", DEFAULT_MEMORY_NS / 1e9))


def from_xml(element: Element, scope: Scope, attribute: str) -> AnyPlace:
    """Reads an attribute that names a tagged thing or a virtual entity by its id.

    `vs:memory` [s] of the same element says how long a tagged thing stays where it was seen last
    once no camera sees it. Raises ConfigError where there is no such thing.
    """
    memory_ns = read_memory_ns(element)
    name = element.text(attribute, None, "the id of something in the arena")
    if name in scope.tags:
        return TaggedPlace(scope.tag(element, attribute, name), memory_ns)
    if name in scope.entities:
        return EntityPlace(name)
    hint = instead(name, [*scope.tags, *scope.entities])
    raise element.error(f"there is no {name[:60]!r} in the arena; {hint}", attribute)


def rectangle_from_xml(element: Element, prefix: str) -> FixedPlace:
    """Reads the middle of the rectangle PREFIX_min_x, ..._y, PREFIX_max_x, ..._y.

    Raises ConfigError where a corner is missing or wrong, or max is below min.
    """
    middle = []
    for axis in "xy":
        low, high = (
            element.number(f"{prefix}_{end}_{axis}", -_MAX_M, _MAX_M, "m") for end in ("min", "max")
        )
        if high < low:
            key = f"{prefix}_max_{axis}"
            raise element.error(f"{high:g} is below {prefix}_min_{axis} {low:g}", key)
        middle.append((low + high) / 2.0)
    return FixedPlace((middle[0], middle[1], 0.0))
