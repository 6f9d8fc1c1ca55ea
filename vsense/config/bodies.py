"""Reads `<arena>`: walls, robots, tagged objects, and how they are distributed."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

from vsense.arena import wrap_angle
from vsense.config import argos
from vsense.config.element import Element
from vsense.config.specs import (
    Arena,
    Box,
    Distribution,
    Draw,
    ObjectSpec,
    Pose,
    RobotSpec,
    Vector,
)
from vsense.native import lib

_MAX_LENGTH_M = 1000.0
_MIN_LENGTH_M = 0.001
_MAX_QUANTITY = 10_000
_MAX_TAG = 65_535
_MAX_NUMBER = 65_535
_ID = re.compile(r"(.+)_([0-9]{1,9})_([0-9]{1,9})")
_GENERATORS = {
    "uniform": ("min", "max"),
    "gaussian": ("mean", "std_dev"),
    "constant": ("values", None),
}


@dataclass(slots=True)
class Bodies:
    """What stands in the arena, while it is read.

    Attributes:
        arena: the arena.
        boxes: boxes in the real arena.
        robots: the robots.
        objects: tagged things that are no robots.
        controllers: by robot id the `<controller>` element that names what drives it.
        without_controller: by id the e-pucks that nothing drives: objects, as in the thesis.
    """

    arena: Arena
    boxes: list[Box] = field(default_factory=list)
    robots: list[RobotSpec] = field(default_factory=list)
    objects: list[ObjectSpec] = field(default_factory=list)
    controllers: dict[str, Element] = field(default_factory=dict)
    without_controller: dict[str, Element] = field(default_factory=dict)
    _lines_of_ids: dict[str, int] = field(default_factory=dict)
    _lines_of_tags: dict[int, int] = field(default_factory=dict)

    @property
    def tags(self) -> dict[str, int]:
        """Markers of all tagged things by id."""
        bodies: list[RobotSpec | ObjectSpec] = [*self.robots, *self.objects]
        return {body.id: body.tag for body in bodies}

    def claim_id(self, element: Element, name: str) -> None:
        """Notes an id.

        Raises:
            ConfigError: another element has it, or it does not fit one line.
        """
        if not name.isprintable():
            raise element.error(f"{name!r} holds a character that is not printable", "id")
        if name in self._lines_of_ids:
            line = self._lines_of_ids[name]
            raise element.error(f"{name!r} is the id of another element, in line {line}", "id")
        self._lines_of_ids[name] = element.line

    def claim_tag(self, element: Element, attribute: str, tag: int) -> None:
        """Notes a tag.

        Raises:
            ConfigError: another thing wears it.
        """
        if tag in self._lines_of_tags:
            line = self._lines_of_tags[tag]
            raise element.error(f"tag {tag} is worn by another one, in line {line}", attribute)
        self._lines_of_tags[tag] = element.line


def read_arena(element: Element) -> Bodies:
    """Reads the arena and everything in it.

    Raises:
        ConfigError: something in it is wrong, or it holds no robot.
    """
    low, high = _MIN_LENGTH_M, _MAX_LENGTH_M
    size_m = element.vector("size", low, high, "m")
    centre_m = element.vector("center", -high, high, "m", "0,0,0")
    if element.has("positional_grid_size"):
        element.text("positional_grid_size")
    bodies = Bodies(Arena(size_m, centre_m))
    for child in element.children("box", "e-puck", "vs:object", "distribute", *argos.ENTITIES):
        _read_entity(child, bodies)
    if not bodies.robots:
        raise element.error(f"holds no robot, expected <e-puck>; it has {_counted(element)}")
    return bodies


def _counted(element: Element) -> str:
    names = element.child_names()
    for distribute in element.children("distribute"):
        for entity in distribute.children("entity"):
            names += [f"distribute/{name}" for name in entity.child_names()]
    return ", ".join(f"<{name}>" for name in sorted(set(names) - {"distribute"})) or "nothing"


def _read_entity(element: Element, bodies: Bodies) -> None:
    if element.name == "box":
        _read_box(element, bodies)
    elif element.name == "e-puck":
        _read_epuck(element, bodies)
    elif element.name == "vs:object":
        _add_object(element, bodies)
    elif element.name == "distribute":
        _read_distribute(element, bodies)
    else:
        element.leave_out("it is not in the arena")


def _read_box(element: Element, bodies: Bodies) -> None:
    """Reads a box; walls stand in the real arena unless told otherwise, other boxes do not."""
    name = element.text("id")
    bodies.claim_id(element, name)
    size_m = element.vector("size", _MIN_LENGTH_M, _MAX_LENGTH_M, "m")
    if element.boolean("movable"):
        element.number("mass", 0.001, 1000.0, "kg")
        element.warn(f"{name!r} is movable: it stands still here")
    elif element.has("mass"):
        element.number("mass", 0.001, 1000.0, "kg")
    physical = element.boolean("vs:physical", name.startswith("wall"))
    body = element.child("body")
    position_m = _position(body, bodies.arena)
    yaw_rad = _yaw(body)
    if physical:
        bodies.boxes.append(Box(name, position_m, size_m, yaw_rad, element.line))
    else:
        element.warn(f"{name!r} is virtual and no sensor feels it yet: it is left out")


def _read_epuck(element: Element, bodies: Bodies) -> None:
    _read_epuck_settings(element)
    controller = element.optional_child("controller")
    if controller is None:
        bodies.without_controller[_add_object(element, bodies)] = element
        return
    name, tag, number = _tagged_id(element)
    _claim_robot_id(element, name, bodies)
    bodies.claim_tag(element, "id", tag)
    pose = _pose(element.child("body"), bodies.arena)
    bodies.robots.append(RobotSpec(name, tag, number, pose, None, element.line))
    bodies.controllers[name] = controller


def _read_epuck_settings(element: Element) -> None:
    for key in argos.EPUCK_SETTINGS:
        if element.has(key):
            element.warn(f"{key} is not used: nothing is sent through range and bearing")


def _add_object(element: Element, bodies: Bodies) -> str:
    name, tag, _ = _tagged_id(element)
    bodies.claim_id(element, name)
    bodies.claim_tag(element, "id", tag)
    pose = _pose(element.child("body"), bodies.arena)
    bodies.objects.append(ObjectSpec(name, tag, pose, element.line))
    return name


def _read_distribute(element: Element, bodies: Bodies) -> None:
    entity = element.child("entity")
    inner = entity.children("e-puck", "box", *argos.ENTITIES)
    if len(inner) != 1:
        raise entity.error(f"holds {len(inner)} known elements, expected one, such as <e-puck>")
    if inner[0].name != "e-puck":
        element.leave_out(f"its <{inner[0].name}> are not in the arena")
        return
    distribution = Distribution(
        _draw(element.child("position"), -_MAX_LENGTH_M, _MAX_LENGTH_M, "m", 1.0),
        _draw(element.child("orientation"), -3600.0, 3600.0, "deg", math.radians(1.0)),
        entity.integer("max_trials", 1, 1_000_000),
        entity.line,
    )
    _add_distributed(entity, inner[0], distribution, bodies)


def _add_distributed(
    entity: Element, epuck: Element, distribution: Distribution, bodies: Bodies
) -> None:
    """Adds the robots of an `<entity>`, called NAME_TAG_NUMBER with numbers from base_num."""
    _read_epuck_settings(epuck)
    quantity = entity.integer("quantity", 1, _MAX_QUANTITY)
    first = entity.integer("base_num", 0, _MAX_NUMBER - _MAX_QUANTITY, 0)
    if not entity.has("vs:tags"):
        raise entity.error(f"is missing, expected the {quantity} tags of its robots", "vs:tags")
    tags = entity.integers("vs:tags", 0, _MAX_TAG)
    if len(tags) != quantity:
        raise entity.error(f"has {len(tags)} tags, expected {quantity} as in quantity", "vs:tags")
    prefix, controller = epuck.text("id"), epuck.child("controller")
    for number, tag in enumerate(tags, first):
        name = f"{prefix}_{tag}_{number}"
        bodies.claim_tag(entity, "vs:tags", tag)
        _claim_robot_id(epuck, name, bodies)
        bodies.robots.append(RobotSpec(name, tag, number, None, distribution, epuck.line))
        bodies.controllers[name] = controller


def _claim_robot_id(element: Element, name: str, bodies: Bodies) -> None:
    """Notes an id that a robot gives when it greets the host."""
    bodies.claim_id(element, name)
    size = len(name.encode())
    if size > lib.VS_NAME_MAX:
        raise element.error(f"{name!r} has {size} bytes, expected at most {lib.VS_NAME_MAX}", "id")


def _draw(element: Element, low: float, high: float, unit: str, scale: float) -> Draw:
    """Reads a `<position>` or `<orientation>` of a `<distribute>`, scaled to SI units."""
    method = element.choice("method", tuple(_GENERATORS))
    first_key, second_key = _GENERATORS[method]
    first = element.vector(first_key, low, high, unit)
    second = first
    if second_key is not None:
        second = element.vector(second_key, low, high, unit)
        least = (0.0, 0.0, 0.0) if method == "gaussian" else first
        if any(b < a for a, b in zip(least, second, strict=True)):
            floor = "0" if method == "gaussian" else "'min'"
            raise element.error(f"has a number below {floor}", second_key)
    return Draw(method, _scaled(first, scale), _scaled(second, scale))


def _scaled(vector: Vector, scale: float) -> Vector:
    x, y, z = (scale * number for number in vector)
    return x, y, z


def _tagged_id(element: Element) -> tuple[str, int, int]:
    """Reads an id of the form NAME_TAG_ROBOT."""
    name = element.text("id")
    match = _ID.fullmatch(name)
    if match is None:
        raise element.error(f"{name!r} is not NAME_TAG_ROBOT, such as 'epuck_23_30'", "id")
    tag, number = int(match[2]), int(match[3])
    if tag > _MAX_TAG or number > _MAX_NUMBER:
        raise element.error(f"{name!r}: expected tag and number from 0 to {_MAX_TAG}", "id")
    return name, tag, number


def _pose(body: Element, arena: Arena) -> Pose:
    x_m, y_m, z_m = _position(body, arena)
    if z_m != 0.0:
        raise body.error(f"z is {z_m:g}, expected 0: it stands on the floor", "position")
    return Pose(x_m, y_m, _yaw(body))


def _position(body: Element, arena: Arena) -> Vector:
    position_m = body.vector("position", -_MAX_LENGTH_M, _MAX_LENGTH_M, "m")
    if not arena.contains(position_m[0], position_m[1]):
        raise body.error(f"{position_m[0]:g},{position_m[1]:g} lies outside the arena", "position")
    return position_m


def _yaw(body: Element) -> float:
    z_deg, y_deg, x_deg = body.vector("orientation", -360.0, 360.0, "deg")
    if y_deg != 0.0 or x_deg != 0.0:
        raise body.error("turns about y or x, expected 'Z,0,0': it stands upright", "orientation")
    return float(wrap_angle(math.radians(z_deg)))
