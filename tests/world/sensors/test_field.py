"""The field sensor: concentration under the robot, and its gradient in the robot's frame."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.world.sensors.scenes import read, rows, sensor, world_of
from vsense.base.errors import ConfigError
from vsense.world.entities import Arena
from vsense.world.fields import Field
from vsense.world.sensors.base import Scope

ARENA = Arena((4.0, 4.0, 1.0), (0.0, 0.0, 0.5))
SCOPE = Scope({}, 0, fields=["trail", "alarm"])


def slope(field: Field) -> None:
    """Makes it rise by 3 per metre along x and by 4 along y; 20 in the middle."""
    middles = -1.95 + 0.1 * np.arange(40)
    field.concentration[:] = 20.0 + 3.0 * middles + 4.0 * middles[:, None]


def test_value_and_gradient_ahead_and_left() -> None:
    device = sensor('<virtual_field_sensor field="trail"/>', SCOPE)
    yaws = [0.0, math.pi / 2, math.pi, -math.pi / 2, math.atan2(4.0, 3.0)]
    places = {k: (0.13, -0.27, yaw) for k, yaw in enumerate(yaws)}
    world = world_of(places, fields=[Field("trail", ARENA, 0.1)])
    slope(world.fields["trail"])
    readings = rows(device, world)
    np.testing.assert_allclose(readings[:, 0], 20 + 3 * 0.13 - 4 * 0.27)
    expected = [(3, 4), (4, -3), (-3, -4), (-4, 3), (5, 0)]
    np.testing.assert_allclose(readings[:, 1:], expected, atol=1e-9)


def test_the_gradient_leads_to_a_drop() -> None:
    field = Field("trail", ARENA, 0.05, diffusion_m2_s=0.01)
    world = world_of({1: (-0.5, 0.3, 2.0)}, fields=[field])
    field.deposit([(0.4, -0.2)], [1.0])
    for _ in range(100):
        world.step()
    value, ahead, left = rows(sensor('<virtual_field_sensor field="trail"/>', SCOPE), world)[0]
    assert value > 0
    bearing = math.atan2(-0.2 - 0.3, 0.4 + 0.5) - 2.0
    assert math.cos(math.atan2(left, ahead) - bearing) > 0.95


def test_each_field_may_have_its_own_sensor() -> None:
    second = sensor('<virtual_field_sensor field="alarm" name="alarm"/>', SCOPE)
    assert second.name == "alarm"
    assert sensor('<virtual_field_sensor field="trail"/>', SCOPE).name == "pheromone"
    fields = [Field("trail", ARENA, 0.1), Field("alarm", ARENA, 0.1, initial=2.0)]
    assert read(second, {1: (0, 0, 0)}, fields=fields) == [[2.0, 0.0, 0.0]]


def test_an_unknown_field_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"field:.*'tral'.*'trail'"):
        sensor('<virtual_field_sensor field="tral"/>', SCOPE)
