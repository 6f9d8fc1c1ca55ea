"""Virtual LEDs of others: coloured blobs around the robot, the nearest first."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from tests.world.sensors.scenes import Places, mount, rows, sensor, world_of
from vsense.world.entities import VIRTUAL_TAG_MIN, Box, Cylinder, Entity, VirtualRobot
from vsense.world.sensors.bank import SensorBank
from vsense.world.world import World

RED, GREEN, BLUE = (255, 0, 0), (0, 255, 0), (0, 0, 255)


def lit(places: Places, colors: dict[int, tuple[int, int, int]], *entities: Entity) -> World:
    world = world_of(places, entities)
    for tag, color in colors.items():
        world.leds[world.robots["tag"] == tag] = color
    return world


def leds(more: str = "") -> object:
    return sensor(f"<virtual_led_sensor {more}/>")


def blobs(device: object, world: World) -> list[list[list[float]]]:
    found = []
    for reading in rows(device, world):
        slots = reading[1:].reshape(-1, 5)
        assert not slots[int(reading[0]) :].any()
        found.append(slots[: int(reading[0])].tolist())
    return found


def test_lit_robots_are_seen_the_nearest_first() -> None:
    places = {1: (0.0, 0.0, math.pi), 2: (0.8, 0.0, 0.0), 3: (0.0, 0.5, 0.0), 4: (0.3, -0.2, 0.0)}
    seen = blobs(leds(), lit(places, {2: RED, 3: (1, 2, 3)}))
    assert seen[0] == [
        pytest.approx([50.0, -math.pi / 2, 1, 2, 3]),
        pytest.approx([80.0, math.pi, 255, 0, 0]),
    ]
    # Robot 2 does not see itself; robot 4 is dark.
    assert [len(robot) for robot in seen] == [2, 1, 1, 2]


def test_range_field_of_view_and_number() -> None:
    around = {k: (0.1 * k * math.cos(k), 0.1 * k * math.sin(k), 0.0) for k in range(1, 8)}
    world = lit({0: (0.0, 0.0, 0.0)} | around, dict.fromkeys(around, GREEN))

    def distances(more: str) -> list[int]:
        device = leds(f'check_occlusions="false" {more}')
        return [round(blob[0]) for blob in blobs(device, world)[0]]

    assert distances("") == [10, 20, 30, 40, 50, 60]
    assert distances('vs:max_blobs="8"') == [10, 20, 30, 40, 50, 60, 70]
    assert distances('vs:range="0.35"') == [10, 20, 30]
    assert distances('vs:field_of_view="120"') == [10, 60, 70]


def test_defect_11_bodies_hide_them() -> None:
    pair = {1: (0.0, 0.0, 0.0), 2: (0.6, 0.0, 0.0)}
    wall = Box("wall", (0.3, 0.0, 0.0), (0.01, 0.1, 0.1))
    post = Cylinder("post", (0.3, 0.0, 0.0), 0.01, 0.03)
    assert [len(robot) for robot in blobs(leds(), lit(pair, {2: BLUE}, wall))] == [0, 0]
    assert [len(robot) for robot in blobs(leds(), lit(pair, {2: BLUE}, post))] == [1, 0]
    between = lit(pair | {3: (0.3, 0.0, 0.0)}, {2: BLUE})
    assert [len(robot) for robot in blobs(leds(), between)] == [0, 0, 1]
    through = leds('check_occlusions="false"')
    assert [len(robot) for robot in blobs(through, lit(pair, {2: BLUE}, wall))] == [1, 0]


def test_virtual_robots_shine_too() -> None:
    ghost = VirtualRobot("ghost", VIRTUAL_TAG_MIN, 0.0, 0.4)
    world = lit({1: (0.0, 0.0, 0.0)}, {VIRTUAL_TAG_MIN: RED}, ghost)
    assert blobs(leds(), world) == [[pytest.approx([40.0, math.pi / 2, 255, 0, 0])]]


def test_noise_stays_within_the_colours_and_out_of_empty_places() -> None:
    tags = list(range(400))
    places = {tag: (3.0 * (tag // 2), 0.3 * (tag % 2), 0.0) for tag in tags}
    world = lit(places, dict.fromkeys(tags, (255, 0, 128)))
    noisy = mount('<virtual_led_sensor noise_level="0.1" vs:max_blobs="2"/>')
    sent = SensorBank([noisy], tags).encode(world, 0)
    values = np.array([struct.unpack("<11f", sent[tag][0][0]) for tag in tags])
    colors = values[:, 3:6]
    assert (values[:, 0] == 1).all()
    assert not values[:, 6:].any()
    assert (colors.min(), colors.max()) == (0.0, 255.0)
    assert colors[:, 2].min() < 105 < 150 < colors[:, 2].max()
    assert (values[:, 1].min(), values[:, 1].max()) == pytest.approx((20, 40), abs=0.5)
