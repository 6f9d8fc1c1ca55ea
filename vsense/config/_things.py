"""Reads what stands in the arena beside robots: boxes, cylinders, lights and zones; their colours.

In ARGoS a medium is an index of what can be sensed. Here everything in the arena is found without
one, so of a medium only its id counts, and for range and bearing whether bodies are in the way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from vsense.base.arena import wrap_angle
from vsense.base.errors import instead
from vsense.base.xml.element import Element, shown
from vsense.config import argos
from vsense.world.entities import Arena, Box, Color, Cylinder, Entity, Led, Light, Vector, Zone

NAMED: dict[str, Color] = {
    "black": (0, 0, 0),
    "white": (255, 255, 255),
    "red": (255, 0, 0),
    "green": (0, 255, 0),
    "blue": (0, 0, 255),
    "magenta": (255, 0, 255),
    "cyan": (0, 255, 255),
    "yellow": (255, 255, 0),
    "orange": (255, 140, 0),
    "brown": (165, 42, 42),
    "purple": (128, 0, 128),
    "gray10": (26, 26, 26),
    "gray20": (51, 51, 51),
    "gray30": (77, 77, 77),
    "gray40": (102, 102, 102),
    "gray50": (127, 127, 127),
    "gray60": (153, 153, 153),
    "gray70": (179, 179, 179),
    "gray80": (204, 204, 204),
    "gray90": (229, 229, 229),
}
"""Colours by name. Source: ARGoS, color.h; there orange is 255,140,0."""


def read_color(element: Element, key: str, default: str | None = None) -> Color:
    """Reads a colour's name, or its red, green and blue from 0 to 255 with commas between them."""
    text = element.text(key, default, "a colour such as 'yellow' or '255,255,0'")
    if text in NAMED:
        return NAMED[text]
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 3 or not all(p.isascii() and p.isdigit() and int(p) <= 255 for p in parts):
        raise element.error(
            f"{shown(text)} is no colour, expected three whole numbers from 0 to 255 with commas"
            f" between them, or one of: {', '.join(sorted(NAMED))}",
            key,
        )
    red, green, blue = (int(part) for part in parts)
    return red, green, blue


Media = Mapping[str, Element]
"""The media by id."""

OCCLUSIONS = "check_occlusions"
"""Attribute of a range-and-bearing medium, and of the virtual sensor that uses it."""


def by_id(elements: Iterable[Element], kind: str) -> dict[str, Element]:
    """Gives elements of a kind by their ids; raises ConfigError where two have one."""
    by_name: dict[str, Element] = {}
    for element in elements:
        name = element.text("id")
        if name in by_name:
            line = by_name[name].line
            raise element.error(f"{name!r} is the id of another {kind}, in line {line}", "id")
        by_name[name] = element
    return by_name


def read_media(root: Element) -> Media:
    """Reads the media of an experiment; raises ConfigError where two have one id."""
    section = root.optional_child("media")
    children = section.children(*argos.MEDIA, *argos.OTHER_MEDIA) if section else ()
    media = by_id(children, "medium")
    for element in media.values():
        if element.name in argos.OTHER_MEDIA:
            element.leave_out("nothing is sent through it")
            continue
        if element.has("grid_size"):
            element.numbers("grid_size", 3, 1.0, 1e6)
        if element.name == "range_and_bearing":
            element.boolean(OCCLUSIONS, True)
    return media


def check_medium(element: Element, media: Media, hears: bool = False) -> None:
    """Reads the medium that a device or light may name; one that hears takes what it says."""
    if not element.has("medium"):
        return
    name = element.text("medium")
    if name not in media:
        raise element.error(f"there is no {name!r} in <media>; {instead(name, media)}", "medium")
    says = media[name].peek(OCCLUSIONS)
    if hears and says is not None and element.peek(OCCLUSIONS) is None:
        element.set(OCCLUSIONS, says)


MAX_SIZE_M = 1000.0
MIN_SIZE_M = 0.001
_MAX_INTENSITY = 1e6
_WALL = "wall"


class Placing(NamedTuple):
    """Where something stands: middle of its base, and its turn about z."""

    position_m: Vector
    yaw_rad: float


ORIGIN = Placing((0.0, 0.0, 0.0), 0.0)
"""Of what a seed will place."""


def read_place(element: Element, arena: Arena, default: str | None = None) -> Placing:
    """Reads `position`, inside the arena, and `orientation`, from a `<body>` or the thing itself.

    `default` is the orientation, where it may be absent.
    """
    far = MAX_SIZE_M
    position_m = element.vector("position", -far, far, "m")
    if not arena.contains(position_m[0], position_m[1]):
        x, y = position_m[:2]
        raise element.error(f"{x:g},{y:g} lies outside the arena", "position")
    z_deg, y_deg, x_deg = element.vector("orientation", -360.0, 360.0, "deg", default)
    if y_deg != 0.0 or x_deg != 0.0:
        raise element.error(
            "turns about y or x, expected 'Z,0,0': it stands upright", "orientation"
        )
    return Placing(position_m, float(wrap_angle(math.radians(z_deg))))


def read_thing(element: Element, name: str, arena: Arena, placed: bool) -> Entity:
    """Reads a thing whose element's name is in THINGS; without `placed` it is put at the origin."""
    read, holder = THINGS[element.name]
    place = ORIGIN
    if placed:
        carrier = element.child(holder) if holder else element
        place = read_place(carrier, arena, None if holder else "0,0,0")
    return read(element, name, place)


def _read_box(element: Element, name: str, place: Placing) -> Box:
    size_m = element.vector("size", MIN_SIZE_M, MAX_SIZE_M, "m")
    physical, leds = _read_solid(element, name, place), _read_leds(element)
    return Box(name, place.position_m, size_m, place.yaw_rad, physical, leds)


def _read_cylinder(element: Element, name: str, place: Placing) -> Cylinder:
    low, high = MIN_SIZE_M, MAX_SIZE_M
    radius_m = element.number("radius", low, high, "m")
    height_m = element.number("height", low, high, "m")
    physical, leds = _read_solid(element, name, place), _read_leds(element)
    return Cylinder(name, place.position_m, radius_m, height_m, physical, leds)


def _read_solid(element: Element, name: str, place: Placing) -> bool:
    """Reads what boxes and cylinders share; returns whether it stands in the real arena.

    Walls do by default, other things do not.
    """
    if element.boolean("movable"):
        element.number("mass", 0.0, 1000.0, "kg")
        element.warn(f"{name!r} is movable: nobody can push it, only loop functions move it")
    elif element.has("mass"):
        element.number("mass", 0.0, 1000.0, "kg")
    physical = element.boolean("vs:physical", name.startswith(_WALL))
    # ARGoS lets boxes hang above the floor.
    if physical and place.position_m[2] != 0.0 and not element.document.lenient:
        height_m = place.position_m[2]
        raise element.error(
            f"{name!r} stands in the real arena, so its position's z must be 0, not {height_m:g}"
        )
    return physical


def _read_leds(element: Element) -> tuple[Led, ...]:
    """Reads the LEDs of a box or cylinder, which the robots' virtual cameras see."""
    leds = []
    for section in element.children("leds"):
        section.has("medium")
        section.has("id")
        for led in section.children("led"):
            for unused in ("id", "intensity"):
                led.has(unused)
            led.choice("anchor", ("origin",), "origin")
            offset_m = led.vector("offset", -MAX_SIZE_M, MAX_SIZE_M, "m")
            leds.append(Led(offset_m, read_color(led, "color", "black")))
    return tuple(leds)


def _read_light(element: Element, name: str, place: Placing) -> Light:
    intensity = element.number("intensity", 0.0, _MAX_INTENSITY)
    return Light(name, place.position_m, intensity, read_color(element, "color", "white"))


def _read_zone(element: Element, name: str, place: Placing) -> Zone:
    low, high = MIN_SIZE_M, MAX_SIZE_M
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


_Read = Callable[[Element, str, Placing], Entity]

THINGS: dict[str, tuple[_Read, str]] = {
    "box": (_read_box, "body"),
    "cylinder": (_read_cylinder, "body"),
    "light": (_read_light, ""),
    "vs:zone": (_read_zone, ""),
}
"""By the element's name what reads it, and the element in it that carries its place."""
