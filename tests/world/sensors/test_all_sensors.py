"""What holds for every shipped sensor: symmetries, bounds, layouts, bytes, and the settings."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.world.sensors.scenes import Motion, Places, arena_state, mount, rows, sensor, world_of
from vsense.base.native import lib
from vsense.config import devices
from vsense.robots.link.table import Direction, Entry, Table
from vsense.world.entities import (
    VIRTUAL_TAG_MIN,
    Arena,
    Box,
    Cylinder,
    Entity,
    Light,
    VirtualRobot,
    Zone,
)
from vsense.world.fields import Field
from vsense.world.sensors.bank import SensorBank
from vsense.world.sensors.base import Scope, layout_dtype
from vsense.world.world import World

Readings = NDArray[np.float64]
BARREL = 9
SCOPE = Scope(
    {"barrel_9_0": BARREL, "epuck_22_1": 22},
    100,
    entities={name: Zone(name, "circle", 0, 0, radius_m=0.1) for name in ("nest", "food")},
    fields=["trail"],
)
ARENA = Arena((4.0, 4.0, 1.0), (0.0, 0.0, 0.5))
WHERE = '<virtual_black_white_location_sensor vs:black="food" vs:white="nest"'
EVERY = {
    "ground": "<virtual_ground_sensor",
    "rgb_ground": "<virtual_rgb_ground_sensor",
    "light thesis": '<virtual_light_sensor vs:ring="24" vs:angles="false"',
    "light generic": '<virtual_light_sensor formula="generic" vs:angles="false"',
    "light epuck": '<virtual_light_sensor formula="epuck" vs:angles="false"',
    "pollutant": '<virtual_pollutant_sensor pollutant_entity="barrel_9_0"',
    "radiation": '<virtual_radiation_sensor radiation_entity="barrel_9_0"',
    "gps": "<gps_virtual_sensor",
    "destination": '<destination_virtual_sensor vs:target="nest"',
    "black_white_location": WHERE,
    "proximity": '<virtual_proximity_sensor vs:field_of_view="40" vs:range="0.5"',
    "proximity fused": '<virtual_proximity_sensor vs:fuse="true" vs:range="0.5"',
    "range_and_bearing": '<virtual_range_and_bearing_sensor vs:max_messages="20" data_size="2"',
    "field": '<virtual_field_sensor field="trail"',
    "leds": '<virtual_led_sensor vs:max_blobs="20"',
}


def test_every_shipped_sensor_is_here() -> None:
    names = {xml.removeprefix("<").split()[0] for xml in EVERY.values()}
    assert names == set(devices.factories(devices.SENSORS)) - {"vs:sensor"}


class Scene:
    """A random world with something for every sensor."""

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        spots = np.stack(np.meshgrid(np.arange(-3, 4), np.arange(-3, 4)), -1).reshape(-1, 2)
        spots = 0.3 * random.permutation(spots) + random.uniform(-0.05, 0.05, (49, 2))
        yaws = random.uniform(-math.pi, math.pi, 49)
        taken = iter([(x, y, yaw) for (x, y), yaw in zip(spots.tolist(), yaws.tolist())])
        self.places: Places = {tag: next(taken) for tag in (1, 2, 3, 4, 5, 6, BARREL)}
        (x, y, yaw), (u, v, _) = next(taken), next(taken)
        self.entities: list[Entity] = [
            Box("wall", (x, y, 0.0), (0.2, 0.05, 0.1), yaw),
            Cylinder("post", (u, v, 0.0), 0.06, 0.2),
            VirtualRobot("ghost", VIRTUAL_TAG_MIN, *next(taken)),
            Light("sun", (*next(taken)[:2], 1.2), 0.8),
            Light("lamp", (*next(taken)[:2], 0.1), 0.5),
        ]
        for name, color in (("nest", (9, 99, 200)), ("food", (250, 120, 3)), ("mud", (80, 60, 40))):
            x, y, yaw = next(taken)
            size = (1.6, 0.7)
            self.entities.append(Zone(name, "rectangle", x, y, 0.0, size, yaw, color))
        self.colors = random.integers(0, 256, (7, 3))
        self.bytes = random.integers(0, 256, (7, 2))

    def world(self, motion: Motion) -> World:
        """Makes the world, moved as a whole."""
        places = {tag: motion.place(place) for tag, place in self.places.items()}
        fields = [Field("trail", ARENA, 0.1, initial=2.0)]
        world = world_of(places, map(motion.entity, self.entities), objects=[BARREL], fields=fields)
        world.leds[:] = self.colors
        world.messages["length"] = 2
        world.messages["data"][:, :2] = self.bytes
        return world


STAY = Motion(0.0, (0.0, 0.0), False)


def by_range(readings: Readings, width: int, sign: float) -> Readings:
    """Messages in the order of their ranges, their bearings with a sign."""
    moved = np.zeros_like(readings)
    moved[:, 0] = readings[:, 0]
    for row, reading in zip(moved, readings):
        slots = reading[1:].reshape(-1, width)[: int(reading[0])]
        slots = slots[np.argsort(slots[:, 0])] * np.array([1.0, sign] + [1.0] * (width - 2))
        row[1 : 1 + slots.size] = slots.reshape(-1)
    return moved


def ring_back(readings: Readings) -> Readings:
    """The even ring, counted the other way round from straight ahead."""
    count = readings.shape[1]
    return readings[:, -np.arange(count) % count]


def moved_poses(readings: Readings, motion: Motion) -> Readings:
    moved = readings.copy()
    moved[:, :3] = [motion.place(tuple(reading[:3])) for reading in readings.tolist()]
    return moved


def expected(name: str, readings: Readings, motion: Motion) -> Readings:
    """What is read after the whole arena has moved."""
    flip = motion.sign < 0
    if name == "gps":
        return moved_poses(readings, motion)
    if name == "destination":
        moved = moved_poses(readings, motion)
        moved[:, 4] *= motion.sign
        return moved
    if name in ("range_and_bearing", "leds"):
        return by_range(readings, 4 if name == "range_and_bearing" else 5, motion.sign)
    if not flip:
        return readings
    if name == "black_white_location":
        return readings * np.array([1.0, -1.0, 1.0, -1.0])
    backwards: dict[str, Callable[[Readings], Readings]] = {
        "light thesis": ring_back,
        "ground": lambda readings: readings[:, ::-1],
        "light generic": lambda readings: readings[:, ::-1],
        "light epuck": lambda readings: readings[:, ::-1],
        "proximity": lambda readings: readings[:, ::-1],
        "proximity fused": lambda readings: readings[:, ::-1],
    }
    return backwards.get(name, lambda readings: readings)(readings)


MOTIONS = {
    "shifted": Motion(0.0, (3.7, -11.3), False),
    "turned": Motion(2.1, (0.0, 0.0), False),
    "turned by a half": Motion(math.pi, (0.0, 0.0), False),
    "mirrored": Motion(0.0, (0.0, 0.0), True),
    "all at once": Motion(-2.9, (-5.0, 0.4), True),
}
# The field's grid and the cone's direction in the XML do not move with the entities: their
# symmetries are tested beside them.
MOVABLE = sorted(set(EVERY) - {"field", "pollutant"})
# ps1 and ps6 of the real ring are 0.1 degrees from being mirror images.
LOOSE = {"light generic": 2e-2, "light epuck": 2e-2, "proximity": 300.0, "proximity fused": 300.0}


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", MOVABLE)
def test_moving_the_arena_with_everything_in_it_moves_nothing_else(name: str, motion: str) -> None:
    device, move = sensor(EVERY[name] + "/>", SCOPE), MOTIONS[motion]
    loose = LOOSE.get(name, 0.0) if move.sign < 0 else 0.0
    informative = 0
    for seed in range(12):
        scene = Scene(seed)
        before = rows(device, scene.world(STAY))
        after = rows(device, scene.world(move))
        if name in ("range_and_bearing", "leds"):
            after = by_range(after, 4 if name == "range_and_bearing" else 5, 1.0)
        wanted = expected(name, before, move)
        wraps = np.broadcast_to(device.scale.wraps, wanted.shape)
        difference = np.abs(after - wanted)
        difference = np.where(wraps, np.minimum(difference, 2 * math.pi - difference), difference)
        assert difference.max() <= 1e-7 * (1 + np.abs(wanted).max()) + loose, seed
        informative += len(np.unique(before.round(9))) > 2
    assert informative >= 6


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_turning_a_field_with_its_robots_leaves_its_readings(quarters: int) -> None:
    device = sensor('<virtual_field_sensor field="trail"/>', SCOPE)
    hills = np.random.default_rng(1).uniform(0, 9, (40, 40))
    readings = []
    for turns in (0, quarters):
        move = Motion(turns * math.pi / 2, (0.0, 0.0), False)
        places = {tag: move.place(place) for tag, place in Scene(3).places.items()}
        world = world_of(places, fields=[Field("trail", ARENA, 0.1)])
        # Row 0 has the lowest y: seen from above, np.rot90 turns it the other way.
        world.fields["trail"].concentration[:] = np.rot90(hills, -turns)
        readings.append(rows(device, world))
    np.testing.assert_allclose(readings[0], readings[1], atol=1e-6)


def bank_of(settings: str, blind: bool = False, seed: int = 0) -> tuple[SensorBank, list[str]]:
    names = [
        name for name in EVERY if " " not in name or name in ("light epuck", "proximity fused")
    ]
    scope = Scope(SCOPE.tags, 100, entities=SCOPE.entities, fields=SCOPE.fields)
    mounted = [mount(f"{EVERY[name]} {settings}/>", scope) for name in names]
    return SensorBank(mounted, [1, 2, 3, 4, 5, 6], blind, seed), names


def numbers(layout: str, value: bytes) -> Readings:
    _, dtype = layout_dtype(layout)
    return np.frombuffer(value, dtype).astype(np.float64)


@pytest.mark.parametrize("name", sorted(EVERY))
def test_every_layout_is_one_that_robots_read(name: str) -> None:
    device = sensor(EVERY[name] + "/>", SCOPE)
    table = Table([Entry(1, device.name, device.layout, Direction.SENSOR)])
    reading = rows(device, Scene(0).world(STAY))
    count, dtype = layout_dtype(device.layout)
    assert reading.shape == (6, count)
    assert table.sizes == (count * dtype.itemsize,)


def test_all_sensors_with_their_defaults_fit_half_a_datagram() -> None:
    defaults = [xml.replace(' vs:max_messages="20" data_size="2"', "") for xml in EVERY.values()]
    devices = [sensor(xml.replace(' vs:max_blobs="20"', "") + "/>", SCOPE) for xml in defaults]
    layouts = {device.name: device.layout for device in devices}
    table = Table(Entry(i, *item) for i, item in enumerate(layouts.items(), 1))
    assert len(layouts) == 13
    assert sum(table.sizes) < lib.VS_DATAGRAM_MAX / 2


@pytest.mark.parametrize(
    ("name", "units"),
    [
        ("rgb_ground", (255.0, 255.0, 255.0, 0.0)),
        ("leds", (0.0, *(100.0, 1.0, 255.0, 255.0, 255.0) * 20)),
    ],
)
def test_a_unit_of_a_colour_is_its_whole_range(name: str, units: tuple[float, ...]) -> None:
    """What is no quantity, a flag or a count, has none."""
    scale = mount(EVERY[name] + "/>", SCOPE).sensor.scale
    assert np.asarray(scale.unit).tolist() == list(units)


EXTREMES = [(0.0, 0.0, 0.0), (1e-300, 0.0, math.pi), (1e3, -1e3, -3.0), (0.05, 0.0, 0.0)]


@pytest.mark.parametrize("name", sorted(EVERY))
def test_no_infinity_and_no_nan_wherever_robots_stand(name: str) -> None:
    # Everything on one spot: lights, sources, destinations and other robots at distance 0.
    entities: list[Entity] = [
        Light("sun", (0.0, 0.0, 0.032), 1e6),
        Light("lamp", (0.036, 0.0, 0.032), 1e-300),
        Box("box", (0.0, 0.0, 0.0), (0.1, 0.1, 0.1)),
        *(
            Zone(zone, "circle", 0.0, 0.0, radius_m=1.0, color=(1, 2, 3))
            for zone in ("nest", "food")
        ),
        VirtualRobot("ghost", VIRTUAL_TAG_MIN, 0.0, 0.0),
    ]
    places = dict(enumerate(EXTREMES, 1)) | {BARREL: (0.0, 0.0, 0.0)}
    device = mount(EVERY[name] + ' noise_std_dev="1e6" vs:drift="1e6"/>', SCOPE)
    world = world_of(places, entities, objects=[BARREL], fields=[Field("trail", ARENA, 0.1)])
    world.leds[:] = 255
    assert np.isfinite(rows(device.sensor, world)).all()
    world.update(arena_state(places), 10**6)
    for values in SensorBank([device], list(places)[:4]).encode(world, 0).values():
        got = numbers(device.sensor.layout, values[0][0])
        assert np.isfinite(got).all()
        low, high, unit = (
            np.broadcast_to(side, got.shape)
            for side in (
                device.sensor.scale.low,
                device.sensor.scale.high,
                device.sensor.scale.unit,
            )
        )
        rounding = 1e-6 * np.abs(got)
        assert ((got >= low - rounding) & (got <= high + rounding) | (unit == 0)).all()


def test_every_sensor_takes_every_setting_and_an_updating_condition() -> None:
    settings = (
        'noise_level="0.1" noise_std_dev="0.1" vs:bias="0.1" vs:drift="0.1" vs:low="0"'
        ' vs:high="1000" vs:bits="8" vs:latency="1" vs:drop_out="0.1" vs:update="change"'
    )
    bank, names = bank_of(settings)
    world = Scene(1).world(STAY)
    bank.encode(world, 0)
    sent = bank.encode(world, 1)
    assert len(sent[1]) == len(names)


def test_noise_changes_what_is_sent_and_repeats_with_the_seed() -> None:
    runs = []
    for settings, seed in (
        ("", 1),
        ('noise_level="0.05"', 1),
        ('noise_level="0.05"', 1),
        ('noise_level="0.05"', 2),
    ):
        bank, _ = bank_of(settings, seed=seed)
        runs.append(bank.encode(Scene(2).world(STAY), 0))
    assert runs[1] == runs[2]
    for sensor_number, name in enumerate(bank_of("")[1]):
        column = [[run[tag][sensor_number][0] for tag in run] for run in runs]
        assert column[0] != column[1] != column[3], name


def test_blind_holds_every_sensor_at_zero() -> None:
    bank, _ = bank_of('noise_level="0.05" vs:bias="1"', blind=True)
    for values in bank.encode(Scene(2).world(STAY), 0).values():
        assert all(not any(value) for value, _ in values)


@pytest.mark.parametrize("name", sorted(EVERY))
def test_a_robot_alone_in_an_empty_world_and_no_robot_at_all(name: str) -> None:
    device = sensor(EVERY[name] + "/>", SCOPE)
    empty = world_of({1: (0.0, 0.0, 0.0)}, fields=[Field("trail", ARENA, 0.1)])
    assert np.isfinite(rows(device, empty)).all()
    nobody = device.read(empty, empty.robots[:0])
    assert np.shape(nobody) == (0, layout_dtype(device.layout)[0])


@pytest.mark.parametrize("name", sorted(EVERY))
def test_a_robots_reading_does_not_depend_on_who_else_is_asked_about(name: str) -> None:
    device = sensor(EVERY[name] + "/>", SCOPE)
    world = Scene(5).world(STAY)
    whole = rows(device, world)
    part = np.asarray(device.read(world, world.robots[[4, 1]]))
    np.testing.assert_allclose(part, whole[[4, 1]], atol=1e-12)
