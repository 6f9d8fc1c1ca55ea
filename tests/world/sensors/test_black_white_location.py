"""Black and white location: two unit vectors in the robot's frame."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.world.sensors.scenes import read, sensor, world_of
from vsense.base.errors import ConfigError
from vsense.world.entities import Zone
from vsense.world.sensors.base import Scope

RECTANGLES = (
    '<virtual_black_white_location_sensor white_min_x="-1.2" white_min_y="-0.5"'
    ' white_max_x="-0.8" white_max_y="0.5" black_min_x="0" black_min_y="0.5" black_max_x="2"'
    ' black_max_y="1.5"/>'
)


def test_black_comes_first_then_white_each_as_x_ahead_and_y_left() -> None:
    places = {1: (0.0, 0.0, 0.0), 2: (1.0, 0.0, math.pi / 2), 3: (-1.0, 0.0, math.pi)}
    readings = read(sensor(RECTANGLES), places)
    half = math.sqrt(0.5)
    assert readings[0] == pytest.approx([half, half, -1, 0], abs=1e-12)
    assert readings[1] == pytest.approx([1, 0, 0, 1], abs=1e-12)
    # Robot 3 stands in the middle of the white one.
    assert readings[2] == pytest.approx([-2 / math.sqrt(5), -1 / math.sqrt(5), 0, 0], abs=1e-12)


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(-math.pi, math.pi))
def test_the_vectors_have_length_one_and_turn_with_the_robot(
    x: float, y: float, yaw: float
) -> None:
    (reading,) = read(sensor(RECTANGLES), {1: (x, y, yaw)})
    for middle, (ahead, left) in (((1, 1), reading[:2]), ((-1, 0), reading[2:])):
        if math.dist((x, y), middle) > 1e-6:
            assert math.hypot(ahead, left) == pytest.approx(1.0)
            toward = math.atan2(middle[1] - y, middle[0] - x)
            assert math.cos(math.atan2(left, ahead) + yaw - toward) == pytest.approx(1.0, abs=1e-6)


def test_places_may_be_entities_that_move_and_vanish() -> None:
    zones = {name: Zone(name, "circle", 0.0, 1.0, radius_m=0.1) for name in ("nest", "food")}
    scope = Scope({}, 0, entities=zones)
    xml = '<virtual_black_white_location_sensor vs:black="food" vs:white="nest"/>'
    device, world = sensor(xml, scope), world_of({1: (0, 0, 0)}, zones.values())
    world.move("food", 3.0, 0.0)
    np.testing.assert_allclose(device.read(world, world.robots), [[1, 0, 0, 1]], atol=1e-12)
    world.remove("nest")
    np.testing.assert_allclose(device.read(world, world.robots), [[1, 0, 0, 0]], atol=1e-12)


def test_a_missing_corner_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"black_min_x:.*missing"):
        sensor("<virtual_black_white_location_sensor/>")
