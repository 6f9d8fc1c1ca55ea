"""Sensors in NumPy, as vsense had them before they became C: what the kernels are held against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tests.rigs.lines import NOBODY, blocked, nearest
from vsense.base.arena import wrap_angle
from vsense.world.entities import Box, Cylinder
from vsense.world.rays import Bodies, disc_rows, entity_rows
from vsense.world.robot_models import EPUCK
from vsense.world.sensors.geometry import Reach, Ring, rows_of, within
from vsense.world.sensors.omnidirectional_camera import (
    OmnidirectionalCamera,
)
from vsense.world.sensors.proximity import RANGE_M, ProximitySensor
from vsense.world.sensors.range_and_bearing import ArgosNoise, RangeAndBearingSensor
from vsense.world.sightings import NEVER_NS
from vsense.world.world import World

Floats = NDArray[np.float64]
Robots = NDArray[np.void]

RAYS = 7
GREY = np.array([0.299, 0.587, 0.114]) / 255.0


def ring_headings(ring: Ring, robots: Robots) -> Floats:
    """Directions in which the sensors of robots (n,) look: (n, k) [rad], not wrapped."""
    return np.asarray(robots["yaw_rad"][:, None] + ring.places_rad)


def ring_points(
    ring: Ring,
    robots: Robots,
    radius_m: float = EPUCK.infrared.radius_m,
    height_m: float = EPUCK.infrared.height_m,
) -> Floats:
    """Places of the sensors of robots (n,): (n, k, 3) [m] in the arena."""
    headings = ring_headings(ring, robots)
    points = np.empty((*headings.shape, 3))
    points[..., 0] = robots["x_m"][:, None] + radius_m * np.cos(headings)
    points[..., 1] = robots["y_m"][:, None] + radius_m * np.sin(headings)
    points[..., 2] = height_m
    return points


def points_at(robots: Robots, ahead_m: ArrayLike, left_m: ArrayLike) -> Floats:
    """Points (k,) of the robots' own frame in the arena: (n, k, 2) [m]."""
    ahead, left = np.asarray(ahead_m, dtype=np.float64), np.asarray(left_m, dtype=np.float64)
    cosine, sine = np.cos(robots["yaw_rad"])[:, None], np.sin(robots["yaw_rad"])[:, None]
    x = robots["x_m"][:, None] + ahead * cosine - left * sine
    y = robots["y_m"][:, None] + ahead * sine + left * cosine
    return np.stack((x, y), axis=-1)


def proximity(sensor: ProximitySensor, world: World, robots: Robots) -> Floats:
    """What `ProximitySensor.read` gives."""
    fan = np.zeros(1)
    if sensor.field_of_view_rad > 0.0:
        fan = sensor.field_of_view_rad / 2.0 * np.linspace(-1.0, 1.0, RAYS)
    headings = ring_headings(sensor.ring, robots)[:, :, None] + fan
    generic = sensor.curve == "generic"
    place = (0.035, 0.06) if generic else (0.036, 0.032)
    starts = np.repeat(ring_points(sensor.ring, robots, *place)[:, :, None, :], len(fan), axis=2)
    ends = starts.copy()
    ends[..., 0] += sensor.range_m * np.cos(headings)
    ends[..., 1] += sensor.range_m * np.sin(headings)
    bodies: Bodies = virtual_bodies(world) if sensor.virtual_only else world.bodies()
    skip: Any = NOBODY
    if not sensor.virtual_only:
        skip = np.repeat(rows_of(world, robots), len(sensor.ring) * len(fan))
    shares = nearest(starts.reshape(-1, 3), ends.reshape(-1, 3), bodies, skip)
    if sensor.blind_within:
        shares[shares <= 0.0] = np.inf
    distances_m = sensor.range_m * shares.reshape(headings.shape).min(axis=2)
    if generic:
        return np.asarray(sensor.full * np.exp(-distances_m))
    return np.asarray(sensor.full * response(distances_m * (RANGE_M / sensor.range_m)))


def response(distance_m: Floats) -> Floats:
    """Reading of ARGoS's sensor at a distance, in [0, 1]; 0 beyond RANGE_M."""
    near = np.minimum(distance_m, RANGE_M)
    curve = 298.701 * near**2 - 36.8961 * near + 1.08212
    return np.where(distance_m <= RANGE_M, np.clip(curve, 0.0, 1.0), 0.0)


def virtual_bodies(world: World) -> Bodies:
    """Bodies that the real ring cannot sense."""
    robots = world.robots[world.real_robots :]
    things: list[Box | Cylinder] = [*world.cylinders(), *world.boxes()]
    standing = entity_rows([thing for thing in things if not thing.physical])
    return Bodies(np.concatenate((disc_rows(robots["x_m"], robots["y_m"]), standing)))


def ground(world: World, robots: Robots) -> Floats:
    """What `GroundSensor.read` gives; the sum's order is that of the kernel, no BLAS's."""
    points = points_at(robots, 0.03, (0.009, 0.0, -0.009))
    red, green, blue, _ = world.floor.sample(points.reshape(-1, 2)).T
    grey = red * GREY[0] + green * GREY[1] + blue * GREY[2]
    return np.clip(grey, 0.0, 1.0).reshape(len(robots), 3)


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


def near_pairs(
    reach: Reach, world: World, robots: Robots, candidates: NDArray[np.bool_], reaches_m: Floats
) -> Pairs:
    """Pairs of `robots` (n,) and `candidates` (m,), a mask of `world.robots`."""
    own, poses = rows_of(world, robots), world.robots
    east = poses["x_m"] - robots["x_m"][:, None]
    north = poses["y_m"] - robots["y_m"][:, None]
    range_m = np.where(reaches_m > 0.0, reaches_m, reach.range_m)
    near = east * east + north * north < np.square(range_m)
    near &= candidates & (poses["capture_ns"] != NEVER_NS)
    near[np.arange(len(own)), own] = False
    # Only few of all pairs are near: the others need no bearing.
    receiver, sender = np.nonzero(near)
    east, north = east[near], north[near]
    bearing = wrap_angle(np.arctan2(north, east) - robots["yaw_rad"][receiver])
    pairs = Pairs(receiver, sender, np.hypot(east, north), bearing)
    pairs = pairs.select(within(bearing, reach.field_of_view_rad))
    if reach.height_m is None or len(pairs) == 0:
        return pairs
    lines = np.empty((2, len(pairs), 3))
    for line, ends in zip(lines, (robots[pairs.receiver], poses[pairs.sender])):
        line[:, 0], line[:, 1], line[:, 2] = ends["x_m"], ends["y_m"], reach.height_m
    both = np.stack((own[pairs.receiver], pairs.sender), axis=1)
    turned = both[:, 0] > both[:, 1]  # from the first of both to the second
    lines[:, turned] = lines[::-1, turned]
    return pairs.select(~blocked(lines[0], lines[1], world.bodies(), both))


_REAL_CM = np.array([0.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 60.0, 80.0])
_REAL_MU = np.array(
    [7.64689, 7.596525, 7.24955, 7.084636, 6.984497, 6.917447, 6.823188, 6.828551, 6.828551]
)
_REAL_SIGMA = np.array(
    [
        0.3570609, 0.319231, 0.1926492, 0.1529397, 0.109233, 0.1216533, 0.1531546, 0.1418425,
        0.1418425,
    ]
)  # fmt: skip
_POWER = 9.06422181283387, -0.00565074879677167


def disturbed(
    noise: ArgosNoise, pairs: Pairs, random: np.random.Generator
) -> tuple[Floats, Floats]:
    """Ranges between the bodies [cm] and bearings [rad] of pairs, (p,) each."""
    distance_m, bearing_rad = pairs.distance_m, pairs.bearing_rad
    if noise.std_dev_m > 0.0:
        away_m = random.normal(0.0, noise.std_dev_m, len(pairs))
        inclination = random.uniform(0.0, np.pi, len(pairs))
        azimuth = random.uniform(0.0, 2.0 * np.pi, len(pairs))
        flat_m = away_m * np.sin(inclination)
        ahead_m = distance_m * np.cos(bearing_rad) + flat_m * np.cos(azimuth)
        left_m = distance_m * np.sin(bearing_rad) + flat_m * np.sin(azimuth)
        up_m = away_m * np.cos(inclination)
        distance_m = np.sqrt(ahead_m**2 + left_m**2 + up_m**2)
        bearing_rad = np.arctan2(left_m, ahead_m)
    range_cm = 100.0 * (distance_m - 2.0 * EPUCK.radius_m)
    if noise.real_range:
        mu, sigma = (np.interp(range_cm, _REAL_CM, table) for table in (_REAL_MU, _REAL_SIGMA))
        power = np.exp(mu + sigma * random.normal(0.0, 1.0, len(pairs)))
        range_cm = np.exp(_POWER[0] + _POWER[1] * power)
    return range_cm, bearing_rad


def range_and_bearing(
    sensor: RangeAndBearingSensor, world: World, robots: Robots, random: np.random.Generator
) -> Floats:
    """What `RangeAndBearingSensor.read` gives; draws from `random`."""
    messages, places = world.messages, sensor.max_messages
    heard = (messages["length"] > 0) | (not sensor.speaking_only)
    pairs = near_pairs(sensor.reach, world, robots, heard, messages["range_m"])
    if sensor.noise is not None or pairs.counts(len(robots)).max(initial=0) > places:
        pairs = pairs.first(places, random.random(len(pairs)))
    if sensor.loss_probability > 0.0:
        pairs = pairs.select(random.random(len(pairs)) >= sensor.loss_probability)
    range_cm = 100.0 * np.maximum(pairs.distance_m - 2.0 * EPUCK.radius_m, 0.0)
    bearing_rad = pairs.bearing_rad
    if sensor.noise is not None:
        range_cm, bearing_rad = disturbed(sensor.noise, pairs, random)
    data = messages["data"][pairs.sender, : sensor.data_size].astype(np.float64)
    silent = np.arange(sensor.data_size) >= messages["length"][pairs.sender][:, None]
    data[silent] = 0.0
    columns = np.column_stack((range_cm, bearing_rad, data))
    return pairs.reading(len(robots), places, columns)


CAMERA_HEIGHT_M = 0.122
RING_RAD = np.pi / 16 + np.pi / 4 * np.arange(8.0)
LEDS_M = np.array(
    [
        *((0.036 * np.cos(a), 0.036 * np.sin(a), 0.04) for a in RING_RAD),
        (0.018, 0.0311769, 0.0765),
        (0.018, -0.0311769, 0.0765),
        (-0.036, 0.0, 0.0765),
    ]
)
"""Of an e-puck. Source: argos3-epuck 66cb8d9, epuck_entity.cpp lines 24-46 and 190-210."""


def camera(
    sensor: OmnidirectionalCamera, world: World, robots: Robots, random: np.random.Generator
) -> Floats:
    """What `OmnidirectionalCamera.read` gives; draws from `random`."""
    leds_m, colors, owners = lit_leds(world)
    cameras_m = np.empty((len(robots), 3))
    cameras_m[:, 0], cameras_m[:, 1] = robots["x_m"], robots["y_m"]
    cameras_m[:, 2] = CAMERA_HEIGHT_M
    own = rows_of(world, robots)
    ways_m = leds_m - cameras_m[:, None, :]
    if sensor.square:
        near = (np.abs(ways_m[..., :2]) < sensor.reach_m).all(axis=2)
    else:
        near = np.einsum("nli,nli->nl", ways_m, ways_m) < sensor.reach_m**2
    near &= (owners != own[:, None]) & (ways_m[..., 2] < CAMERA_HEIGHT_M)
    seeing, seen = np.nonzero(near)
    free = ~blocked(cameras_m[seeing], leds_m[seen], world.bodies(), own[seeing])
    seeing, seen = seeing[free], seen[free]
    flat_m = shifted(sensor, ways_m[seeing, seen, :2], random)
    bearing = np.arctan2(flat_m[:, 1], flat_m[:, 0]) - robots["yaw_rad"][seeing]
    blobs = Pairs(seeing, seen, np.hypot(*flat_m.T), np.asarray(wrap_angle(bearing)))
    blobs = blobs.first(sensor.max_blobs, blobs.distance_m)
    columns = np.column_stack(
        (100.0 * blobs.distance_m, blobs.bearing_rad, colors[blobs.sender].astype(np.float64))
    )
    return blobs.reading(len(robots), sensor.max_blobs, columns)


def shifted(sensor: OmnidirectionalCamera, flat_m: Floats, random: np.random.Generator) -> Floats:
    """Moves places (b, 2) on the floor."""
    if sensor.noise_std_dev <= 0.0:
        return flat_m
    away_m = random.normal(0.0, sensor.noise_std_dev, len(flat_m))
    if sensor.square:
        away_m *= np.hypot(*flat_m.T)
    towards = random.uniform(0.0, 2.0 * np.pi, len(flat_m))
    moved_m: Floats = flat_m + np.column_stack((away_m * np.cos(towards), away_m * np.sin(towards)))
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
