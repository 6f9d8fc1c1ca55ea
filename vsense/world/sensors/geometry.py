"""Where things are as a robot sees them: distances, bearings, and the ring of sensors around it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.arena import POSE, Floats, Point, wrap_angle
from vsense.base.native import check, kernel_ffi, kernels, pointer
from vsense.base.xml.element import Element
from vsense.world.fields import Floor
from vsense.world.rays import MovingBodies
from vsense.world.robot_models import EPUCK, InfraredModel, RobotModel
from vsense.world.sensors.base import ReadFunction, Readings, Robots
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

NEAREST_M = 0.01
"""What grows without bound towards a point, such as 1/d^2, is constant within this distance."""

_MAX_RANGE_M = 1000.0
_MAX_RING: int = kernels.VS_LIGHT_SENSORS_MAX
_PLACE_AT: int = POSE.fields["x_m"][1]  # type: ignore[index]
"""Where a row of POSE has x_m, y_m, yaw_rad."""


@dataclass(frozen=True, eq=False, slots=True)
class Ring:
    """Sensors around the body.

    Attributes:
        angles_rad: (k,) what controllers get, counter-clockwise from straight ahead, in (-pi, pi].
        places_rad: (k,) where the sensors sit and look.
    """

    angles_rad: Floats
    places_rad: Floats

    @classmethod
    def from_xml(cls, element: Element) -> Ring:
        """Reads `vs:ring`: which sensors there are, and in which order.

        "epuck" (default): ps0..ps7 of the real robot, as `vs_robot_sensor_angle_rad` of
        controller.h has them. "argos": those of ARGoS, counter-clockwise, whose reported angles
        are not quite where its simulated ones sit. A number: so many, evenly, counter-clockwise
        from straight ahead.
        """
        expected = f"'epuck', 'argos' or a number from 1 to {_MAX_RING}"
        text = element.text("vs:ring", "epuck", expected)
        if text == "epuck":
            angles: Floats = EPUCK.ring.headings_rad
            return cls(angles, angles)
        if text == "argos":
            ring = cls.of(EPUCK.infrared)
            return cls(ring.angles_rad[::-1], ring.places_rad[::-1])
        if not re.fullmatch("[0-9]{1,3}", text) or not 1 <= int(text) <= _MAX_RING:
            raise element.error(f"{text[:60]!r} is not {expected}", "vs:ring")
        angles = wrap_angle(2.0 * np.pi / int(text) * np.arange(float(text)))
        return cls(angles, angles)

    @classmethod
    def of(cls, infrared: InfraredModel) -> Ring:
        """Gives the ring of a robot, in the order in which controllers get it."""
        places = infrared.places_rad or infrared.angles_rad
        return cls(np.array(infrared.angles_rad), np.array(places))

    def __len__(self) -> int:
        return len(self.angles_rad)


_KHEPERA = "kheperaiv"
_READINGS = {"epuck": (8,), "footbot": (24, 8), _KHEPERA: (8,)}
"""How many sensors ARGoS's elements of these names read; of an e-puck's a foot-bot's are made."""


def check_readings(element: Element, model: RobotModel, seat: InfraredModel) -> None:
    """Refuses an element of ARGoS for other sensors than a model has at `seat`."""
    kind, _, device = element.name.partition("_")
    counts, count = _READINGS.get(kind, ()), len(seat.angles_rad)
    if counts and count not in counts:
        words = f"reads {counts[0]} sensors, and a robot of the model {model.name} has {count}"
        raise element.error(f"{words}: expected <{device}>, which reads them all")
    if counts and (kind == _KHEPERA) != (seat.curve == _KHEPERA):
        words = f"reads sensors at other angles than a robot of the model {model.name} has"
        raise element.error(f"{words}: expected <{device}>")


class SensedScene:
    """What sensors in C read of a world: `cdata` is a `struct vs_scene *`.

    It holds until the next update of the world or change of an entity; the poses are not copied.
    """

    def __init__(
        self,
        world: World,
        robots: Robots,
        rows: NDArray[np.intp] | None = None,
        bodies: MovingBodies | None = None,
    ) -> None:
        """Robots (n,), and their rows in the world and its `bodies`, if they are asked for."""
        lights = world.light_table()
        self._arrays = robots, lights, bodies
        self.cdata: Any = kernel_ffi.new("struct vs_scene *")
        self.cdata.first = kernel_ffi.cast("uint8_t *", robots.ctypes.data + _PLACE_AT)
        self.cdata.stride, self.cdata.robots = robots.strides[0], len(robots)
        self.cdata.lights, self.cdata.lights_count = lights.cdata, len(lights)
        if rows is not None:
            self._own = np.ascontiguousarray(rows, dtype=np.int32)
            self.cdata.own = pointer("int32_t", self._own)
        if bodies is not None:
            self.cdata.obstacles = bodies.cdata


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


def blob_scale(blobs: int) -> Scale:
    """Of a count and of each blob's distance [cm], bearing [rad] and colour.

    A unit is 1 m, 1 rad, and the whole range of a colour.
    """
    return Scale(
        unit=(0.0, *(100.0, 1.0, 255.0, 255.0, 255.0) * blobs),
        low=(0.0, *(0.0, -np.pi, 0.0, 0.0, 0.0) * blobs),
        high=(np.inf, *(np.inf, np.pi, 255.0, 255.0, 255.0) * blobs),
        wraps=(False, *(False, True, False, False, False) * blobs),
    )


def without_empty(readings: Floats, places: int) -> Floats:
    """Sets what lies beyond each reading's count to 0."""
    width = (readings.shape[1] - 1) // places
    place = np.repeat(np.arange(places), width)
    tidy: Floats = readings.copy()
    tidy[:, 1:][place >= np.rint(readings[:, :1])] = 0.0
    return tidy


def read_in_c(kernel: ReadFunction, world: World, robots: Robots, count: int) -> Readings:
    """Reads a sensor of `count` numbers by its kernel, as the chain of a simulation does.

    Raises:
        VsenseError: a place is no place, or whoever was asked for the floor has failed.
    """
    readings = np.empty((len(robots), count))
    bodies = world.bodies() if kernel.bodies else None
    scene = SensedScene(world, robots, rows_of(world, robots), bodies)
    given = pointer("double", readings)
    code = getattr(kernel.library, kernel.name)(kernel.cdata, scene.cdata, given)
    world.floor.check()
    check(code, "lines of sight")
    return readings


def ground_reader(
    floor: Floor, robots: int, points_m: Sequence[Point], grey: Sequence[float] = ()
) -> ReadFunction:
    """What looks at the floor at points ahead of each robot and to its left.

    `grey` is the brightness of a unit of each colour, if brightness is read.
    """
    count = robots * len(points_m)
    ahead_m, left_m = (kernel_ffi.new("double[]", axis) for axis in zip(*points_m))
    rooms = (kernel_ffi.new("double[]", size * count) for size in (2, 4))
    weights = kernel_ffi.new("double[]", grey) if grey else kernel_ffi.NULL
    arrays = ahead_m, left_m, weights, *rooms
    ground = kernel_ffi.new("struct vs_ground *", (floor.cdata, len(points_m), *arrays))
    return ReadFunction(kernels, "vs_ground_read", ground, owner=(floor, arrays))


def seen_from(robots: Robots, x_m: ArrayLike, y_m: ArrayLike) -> tuple[Floats, Floats]:
    """Distance along the floor [m] and bearing [rad] of points as robots see them, (n, k) each.

    Bearings are counter-clockwise from the robot's heading, in (-pi, pi]. The points are (k,) for
    all robots or (n, k), each robot's own.
    """
    east = np.asarray(x_m, dtype=np.float64) - robots["x_m"][:, None]
    north = np.asarray(y_m, dtype=np.float64) - robots["y_m"][:, None]
    bearing = wrap_angle(np.arctan2(north, east) - robots["yaw_rad"][:, None])
    return np.hypot(east, north), bearing


def rows_of(world: World, robots: Robots) -> NDArray[np.intp]:
    """Rows of robots (n,) in `world.robots` and so in `world.bodies()`."""
    tags = world.robots["tag"]
    order = np.argsort(tags)
    return np.asarray(order[np.searchsorted(tags, robots["tag"], sorter=order)])


def field_of_view(element: Element) -> float:
    """Reads `vs:field_of_view` [rad]; all around by default."""
    return element.angle("vs:field_of_view", 0.1, 360.0, 360.0)


def within(bearing_rad: Floats, field_of_view_rad: float) -> NDArray[np.bool_]:
    """Which bearings, in (-pi, pi], lie within a field of view around 0."""
    return np.asarray(np.abs(bearing_rad) <= field_of_view_rad / 2.0)
