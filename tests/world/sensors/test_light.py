"""The light sensor: three formulas, occlusion, range, field of view, and the angles it tells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.world.sensors.scenes import read, rows, sensor, world_of
from vsense.base.errors import ConfigError
from vsense.world.entities import Box, Cylinder, Light

AT_RING = 0.032


def light(formula: str, more: str = 'vs:ring="4"') -> object:
    return sensor(f'<virtual_light_sensor formula="{formula}" vs:angles="false" {more}/>')


def lamp(x: float, y: float, z: float = AT_RING, intensity: float = 0.5) -> Light:
    return Light(f"lamp{x}{y}", (x, y, z), intensity)


def test_thesis_by_hand() -> None:
    # Ahead: 1 - 0.036 m away. Left and right: the line touches no body. Behind: the body is
    # in between.
    (reading,) = read(light("thesis"), {1: (0, 0, 0)}, [lamp(1.0, 0.0)])
    ahead, beside = 0.25 / 0.964**2, 0.25 / (1.0 + 0.036**2)
    assert reading == pytest.approx([ahead, beside, 0.0, beside])


def test_the_light_above_is_seen_by_all_and_its_height_counts() -> None:
    (reading,) = read(light("thesis"), {1: (0, 0, 0)}, [lamp(0.0, 0.0, 2.032)])
    assert reading == pytest.approx([0.25 / (4.0 + 0.036**2)] * 4)


def test_generic_is_the_same_but_at_most_one() -> None:
    lamps = [lamp(1.0, 0.0, 1.0, 2.0), lamp(0.1, 0.0, 0.5, 0.3)]
    places = {1: (0.0, 0.0, 0.3), 2: (-1.0, 2.0, -2.0)}
    thesis = np.array(read(light("thesis", ""), places, lamps))
    generic = np.array(read(light("generic", ""), places, lamps))
    assert thesis.max() > 1.0
    np.testing.assert_array_equal(generic, np.minimum(thesis, 1.0))


def test_epuck_by_hand() -> None:
    # 1 m ahead on the floor, intensity 0.5: D = 2, exp(-4); ahead times 1, to the side times 0.
    (reading,) = read(light("epuck"), {1: (0, 0, 0)}, [lamp(1.0, 0.0, 0.0)])
    assert reading == pytest.approx([math.exp(-4.0), 0.0, 0.0, 0.0], abs=1e-12)
    (reading,) = read(light("epuck", 'vs:ring="8"'), {1: (0, 0, 0)}, [lamp(1.0, 0.0, 0.0)])
    half = math.exp(-4.0) / 2
    assert reading == pytest.approx([2 * half, half, 0, 0, 0, 0, 0, half], abs=1e-12)


def test_epuck_sees_no_light_beyond_two_and_a_half_intensities() -> None:
    inside, outside = lamp(1.249, 0.0, 0.0), lamp(1.251, 0.0, 0.0)
    assert read(light("epuck"), {1: (0, 0, 0)}, [inside])[0][0] == pytest.approx(math.exp(-4.996))
    assert read(light("epuck"), {1: (0, 0, 0)}, [outside]) == [[0.0] * 4]


@pytest.mark.parametrize("formula", ["thesis", "generic", "epuck"])
def test_lights_add_up(formula: str) -> None:
    lamps = [lamp(1.0, 0.5, 0.3, 0.4), lamp(-0.5, 1.0, 0.2, 0.3)]
    alone = [np.array(read(light(formula, ""), {1: (0, 0, 1)}, [one])) for one in lamps]
    both = np.array(read(light(formula, ""), {1: (0, 0, 1)}, lamps))
    np.testing.assert_allclose(both, sum(alone), atol=1e-12)


@pytest.mark.parametrize("formula", ["thesis", "generic", "epuck"])
@pytest.mark.parametrize("x", [0.036, 0.0, 0.0360000001, 0.04])
def test_defect_9_a_light_at_no_distance_is_bounded(formula: str, x: float) -> None:
    strong = Light("strong", (x, 0.0, AT_RING), 1e6)
    (reading,) = read(light(formula), {1: (0, 0, 0)}, [strong])
    assert all(math.isfinite(value) for value in reading)
    assert max(reading) <= (1e12 / 0.01**2 if formula == "thesis" else 1.0)


@pytest.mark.parametrize("formula", ["thesis", "generic", "epuck"])
@given(st.floats(0.05, 3), st.floats(0.001, 1), st.floats(-math.pi, math.pi), st.floats(0, 1))
def test_no_sensor_reads_more_of_a_light_that_is_farther_away(
    formula: str, distance: float, step: float, bearing: float, z: float
) -> None:
    device = light(formula, 'vs:ring="1" vs:occlusions="false"')
    readings = []
    for d in (distance, distance + step):
        # Away from the sensor's own place, or for `epuck` from the robot's centre.
        x, height = (0.036, AT_RING) if formula != "epuck" else (0.0, 0.0)
        where = (x + d * math.cos(bearing), d * math.sin(bearing), height + z * d)
        readings.append(read(device, {1: (0, 0, 0)}, [Light("lamp", where, 0.7)])[0][0])
    assert readings[1] <= readings[0] * (1 + 1e-9)


@pytest.mark.parametrize("formula", ["thesis", "generic", "epuck"])
def test_defect_11_robots_boxes_and_cylinders_stand_in_the_light(formula: str) -> None:
    sun, robot = lamp(1.0, 0.0, 0.03), {1: (0.0, 0.0, 0.0)}
    free = read(light(formula), robot, [sun])[0][0]
    assert free > 0.0
    wall = Box("wall", (0.5, 0.0, 0.0), (0.01, 0.3, 0.1))
    post = Cylinder("post", (0.5, 0.0, 0.0), 0.02, 0.1)
    low = Box("low", (0.5, 0.0, 0.0), (0.01, 0.3, 0.01))
    aside = Cylinder("aside", (0.5, 0.3, 0.0), 0.02, 0.1)
    assert read(light(formula), robot, [sun, wall])[0][0] == 0.0
    assert read(light(formula), robot, [sun, post])[0][0] == 0.0
    assert read(light(formula), robot | {2: (0.5, 0.0, 0.0)}, [sun])[0][0] == 0.0
    assert read(light(formula), robot, [sun, aside])[0][0] == free
    assert read(light(formula), robot | {2: (0.5, 0.1, 0.0)}, [sun])[0][0] == free
    over = lamp(1.0, 0.0, 0.5)
    assert read(light(formula), robot, [over, low]) == read(light(formula), robot, [over])
    blind_to_walls = light(formula, 'vs:ring="4" vs:occlusions="false"')
    assert read(blind_to_walls, robot, [sun, wall])[0][0] == free


def test_a_robot_that_was_never_seen_and_one_that_is_long_gone_are_in_nobodys_light() -> None:
    world = world_of({1: (0, 0, 0)}, [lamp(1.0, 0.0, 0.03)])
    free = rows(light("thesis"), world)[0, 0]
    assert rows(light("thesis"), world_of({1: (0, 0, 0)}, [lamp(1.0, 0.0, 0.03)], objects=[5]))[
        0, 0
    ] == pytest.approx(free)


@pytest.mark.parametrize("formula", ["thesis", "generic", "epuck"])
def test_range_and_field_of_view(formula: str) -> None:
    robot, sun = {1: (0.0, 0.0, 0.0)}, lamp(0.8, 0.0, 0.03, 1.0)
    near = light(formula, 'vs:ring="8" vs:range="0.5"')
    narrow = light(formula, 'vs:ring="8" vs:field_of_view="80"')
    wide = light(formula, 'vs:ring="8" vs:field_of_view="100"')
    assert read(near, robot, [sun]) == [[0.0] * 8]
    assert [value > 0 for value in read(narrow, robot, [sun])[0]] == [True] + [False] * 7
    lit = [value > 0 for value in read(wide, robot, [sun])[0]]
    assert lit == [True, True] + [False] * 5 + [True]


def test_defect_10_epuck_across_half_a_turn() -> None:
    device = light("epuck", 'vs:ring="2"')
    for yaw_deg in (179.0, -179.0, 181.0, -181.0):
        yaw = math.remainder(math.radians(yaw_deg), 2 * math.pi)
        (reading,) = read(device, {1: (0, 0, yaw)}, [lamp(-1.0, 0.0, 0.0)])
        assert reading == pytest.approx([math.exp(-4) * (1 - 2 / 180), 0.0])


def test_each_readings_angle_is_told_after_the_readings() -> None:
    told = sensor('<virtual_light_sensor vs:ring="4"/>')
    assert (told.name, told.layout) == ("light", "8*f4")
    (reading,) = read(told, {1: (0, 0, 1)}, [])
    assert reading == pytest.approx([0, 0, 0, 0, 0, math.pi / 2, math.pi, -math.pi / 2])
    assert sensor("<virtual_light_sensor/>").layout == "16*f4"
    assert sensor('<virtual_light_sensor vs:ring="24" vs:angles="false"/>').layout == "24*f4"


def test_defaults_are_the_thesis_on_the_robots_own_ring() -> None:
    device = sensor("<virtual_light_sensor/>")
    assert device.formula == "thesis"
    np.testing.assert_allclose(np.degrees(device.ring.angles_rad[:2]), [-17.2, -45.9])


def test_lights_that_are_off_and_no_lights_at_all_are_dark() -> None:
    off = Light("off", (0.1, 0.0, 0.5), 0.0)
    faint = Light("faint", (0.1, 0.0, 0.5), 5e-324)
    for formula in ("thesis", "generic", "epuck"):
        for lamps in ([], [off], [faint]):
            assert read(light(formula), {1: (0, 0, 0)}, lamps) == [[0.0] * 4]


def test_an_unknown_formula_is_refused() -> None:
    with pytest.raises(ConfigError, match="formula: 'argos'"):
        light("argos")
