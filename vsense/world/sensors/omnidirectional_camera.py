"""ARGoS's omnidirectional camera: the LEDs that are lit around the robot, a blob each.

    <epuck_omnidirectional_camera medium="leds" noise_std_dev="0.01" />
    <colored_blob_omnidirectional_camera medium="leds" noise_std_dev="0.01" />

Sensor "omnidirectional_camera": the number of blobs, then for each of its places, the nearest
first: distance along the floor [cm], bearing [rad] counter-clockwise from straight ahead, red,
green, blue 0..255; places without a blob are all 0. There are as many places as LEDs that may be
lit, as far as a datagram has room.

The camera is 0.122 m above the floor. It sees the LEDs of other robots (see the LED actuators), of
boxes and of cylinders that are nearer to it than 0.122 tan(`omnidirectional_camera_aperture` of
`<e-puck>`, 70 degrees), unless a body is in the way, also that which the LED is on. The second one,
of any robot, sees a square of that half side. Noise adds to a LED's place on the floor a vector of
any direction whose length is Gaussian [m], with the second one a share of its distance.

Source: argos3-epuck 66cb8d9, epuck_omnidirectional_camera_sensor.cpp lines 38-96 and 175-195,
epuck_entity.cpp lines 24-46 and 190-210; argos3 421bd76,
colored_blob_omnidirectional_camera_rotzonly_sensor.cpp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import wrap_angle
from vsense.base.xml.element import Element
from vsense.world.entities import Box, Cylinder
from vsense.world.sensors._neighbours import Pairs, without_empty
from vsense.world.sensors.base import Readings, Robots, Scope
from vsense.world.sensors.geometry import rows_of
from vsense.world.sensors.quality import Floats, Scale
from vsense.world.sightings import NEVER_NS
from vsense.world.world import World

ELEMENTS = ()
ARGOS_ELEMENTS = ("epuck_omnidirectional_camera", "colored_blob_omnidirectional_camera")
ARGOS_NOISE = ()

CAMERA_HEIGHT_M = 0.122
"""Source: argos3-epuck, epuck_entity.cpp, OMNIDIRECTIONAL_CAMERA_ELEVATION."""

_RING_M, _RING_HEIGHT_M, _COLORED_HEIGHT_M = 0.036, 0.04, 0.0765
_RING_RAD = np.pi / 16 + np.pi / 4 * np.arange(8.0)
LEDS_M = np.array(
    [
        *((_RING_M * np.cos(a), _RING_M * np.sin(a), _RING_HEIGHT_M) for a in _RING_RAD),
        (0.018, 0.0311769, _COLORED_HEIGHT_M),
        (0.018, -0.0311769, _COLORED_HEIGHT_M),
        (-_RING_M, 0.0, _COLORED_HEIGHT_M),
    ]
)
"""(ROBOT_LEDS, 3) places of `World.led_colors` in the robot's frame. Source: as above."""

_BYTES = 500
"""Of all places of a reading: so much of a datagram is left beside a robot's other sensors."""
_COLUMNS = 5
_MAX_NOISE_M = 1e3


@dataclass(frozen=True, slots=True)
class OmnidirectionalCamera:
    """Sees LEDs; see the module.

    Attributes:
        reach_m: how far from the camera it sees.
        square: it sees a square of this half side instead.
        noise_std_dev: length of the vector that is added; with `square` as a share of the distance.
        max_blobs: places of its reading.
    """

    reach_m: float
    square: bool
    noise_std_dev: float
    max_blobs: int
    name: str = "omnidirectional_camera"

    @property
    def layout(self) -> str:
        """The count, and five numbers for each place."""
        return f"{1 + _COLUMNS * self.max_blobs}*f4"

    @property
    def scale(self) -> Scale:
        """A unit is 1 m, 1 rad, and the whole range of a colour."""
        blobs = self.max_blobs
        return Scale(
            unit=(0.0, *(100.0, 1.0, 255.0, 255.0, 255.0) * blobs),
            low=(0.0, *(0.0, -np.pi, 0.0, 0.0, 0.0) * blobs),
            high=(np.inf, *(np.inf, np.pi, 255.0, 255.0, 255.0) * blobs),
            wraps=(False, *(False, True, False, False, False) * blobs),
        )

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the blobs; see `VirtualSensor.read`."""
        leds_m, colors, owners = lit_leds(world)
        cameras_m = np.empty((len(robots), 3))
        cameras_m[:, 0], cameras_m[:, 1] = robots["x_m"], robots["y_m"]
        cameras_m[:, 2] = CAMERA_HEIGHT_M
        own = rows_of(world, robots)
        ways_m = leds_m - cameras_m[:, None, :]
        if self.square:
            near = (np.abs(ways_m[..., :2]) < self.reach_m).all(axis=2)
        else:
            near = np.einsum("nli,nli->nl", ways_m, ways_m) < self.reach_m**2
        near &= (owners != own[:, None]) & (ways_m[..., 2] < CAMERA_HEIGHT_M)
        seeing, seen = np.nonzero(near)
        free = ~world.bodies().blocked(cameras_m[seeing], leds_m[seen], own[seeing])
        seeing, seen = seeing[free], seen[free]
        flat_m = self._noisy(ways_m[seeing, seen, :2], world.random)
        bearing = np.arctan2(flat_m[:, 1], flat_m[:, 0]) - robots["yaw_rad"][seeing]
        blobs = Pairs(seeing, seen, np.hypot(*flat_m.T), np.asarray(wrap_angle(bearing)))
        blobs = blobs.first(self.max_blobs, blobs.distance_m)
        columns = np.column_stack(
            (100.0 * blobs.distance_m, blobs.bearing_rad, colors[blobs.sender].astype(np.float64))
        )
        return blobs.reading(len(robots), self.max_blobs, columns)

    def tidy(self, values: Floats) -> Floats:
        """Leaves no noise in the places without a blob."""
        return without_empty(values, self.max_blobs)

    def _noisy(self, flat_m: Floats, random: np.random.Generator) -> Floats:
        """Moves places (b, 2) on the floor."""
        if self.noise_std_dev <= 0.0:
            return flat_m
        away_m = random.normal(0.0, self.noise_std_dev, len(flat_m))
        if self.square:
            away_m *= np.hypot(*flat_m.T)
        towards = random.uniform(0.0, 2.0 * np.pi, len(flat_m))
        moved_m: Floats = flat_m + np.column_stack(
            (away_m * np.cos(towards), away_m * np.sin(towards))
        )
        return moved_m


def lit_leds(world: World) -> tuple[Floats, NDArray[np.uint8], NDArray[np.intp]]:
    """All LEDs that are lit.

    Returns:
        Places (l, 3) [m], colours (l, 3), and whose they are (l,): rows of `world.robots`, -1: of
        a box or cylinder.
    """
    robots, colors = world.robots, world.led_colors
    lit = colors.any(axis=2) & (robots["capture_ns"] != NEVER_NS)[:, None]
    owners, leds = np.nonzero(lit)
    cosine, sine = np.cos(robots["yaw_rad"][owners]), np.sin(robots["yaw_rad"][owners])
    ahead, left, up = LEDS_M[leds].T
    places = np.column_stack(
        (
            robots["x_m"][owners] + ahead * cosine - left * sine,
            robots["y_m"][owners] + ahead * sine + left * cosine,
            up,
        )
    )
    things: list[Box | Cylinder] = [*world.boxes(), *world.cylinders()]
    shown = [
        (*_place(thing, led.offset_m), *led.color)
        for thing in things
        for led in thing.leds
        if any(led.color)
    ]
    still = np.array(shown).reshape(-1, 6)
    return (
        np.concatenate((places, still[:, :3])),
        np.concatenate((colors[owners, leds], still[:, 3:].astype(np.uint8))),
        np.concatenate((owners, np.full(len(still), -1))),
    )


def _place(thing: Box | Cylinder, offset_m: tuple[float, float, float]) -> tuple[float, ...]:
    yaw_rad = thing.yaw_rad if isinstance(thing, Box) else 0.0
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    (x, y, z), (ahead, left, up) = thing.position_m, offset_m
    return x + ahead * cosine - left * sine, y + ahead * sine + left * cosine, z + up


def from_argos(element: Element, scope: Scope) -> OmnidirectionalCamera:
    """Makes the sensor that one of ARGoS's elements asks for."""
    wanted = max(scope.leds, 1)
    places = min(wanted, _BYTES // (4 * _COLUMNS))
    if places < wanted:
        element.warn(f"sees at most the {places} nearest LEDs: a datagram has no room for more")
    return OmnidirectionalCamera(
        reach_m=float(CAMERA_HEIGHT_M * np.tan(scope.robots.aperture_rad)),
        square=element.name == "colored_blob_omnidirectional_camera",
        noise_std_dev=element.number("noise_std_dev", 0.0, _MAX_NOISE_M, default=0.0),
        max_blobs=places,
    )
