"""What stands or lies in the arena besides the real robots: frozen records in the arena frame.

`id` is a name that is unique in the world. What is `physical` stands in the real arena; the rest is
sensed only. Loop functions make them, too, so each checks itself: a number that is none, or that no
arena has, is a WorldError where the record is made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.arena import wrap_angle
from vsense.base.errors import VsenseError
from vsense.base.native import kernel_ffi, kernels, pointer
from vsense.world.robot_models import EPUCK, RobotModel

Vector = tuple[float, float, float]
Color = tuple[int, int, int]

VIRTUAL_TAG_MIN = 0x10000
"""Virtual robots have tags that no marker can show."""

MAX_ENTITY_LENGTH_M = 1e4
MAX_INTENSITY = 1e6
_LENGTH = (1e-6, MAX_ENTITY_LENGTH_M, f"a length from 1e-06 to {MAX_ENTITY_LENGTH_M:g} m")


class WorldError(VsenseError):
    """Something that the world cannot hold or does not know."""


@dataclass(frozen=True, slots=True)
class Arena:
    """The box that everything stands in; `size_m` is its extent along x, y, z."""

    size_m: Vector
    centre_m: Vector

    @property
    def corners_m(self) -> tuple[tuple[float, float], ...]:
        """x and y of its corners: lower left, lower right, upper right, upper left."""
        (x, y), (across, along) = self.centre_m[:2], self.size_m[:2]
        sides = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
        return tuple((x + u * across, y + v * along) for u, v in sides)

    def contains(self, x_m: float, y_m: float, margin_m: float = 0.0) -> bool:
        """Whether a point lies inside, at least margin_m from the border."""
        return (
            abs(x_m - self.centre_m[0]) <= self.size_m[0] / 2.0 - margin_m
            and abs(y_m - self.centre_m[1]) <= self.size_m[1] / 2.0 - margin_m
        )


class Led(NamedTuple):
    """A coloured light on a box or cylinder: where, in its frame from its base, and how."""

    offset_m: Vector
    color: Color


@dataclass(frozen=True, slots=True)
class Box:
    """A box, also a wall.

    Attributes:
        position_m: middle of its base.
        size_m: extent along its own x, y, z.
        yaw_rad: its turn about z.
        leds: what cameras see of it.
    """

    id: str
    position_m: Vector
    size_m: Vector
    yaw_rad: float = 0.0
    physical: bool = False
    leds: tuple[Led, ...] = ()

    def __post_init__(self) -> None:
        _check(self, position_m=_vector, size_m=_sizes, yaw_rad=_angle)


@dataclass(frozen=True, slots=True)
class Cylinder:
    """An upright cylinder; `position_m` is the middle of its base."""

    id: str
    position_m: Vector
    radius_m: float
    height_m: float
    physical: bool = False
    leds: tuple[Led, ...] = ()

    def __post_init__(self) -> None:
        _check(self, position_m=_vector, radius_m=_length, height_m=_length)


@dataclass(frozen=True, slots=True)
class Light:
    """A lamp without a body.

    Attributes:
        intensity: as in ARGoS: a reading is (intensity / distance)^2.
        color: red, green, blue, 0..255 each.
    """

    id: str
    position_m: Vector
    intensity: float = 1.0
    color: Color = (255, 255, 255)

    def __post_init__(self) -> None:
        _check(self, position_m=_vector, intensity=_intensity, color=_color)


@dataclass(frozen=True, slots=True)
class Zone:
    """A named region of the floor.

    Attributes:
        shape: "circle" or "rectangle".
        x_m, y_m: its middle.
        radius_m: of a circle.
        size_m: extent of a rectangle along its own x and y.
        yaw_rad: the rectangle's turn.
        color: what it is painted with over the floor; None: it cannot be seen.
        value: a number for loop functions.
    """

    id: str
    shape: str
    x_m: float
    y_m: float
    radius_m: float = 0.0
    size_m: tuple[float, float] = (0.0, 0.0)
    yaw_rad: float = 0.0
    color: Color | None = None
    value: float = 0.0

    def __post_init__(self) -> None:
        _check(self)
        if self.shape not in ("circle", "rectangle"):
            raise _error(self, "shape", self.shape, "'circle' or 'rectangle'")
        _check(self, x_m=_number, y_m=_number, value=_number)
        if self.shape == "circle":
            _check(self, radius_m=_length, yaw_rad=_angle)
        else:
            _check(self, size_m=_sizes, yaw_rad=_angle)
        if self.color is not None:
            _check(self, color=_color)

    def contains(self, points_m: ArrayLike) -> NDArray[np.bool_]:
        """Which points (..., 2) lie in the zone; its edge belongs to it."""
        points = np.ascontiguousarray(points_m, dtype=np.float64)
        inside = np.empty(points.shape[:-1], dtype=np.bool_)
        given = pointer("double", points)
        target = pointer("uint8_t", inside)
        kernels.vs_zone_contains(self.as_c(), given, inside.size, target)
        return inside

    def as_c(self) -> Any:
        """The `struct vs_zone *`."""
        is_circle = self.shape == "circle"
        return kernel_ffi.new(
            "struct vs_zone *",
            {
                "x_m": self.x_m,
                "y_m": self.y_m,
                "radius_m2": self.radius_m**2 if is_circle else -1.0,
                "cosine": math.cos(self.yaw_rad),
                "sine": math.sin(self.yaw_rad),
                "half_m": (self.size_m[0] / 2, self.size_m[1] / 2),
                "color": (*(self.color or (0, 0, 0)), 255),
            },
        )


@dataclass(frozen=True, slots=True)
class VirtualRobot:
    """A robot that the real ones sense.

    Attributes:
        tag: its number, from VIRTUAL_TAG_MIN.
        yaw_rad: its heading.
        controller: id of the controller that drives it; "": only loop functions move it.
        model: what kind of robot it is.
    """

    id: str
    tag: int
    x_m: float
    y_m: float
    yaw_rad: float = 0.0
    controller: str = ""
    model: RobotModel = EPUCK

    def __post_init__(self) -> None:
        _check(self)
        is_integer = isinstance(self.tag, (int, np.integer)) and not isinstance(self.tag, bool)
        if not is_integer or not VIRTUAL_TAG_MIN <= self.tag < 2**32:
            expected = f"a whole number from {VIRTUAL_TAG_MIN} on: smaller ones are real markers"
            raise _error(self, "tag", self.tag, expected)
        _check(self, x_m=_number, y_m=_number, yaw_rad=_angle, model=_model)


Entity = Box | Cylinder | Light | Zone | VirtualRobot


def moved(entity: Entity, x_m: float, y_m: float, yaw_rad: float | None = None) -> Entity:
    """The same thing at another place; without yaw_rad it keeps its turn.

    Raises:
        WorldError: a number that no arena has, or a turn of something without a heading.
    """
    if isinstance(entity, (Cylinder, Light)):
        if yaw_rad is not None:
            raise WorldError(f"{type(entity).__name__} {entity.id!r} has no heading to be turned")
        return replace(entity, position_m=(x_m, y_m, entity.position_m[2]))
    yaw_rad = entity.yaw_rad if yaw_rad is None else yaw_rad
    if isinstance(entity, Box):
        return replace(entity, position_m=(x_m, y_m, entity.position_m[2]), yaw_rad=yaw_rad)
    return replace(entity, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)


def _error(entity: Entity, name: str, value: object, expected: str) -> WorldError:
    kind = type(entity).__name__
    return WorldError(f"{kind} {entity.id!r}: {name} is {value!r:.60}, expected {expected}")


def _check(entity: Entity, **checks: Callable[[Any, str], object]) -> None:
    """Checks a record's id and replaces attributes by what the checks make of them."""
    if not isinstance(entity.id, str) or not entity.id.strip() or not entity.id.isprintable():
        raise _error(entity, "id", entity.id, "a name")
    for name, check in checks.items():
        object.__setattr__(entity, name, check(entity, name))


def _model(entity: Entity, name: str) -> RobotModel:
    model = getattr(entity, name)
    if not isinstance(model, RobotModel):
        raise _error(entity, name, model, "what model_of(name) of world.robot_models gives")
    return model


def _number(
    entity: Entity,
    name: str,
    low: float = -MAX_ENTITY_LENGTH_M,
    high: float = MAX_ENTITY_LENGTH_M,
    expected: str = f"a number of at most {MAX_ENTITY_LENGTH_M:g}",
) -> float:
    return _within(entity, name, getattr(entity, name), low, high, expected)


def _within(
    entity: Entity, name: str, value: object, low: float, high: float, expected: str
) -> float:
    plain = isinstance(value, (int, float, np.integer, np.floating))
    if not plain or isinstance(value, bool) or not low <= value <= high:  # type: ignore[operator]
        raise _error(entity, name, value, expected)
    return float(value)  # type: ignore[arg-type]


def _intensity(light: Light, name: str) -> float:
    return _number(light, name, 0.0, MAX_INTENSITY, f"a number from 0 to {MAX_INTENSITY:g}")


def _length(entity: Entity, name: str) -> float:
    return _number(entity, name, *_LENGTH)


def _angle(entity: Entity, name: str) -> float:
    angle_rad = _number(entity, name, -1e6, 1e6, "an angle in radians")
    inside = -math.pi < angle_rad <= math.pi
    return angle_rad if inside else float(wrap_angle(angle_rad))


def _vector(entity: Entity, name: str) -> tuple[float, ...]:
    bound, expected = MAX_ENTITY_LENGTH_M, f"3 numbers of at most {MAX_ENTITY_LENGTH_M:g} m"
    parts = _parts(entity, name, 3)
    return tuple(_within(entity, name, part, -bound, bound, expected) for part in parts)


def _sizes(entity: Box | Zone, name: str) -> tuple[float, ...]:
    parts = _parts(entity, name, 3 if isinstance(entity, Box) else 2)
    return tuple(_within(entity, name, part, *_LENGTH) for part in parts)


def _parts(entity: Entity, name: str, size: int) -> Iterable[object]:
    value = getattr(entity, name)
    if not isinstance(value, (Sequence, np.ndarray)) or len(value) != size:
        raise _error(entity, name, value, f"{size} numbers")
    return value


def _color(entity: Light | Zone, name: str) -> Color:
    expected = "red, green, blue, each a whole number from 0 to 255"
    value = entity.color
    if not isinstance(value, (Sequence, np.ndarray)) or len(value) != 3:
        raise _error(entity, name, value, expected)
    for part in value:
        is_integer = isinstance(part, (int, np.integer)) and not isinstance(part, bool)
        if not is_integer or not 0 <= part <= 255:
            raise _error(entity, name, value, expected)
    return int(value[0]), int(value[1]), int(value[2])
