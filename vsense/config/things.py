"""Reads what stands in the arena beside robots: boxes, cylinders, lights and zones."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from vsense.arena import wrap_angle
from vsense.config.colors import read_color
from vsense.config.element import Element
from vsense.world.entities import Arena, Box, Cylinder, Entity, Light, Vector, Zone

MAX_LENGTH_M = 1000.0
MIN_LENGTH_M = 0.001
_MAX_INTENSITY = 1e6
_WALL = "wall"


class Place(NamedTuple):
    """Where something stands: middle of its base, and its turn about z."""

    position_m: Vector
    yaw_rad: float


ORIGIN = Place((0.0, 0.0, 0.0), 0.0)
"""Of what a seed will place."""


def read_place(element: Element, arena: Arena, default: str | None = None) -> Place:
    """Reads `position` and `orientation`, from a `<body>` or from the thing itself.

    Args:
        element: what carries the two.
        arena: where it must lie.
        default: the orientation, where it may be absent.

    Raises:
        ConfigError: one is wrong, or it lies outside the arena.
    """
    far = MAX_LENGTH_M
    position_m = element.vector("position", -far, far, "m")
    if not arena.contains(position_m[0], position_m[1]):
        x, y = position_m[:2]
        raise element.error(f"{x:g},{y:g} lies outside the arena", "position")
    z_deg, y_deg, x_deg = element.vector("orientation", -360.0, 360.0, "deg", default)
    if y_deg != 0.0 or x_deg != 0.0:
        raise element.error(
            "turns about y or x, expected 'Z,0,0': it stands upright", "orientation"
        )
    return Place(position_m, float(wrap_angle(math.radians(z_deg))))


def read_thing(element: Element, name: str, arena: Arena, placed: bool) -> Entity:
    """Reads a thing.

    Args:
        element: one whose name is in THINGS.
        name: its id.
        arena: where it stands.
        placed: the file says where it stands; else it is put at the origin for now.

    Raises:
        ConfigError: an attribute is wrong.
    """
    read, holder = THINGS[element.name]
    place = ORIGIN
    if placed:
        carrier = element.child(holder) if holder else element
        place = read_place(carrier, arena, None if holder else "0,0,0")
    return read(element, name, place)


def _read_box(element: Element, name: str, place: Place) -> Box:
    size_m = element.vector("size", MIN_LENGTH_M, MAX_LENGTH_M, "m")
    return Box(name, place.position_m, size_m, place.yaw_rad, _read_solid(element, name, place))


def _read_cylinder(element: Element, name: str, place: Place) -> Cylinder:
    low, high = MIN_LENGTH_M, MAX_LENGTH_M
    radius_m = element.number("radius", low, high, "m")
    height_m = element.number("height", low, high, "m")
    return Cylinder(name, place.position_m, radius_m, height_m, _read_solid(element, name, place))


def _read_solid(element: Element, name: str, place: Place) -> bool:
    """Reads what boxes and cylinders share; tells whether it stands in the real arena.

    Walls do unless told otherwise, other things do not.
    """
    if element.boolean("movable"):
        element.number("mass", 0.001, 1000.0, "kg")
        element.warn(f"{name!r} is movable: nobody can push it, only loop functions move it")
    elif element.has("mass"):
        element.number("mass", 0.001, 1000.0, "kg")
    for leds in element.children("leds"):
        leds.leave_out("things have no LEDs")
    physical = element.boolean("vs:physical", name.startswith(_WALL))
    if physical and place.position_m[2] != 0.0:
        height_m = place.position_m[2]
        raise element.error(
            f"{name!r} stands in the real arena, so its position's z must be 0, not {height_m:g}"
        )
    return physical


def _read_light(element: Element, name: str, place: Place) -> Light:
    intensity = element.number("intensity", 0.0, _MAX_INTENSITY)
    return Light(name, place.position_m, intensity, read_color(element, "color", "white"))


def _read_zone(element: Element, name: str, place: Place) -> Zone:
    low, high = MIN_LENGTH_M, MAX_LENGTH_M
    shape = element.choice("shape", ("circle", "rectangle"))
    x_m, y_m, z_m = place.position_m
    if z_m != 0.0:
        raise element.error(f"z is {z_m:g}, expected 0: it lies on the floor", "position")
    radius_m, size_m = 0.0, (0.0, 0.0)
    if shape == "circle":
        radius_m = element.number("radius", low, high, "m")
    else:
        along_m, across_m = element.numbers("size", 2, low, high, "m")
        size_m = (along_m, across_m)
    color = read_color(element, "color") if element.has("color") else None
    value = element.number("value", -1e4, 1e4, "", 0.0)
    return Zone(name, shape, x_m, y_m, radius_m, size_m, place.yaw_rad, color, value)


_Read = Callable[[Element, str, Place], Entity]

THINGS: dict[str, tuple[_Read, str]] = {
    "box": (_read_box, "body"),
    "cylinder": (_read_cylinder, "body"),
    "light": (_read_light, ""),
    "vs:zone": (_read_zone, ""),
}
"""By the element's name what reads it, and the element in it that carries its place."""
