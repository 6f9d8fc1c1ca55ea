"""The pollutant sensor: from its XML element to what every robot reads."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.arena import ArenaState
from vsense.base.errors import ConfigError
from vsense.base.xml.parsing import parse
from vsense.world.sensors.base import Scope
from vsense.world.sensors.pollutant import PollutantSensor, from_xml
from vsense.world.world import World

States = Callable[..., ArenaState]


def sensor(attributes: str = "", timesteps: int = 400) -> PollutantSensor:
    element = parse(f'<r xmlns:vs="urn:vsense:1"><s {attributes}/></r>'.encode(), "x.argos")
    return from_xml(element.child("s"), Scope({"epuck_22_1": 22, "ship_8_0": 8}, timesteps))


def test_robots_in_the_cone_read_one_and_all_others_zero(state: States) -> None:
    pollutant = sensor('max_distance="1.2"')
    world = World([1, 2, 3], [pollutant.source])
    world.update(
        state({1: (0.5, 0.3, 0), 2: (-0.5, 0.3, 0), 3: (0.86, 0, 0), 22: (0, 0, 1)}, 10**9), 0
    )
    readings = pollutant.read(world, world.robots)
    assert readings.shape == (3, 1)
    assert readings[:, 0].tolist() == [1.0, 0.0, 0.0]


def test_without_a_source_in_sight_there_is_no_pollution(state: States) -> None:
    pollutant = sensor()
    world = World([1], [pollutant.source])
    world.update(state({1: (0.1, 0, 0)}, 10**9), 0)
    assert pollutant.read(world, world.robots).tolist() == [[0.0]]


@given(
    st.lists(st.tuples(*[st.floats(-2, 2)] * 3), min_size=1, max_size=8),
    st.floats(-math.pi, math.pi),
)
def test_turning_the_arena_with_everything_in_it_leaves_readings_unchanged(
    state: States, places: list[tuple[float, float, float]], angle: float
) -> None:
    readings = []
    for turn in (0.0, angle):
        c, s = math.cos(turn), math.sin(turn)
        pollutant = sensor(f'direction_angle="{math.degrees(turn)!r}"')
        moved = {k: (c * x - s * y, s * x + c * y, yaw) for k, (x, y, yaw) in enumerate(places)}
        world = World(range(len(places)), [pollutant.source])
        world.update(state(moved | {22: (0, 0, 0)}, 10**9), 0)
        readings.append(pollutant.read(world, world.robots)[:, 0])
    cone = sensor().source.cone_at(0, 0, 0)
    clear = np.abs(cone.edge_distance([p[:2] for p in places])) > 1e-9
    assert np.array_equal(readings[0][clear], readings[1][clear])


def test_defect_9_the_source_is_named_in_the_file_and_not_compiled_in() -> None:
    assert sensor('pollutant_entity="ship_8_0"').source.tag == 8
    assert sensor().source.tag == 22
    with pytest.raises(ConfigError, match=r"'ghost_1_1'.*epuck_22_1"):
        sensor('pollutant_entity="ghost_1_1"')


def test_attributes_of_the_thesis() -> None:
    source = sensor(
        'direction_angle="-90" wide_angle="45" max_distance="2.5" rotation_timestep="50%"'
        ' rotation_angle="-30" vs:memory="0.5"'
    ).source
    assert math.degrees(source.direction_rad) == pytest.approx(-90)
    assert math.degrees(source.wide_rad) == pytest.approx(45)
    assert math.degrees(source.turn_rad) == pytest.approx(-30)
    assert (source.max_distance_m, source.memory_ns) == (2.5, 500_000_000)
    assert source.turn_timestep == 200
    assert sensor('rotation_timestep="7"').source.turn_timestep == 7
    assert math.degrees(sensor('rotation_timestep="7"').source.turn_rad) == pytest.approx(90)
