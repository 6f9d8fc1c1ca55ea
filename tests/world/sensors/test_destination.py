"""The destination: where to go, in the arena's frame and as the robot sees it."""

from __future__ import annotations

import math

import pytest

from tests.world.sensors.scenes import read, rows, sensor, world_of
from vsense.base.errors import ConfigError
from vsense.world.entities import Zone
from vsense.world.sensors.base import Scope

NEST = Zone("nest", "rectangle", 1.0, 2.0, size_m=(1.0, 1.0), yaw_rad=0.5)
SCOPE = Scope({"ship_8_0": 8}, 0, entities={"nest": NEST})
COMMON = '<destination_virtual_sensor vs:target="nest"/>'


def test_one_destination_for_all() -> None:
    places = {1: (1.0, 0.0, math.pi / 2), 2: (3.0, 2.0, 0.0), 3: (1.0, 2.0, 3.0)}
    readings = read(sensor(COMMON, SCOPE), places, [NEST])
    assert readings[0] == pytest.approx([1, 2, 0.5, 2.0, 0.0])
    assert readings[1] == pytest.approx([1, 2, 0.5, 2.0, math.pi])
    assert readings[2] == pytest.approx([1, 2, 0.5, 0.0, 0.0])


def test_it_follows_what_a_loop_function_moves() -> None:
    device, world = sensor(COMMON, SCOPE), world_of({1: (0, 0, 0)}, [NEST])
    world.move("nest", -1.0, 0.0, 1.0)
    assert rows(device, world)[0] == pytest.approx([-1, 0, 1, 1, math.pi])


@pytest.mark.parametrize("xml", ["", 'vs:target="destination_{tag}"'])
def test_every_robot_may_have_a_destination_of_its_own(xml: str) -> None:
    device = sensor(f"<destination_virtual_sensor {xml}/>")
    world = world_of({7: (0, 0, 0), 3: (1, 1, 1)})
    world.put(Zone("destination_7", "circle", 0.0, 2.0, radius_m=0.1))
    readings = rows(device, world)
    assert readings[0] == pytest.approx([0, 2, 0, 2, math.pi / 2])
    # Nobody has told robot 3 where to go: it has arrived.
    assert readings[1] == pytest.approx([1, 1, 1, 0, 0])


def test_a_tagged_thing_can_be_the_destination() -> None:
    device = sensor('<destination_virtual_sensor vs:target="ship_8_0"/>', SCOPE)
    assert read(device, {1: (0, 0, 0), 8: (0, -3, 0.25)}, objects=[8]) == [
        pytest.approx([0, -3, 0.25, 3, -math.pi / 2])
    ]


def test_a_place_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"vs:target:.*'home'"):
        sensor('<destination_virtual_sensor vs:target="home"/>', SCOPE)
