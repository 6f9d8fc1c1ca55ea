"""Bearings, rings and places of sensors."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.rigs.places import ROOT
from tests.world.sensors.numpy_sensors import points_at, ring_points
from tests.world.sensors.scenes import element, world_of
from vsense.base.errors import ConfigError
from vsense.world.entities import VIRTUAL_TAG_MIN, VirtualRobot
from vsense.world.robot_models import EPUCK
from vsense.world.sensors.geometry import Ring, field_of_view, rows_of, seen_from, within

ANGLES = st.floats(-math.pi, math.pi)
LENGTHS = st.floats(-5, 5)


def ring(text: str) -> Ring:
    return Ring.from_xml(element(f'<s vs:ring="{text}"/>'))


def test_the_ring_of_the_robot_is_that_of_the_controllers_header_and_of_the_lab() -> None:
    ours = Ring.from_xml(element("<s/>"))
    source = (ROOT / "robot" / "robot.c").read_text()
    declared = re.search(r"vs_robot_sensor_angle_rad\[8\] = \{([^}]+)\}", source)
    assert declared is not None
    controllers = [float(number) for number in declared[1].split(",")]
    np.testing.assert_allclose(ours.angles_rad, controllers, atol=1e-4)
    np.testing.assert_allclose(ours.places_rad, EPUCK.ring.headings_rad)


def test_an_even_ring_goes_round_counter_clockwise_from_straight_ahead() -> None:
    four = ring("4")
    np.testing.assert_allclose(four.angles_rad, np.radians([0, 90, 180, -90]))
    assert len(ring("24")) == 24
    assert ring("24").angles_rad.min() > -math.pi
    robots = world_of({1: (1.0, 2.0, math.pi / 2)}).robots
    at = [(1, 2.036), (0.964, 2), (1, 1.964), (1.036, 2)]
    np.testing.assert_allclose(ring_points(four, robots)[0], [(*p, 0.032) for p in at])


@pytest.mark.parametrize("text", ["0", "65", "-8", "8.0", "all", "1e2"])
def test_a_wrong_ring_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"vs:ring:.*'epuck', 'argos'.*1"):
        ring(text)


@given(LENGTHS, LENGTHS, ANGLES, st.floats(0.01, 5), ANGLES)
def test_a_point_placed_at_a_bearing_is_seen_there(
    x: float, y: float, yaw: float, distance: float, bearing: float
) -> None:
    robots = world_of({1: (x, y, yaw)}).robots
    ahead, left = distance * math.cos(bearing), distance * math.sin(bearing)
    (point,) = points_at(robots, [ahead], [left])[0]
    seen_distance, seen_bearing = seen_from(robots, [point[0]], [point[1]])
    assert float(seen_distance[0, 0]) == pytest.approx(distance, abs=1e-9)
    assert -math.pi < float(seen_bearing[0, 0]) <= math.pi
    off = math.remainder(float(seen_bearing[0, 0]) - bearing, 2 * math.pi)
    assert off == pytest.approx(0.0, abs=1e-6)


def test_defect_10_bearings_across_half_a_turn() -> None:
    robots = world_of({1: (0, 0, math.radians(179)), 2: (0, 0, math.radians(-179))}).robots
    x = [math.cos(math.radians(a)) for a in (-179, 179, 0)]
    y = [math.sin(math.radians(a)) for a in (-179, 179, 0)]
    _, bearing = seen_from(robots, x, y)
    np.testing.assert_allclose(np.degrees(bearing), [[2, 0, -179], [0, -2, 179]], atol=1e-9)


def test_rows_are_those_of_the_world_whoever_asks() -> None:
    ghost = VirtualRobot("ghost", VIRTUAL_TAG_MIN, 0.0, 0.0)
    world = world_of({31: (0, 0, 0), 7: (0, 0, 0), 19: (0, 0, 0)}, [ghost])
    robots = world.robots[[2, 0]]
    assert rows_of(world, robots).tolist() == [2, 0]
    assert rows_of(world, world.robots).tolist() == [0, 1, 2, 3]
    assert rows_of(world, world.robots[:0]).tolist() == []


def test_a_field_of_view_is_all_around_by_default_and_else_around_straight_ahead() -> None:
    bearings = np.radians([0.0, 29.0, -29.0, 31.0, 180.0])
    assert within(bearings, field_of_view(element("<s/>"))).all()
    narrow = field_of_view(element('<s vs:field_of_view="60"/>'))
    assert within(bearings, narrow).tolist() == [True, True, True, False, False]
    with pytest.raises(ConfigError, match=r"vs:field_of_view: 0.*range"):
        field_of_view(element('<s vs:field_of_view="0"/>'))
