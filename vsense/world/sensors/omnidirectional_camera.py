"""ARGoS's omnidirectional camera: the LEDs that are lit around the robot, a blob each.

    <epuck_omnidirectional_camera medium="leds" noise_std_dev="0.01" />
    <colored_blob_omnidirectional_camera medium="leds" noise_std_dev="0.01" />

Sensor "omnidirectional_camera": the number of blobs, then for each of its places, the nearest
first: distance along the floor [cm], bearing [rad] counter-clockwise from straight ahead, red,
green, blue 0..255; places without a blob are all 0. There are as many places as LEDs that may be
lit, as far as a datagram has room.

The camera of an e-puck is 0.122 m above the floor, others' are as high as their models say. It sees
the LEDs of other robots (see the LED actuators), of boxes and of cylinders, and lights, below twice
its height and nearer to it than 0.122 tan(`omnidirectional_camera_aperture` of the robot, 70
degrees), unless a body is in the way, also that which the LED is on. The second one, of any robot,
sees a square of that half side. Noise adds to a LED's place on the floor a vector of
any direction whose length is Gaussian [m], with the second one a share of its distance.

Source: argos3-epuck 66cb8d9, epuck_omnidirectional_camera_sensor.cpp lines 38-96 and 175-195,
epuck_entity.cpp lines 24-46 and 190-210; argos3 421bd76,
colored_blob_omnidirectional_camera_rotzonly_sensor.cpp.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vsense.base.arena import Floats
from vsense.base.native import kernel_ffi, kernels, pointer, random_in_c
from vsense.base.xml.element import Element
from vsense.world.entities import Box, Cylinder
from vsense.world.robot_models import EPUCK
from vsense.world.sensors.base import ReadFunction, Readings, Robots, Scope
from vsense.world.sensors.geometry import blob_scale, read_in_c, without_empty
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ()
ARGOS_ELEMENTS = ("epuck_omnidirectional_camera", "colored_blob_omnidirectional_camera")
ARGOS_NOISE = ()

_BYTES = 500
"""Of all places of a reading: so much of a datagram is left beside a robot's other sensors."""
_COLUMNS = 5
_MAX_NOISE_M = 1e3
_NOTICED_BYTES = kernel_ffi.sizeof("struct vs_noticed")
_MOST_NOTICED = 50_000_000
"""LEDs that are in sight of robots in a timestep, at most, where noise is drawn for each: 2 GB."""


@dataclass(frozen=True, slots=True)
class OmnidirectionalCamera:
    """Sees LEDs; see the module.

    Attributes:
        reach_m: how far from the camera it sees.
        square: it sees a square of this half side instead.
        noise_std_dev: length of the vector that is added; with `square` as a share of the distance.
        max_blobs: places of its reading.
        height_m: of the camera.
    """

    reach_m: float
    square: bool
    noise_std_dev: float
    max_blobs: int
    height_m: float = EPUCK.camera.height_m
    name: str = "omnidirectional_camera"

    @property
    def layout(self) -> str:
        """The count, and five numbers for each place."""
        return f"{1 + _COLUMNS * self.max_blobs}*f4"

    @property
    def scale(self) -> Scale:
        """A unit is 1 m, 1 rad, and the whole range of a colour."""
        return blob_scale(self.max_blobs)

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the blobs; see `VirtualSensor.read`."""
        count = 1 + _COLUMNS * self.max_blobs
        return read_in_c(self.kernel(world, robots), world, robots, count)

    def kernel(self, world: World, robots: Robots) -> ReadFunction:
        """See `vsense/world/sensors/base.py`."""
        is_noisy = self.noise_std_dev > 0.0
        still = _still_leds(world)
        leds_m = _lamps(world)
        leds = len(still) + leds_m[..., 0].size
        # Noise is drawn when all robots have looked. Of the room only what is used is memory.
        room = min(leds * (len(robots) if is_noisy else 1), _MOST_NOTICED)
        seen = np.empty((room, _NOTICED_BYTES), dtype=np.uint8)
        arrays: dict[str, Any] = {
            "colors": pointer("uint8_t", world.led_colors),
            "leds_m": pointer("double", leds_m),
            "random": random_in_c(world.random, is_noisy),
            "lit": kernel_ffi.new(f"struct vs_lit[{leds + 1}]", still),
            "seen": pointer("struct vs_noticed", seen),
            "nearest": kernel_ffi.new("struct vs_noticed[]", self.max_blobs),
            "counts": kernel_ffi.new("uint32_t[]", len(robots) + 1),
        }
        members = {
            "world": world.sightings.cdata,
            "leds": leds_m.shape[1],
            "apart_m": 2.0 * float(np.hypot(leds_m[..., 0], leds_m[..., 1]).max(initial=0.0)),
            "still": len(still),
            "height_m": self.height_m,
            "reach_m": self.reach_m,
            "reach2_m2": self.reach_m**2,
            "square": self.square,
            "noise": self.noise_std_dev,
            "most": self.max_blobs,
            "room": len(seen),
        }
        camera = kernel_ffi.new("struct vs_camera *", {**members, **arrays})
        owner = arrays, world.random, still
        return ReadFunction(kernels, "vs_camera_read", camera, True, owner)

    def tidy(self, values: Floats) -> Floats:
        """Leaves no noise in the places without a blob."""
        return without_empty(values, self.max_blobs)


def _lamps(world: World) -> Floats:
    """(n, k, 3) where each robot has its LEDs, in its own frame; 0 where it has less than k."""
    places = np.zeros((*world.led_colors.shape[:2], 3))
    for row, tag in zip(places, world.robots["tag"].tolist()):
        lamps_m = world.models.get(tag, EPUCK).lamps_m
        row[: len(lamps_m)] = lamps_m[: len(row)]  # loop functions may put in larger, dark ones
    return places


def _still_leds(world: World) -> list[tuple[Any, ...]]:
    """Lit LEDs of boxes and cylinders, and lights, as `struct vs_lit`; they keep colours alive."""
    things: list[Box | Cylinder] = [*world.boxes(), *world.cylinders()]
    shown = [(thing, led) for thing in things for led in thing.leds if any(led.color)]
    places = [(_place(thing, led.offset_m), led.color) for thing, led in shown]
    places += [(light.position_m, light.color) for light in world.lights() if any(light.color)]
    return [(at, -1, 1, kernel_ffi.new("uint8_t[]", color)) for at, color in places]


def _place(thing: Box | Cylinder, offset_m: tuple[float, float, float]) -> tuple[float, ...]:
    yaw_rad = thing.yaw_rad if isinstance(thing, Box) else 0.0
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    (x, y, z), (ahead, left, up) = thing.position_m, offset_m
    return x + ahead * cosine - left * sine, y + ahead * sine + left * cosine, z + up


def from_argos(element: Element, scope: Scope) -> OmnidirectionalCamera:
    """Makes the sensor that one of ARGoS's elements asks for."""
    wanted = max(scope.leds, 1)
    places = min(wanted, (scope.seen_bytes or _BYTES) // (4 * _COLUMNS))
    if places < wanted:
        element.warn(f"sees at most the {places} nearest LEDs: a datagram has no room for more")
    height_m = scope.robots.model.camera.height_m
    return OmnidirectionalCamera(
        reach_m=float(height_m * np.tan(scope.robots.aperture_rad)),
        square=element.name == "colored_blob_omnidirectional_camera",
        noise_std_dev=element.number("noise_std_dev", 0.0, _MAX_NOISE_M, default=0.0),
        max_blobs=places,
        height_m=height_m,
    )
