"""The sensors in C against the same in NumPy, over random worlds: the same bits."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.world.sensors import numpy_sensors
from tests.world.sensors.scenes import STEP_NS, Place, arena_state, element, sensor
from vsense.base.native import kernel_ffi
from vsense.world.actuators import leds as leds_actuators
from vsense.world.actuators.messages import MessagesActuator
from vsense.world.entities import VIRTUAL_TAG_MIN, Box, Cylinder, Entity, Led, VirtualRobot, Zone
from vsense.world.fields import Floor
from vsense.world.robot_models import model_of
from vsense.world.sensors import omnidirectional_camera, proximity, range_and_bearing
from vsense.world.sensors.base import Scope
from vsense.world.sensors.omnidirectional_camera import OmnidirectionalCamera
from vsense.world.world import BODY_MEMORY_NS, MESSAGE, MESSAGE_MAX, World

Floats = NDArray[np.float64]

STEP_M = 0.0175
"""Places lie on a lattice of a quarter of a body: so many touch, or are the same."""

lattice = st.integers(-12, 12).map(lambda steps: STEP_M * steps)
anywhere = st.floats(-0.25, 0.25)
coordinates = st.one_of(lattice, anywhere)
yaws = st.one_of(
    st.integers(-8, 8).map(lambda eighths: eighths * math.pi / 8), st.floats(-math.pi, math.pi)
)
places = st.tuples(coordinates, coordinates, yaws)
sizes = st.sampled_from([0.0, 0.01, 0.035, 0.07, 0.3])
heights = st.sampled_from([0.0, 0.031, 0.032, 0.052, 0.053, 0.1, 0.122])


leds = st.lists(
    st.builds(
        lambda ahead, left, up, red: Led((ahead, left, up), (red, 0, 7 * (red > 1))),
        *(lattice, lattice, st.sampled_from([0.04, 0.1, 0.1221, 0.243, 0.245]), st.integers(0, 3)),
    ),
    max_size=3,
).map(tuple)


def boxes(name: str) -> st.SearchStrategy[Entity]:
    return st.builds(
        lambda place, low, size, up, real, lamps: Box(
            name, (*place[:2], low), (max(size, 0.001), 0.02, up + 0.001), place[2], real, lamps
        ),
        *(places, heights, sizes, heights, st.booleans(), leds),
    )


def posts(name: str) -> st.SearchStrategy[Entity]:
    return st.builds(
        lambda place, low, size, up, real, lamps: Cylinder(
            name, (*place[:2], low), size + 0.001, up + 0.001, real, lamps
        ),
        *(places, heights, sizes, heights, st.booleans(), leds),
    )


def ghosts(number: int) -> st.SearchStrategy[Entity]:
    return places.map(lambda p: VirtualRobot(f"ghost{number}", VIRTUAL_TAG_MIN + number, *p))


@st.composite
def worlds(draw: st.DrawFn) -> World:
    """Robots, virtual ones, things and a floor; the last two robots may not have been seen."""
    seen = draw(st.lists(places, min_size=1, max_size=7))
    entities = [
        *(draw(boxes(f"box{i}")) for i in range(draw(st.integers(0, 3)))),
        *(draw(posts(f"post{i}")) for i in range(draw(st.integers(0, 3)))),
        *(draw(ghosts(i)) for i in range(draw(st.integers(0, 2)))),
        *([Zone("spot", "circle", 0.1, 0.0, radius_m=0.1, color=(9, 60, 200))]),
    ]
    pixels = np.random.default_rng(len(seen)).integers(0, 256, (9, 7, 4), np.uint8)
    floor = Floor(pixels, draw(st.sampled_from([(0.3, 0.4), (2.0, 2.0)])), (0.01, 0.0))
    world = World([*range(len(seen)), 100, 101], entities=entities, floor=floor, seed=len(seen))
    once: dict[int, Place] = {100: draw(places)} if draw(st.booleans()) else {}
    world.update(arena_state(once), 0)
    later_ns = draw(st.sampled_from([STEP_NS, BODY_MEMORY_NS + STEP_NS + 1]))
    world.update(arena_state(dict(enumerate(seen)), later_ns), 1)
    return world


def argos(name: str, module: Any, more: str = "", most: int = 9) -> Any:
    return module.from_argos(element(f"<{name} {more}/>"), Scope({}, 0, most=most, leds=9))


PROXIMITY = {
    "argos": argos("epuck_proximity", proximity),
    "plain": sensor('<virtual_proximity_sensor vs:ring="epuck" />'),
    "fused": sensor('<virtual_proximity_sensor vs:fuse="true" />'),
    "all fused": sensor('<virtual_proximity_sensor vs:fuse="true" vs:obstacles="all" />'),
    "far": sensor('<virtual_proximity_sensor vs:ring="5" vs:range="0.4" vs:field_of_view="100" />'),
}


@pytest.mark.parametrize("name", PROXIMITY)
@given(world=worlds())
@settings(max_examples=60)
def test_proximity(name: str, world: World) -> None:
    device, robots = PROXIMITY[name], world.robots[: world.real_robots]
    expected = numpy_sensors.proximity(device, world, robots)
    np.testing.assert_array_equal(device.read(world, robots), expected)


@given(world=worlds())
def test_generic_proximity_but_for_the_last_bit_of_exponentials(world: World) -> None:
    """NumPy computes them with the processor's widest instructions, C with the C library."""
    device, robots = argos("proximity", proximity), world.robots
    expected = numpy_sensors.proximity(device, world, robots)
    np.testing.assert_array_max_ulp(device.read(world, robots), expected, 1)


@given(world=worlds())
def test_ground(world: World) -> None:
    robots = world.robots[: world.real_robots]
    readings = sensor("<virtual_ground_sensor />").read(world, robots)
    np.testing.assert_array_equal(readings, numpy_sensors.ground(world, robots))


@pytest.mark.parametrize("order", [(0, 2, 1), (1, 2, 0)])
def test_the_sum_of_colours_is_the_same_single_in_any_order(order: tuple[int, ...]) -> None:
    """So the order in which BLAS adds, which depends on the row, was never seen by a robot."""
    levels = np.arange(256.0)
    shares = [
        (levels * share).reshape([-1 if axis == i else 1 for axis in range(3)])
        for i, share in enumerate(numpy_sensors.GREY)
    ]
    a, b, c = (shares[i] for i in order)
    other = np.clip((a + b) + c, 0.0, 1.0).astype(np.float32)
    ours = np.clip((shares[0] + shares[1]) + shares[2], 0.0, 1.0).astype(np.float32)
    assert np.array_equal(ours, other)


@st.composite
def talking(draw: st.DrawFn) -> World:
    """A world in which some say something, as far as they say."""
    world = draw(worlds())
    random = np.random.default_rng(draw(st.integers(0, 99)))
    count = len(world.robots)
    world.messages["length"] = random.integers(0, 5, count)
    world.messages["data"] = random.integers(0, 256, (count, MESSAGE_MAX))
    world.messages["range_m"] = random.choice([0.0, 4 * STEP_M, 0.2, 0.8], count)
    return world


HEARING = {
    "all": sensor("<virtual_range_and_bearing_sensor />"),
    "too many": sensor('<virtual_range_and_bearing_sensor vs:max_messages="2" data_size="2" />'),
    "speaking": sensor(
        '<virtual_range_and_bearing_sensor vs:hear="speaking" range="0.105" vs:field_of_view="180"'
        ' check_occlusions="false" loss_probability="0.3" data_size="1" />'
    ),
    "argos": argos("epuck_range_and_bearing", range_and_bearing, 'loss_probability="0.4"'),
    "two": argos("epuck_range_and_bearing", range_and_bearing, 'max_packets="2"'),
    "any robot's": argos("range_and_bearing", range_and_bearing),
}
NOISY = {
    "noise": argos("epuck_range_and_bearing", range_and_bearing, 'noise_std_dev="0.02"'),
    "real range": argos(
        "epuck_range_and_bearing", range_and_bearing, 'noise_std_dev="0.3" real_range_noise="true"'
    ),
}


def both_ways(
    device: Any, world: World, reference: Callable[..., Any]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """What is read in C and in NumPy, which draw the same numbers."""
    robots = world.robots[: world.real_robots]
    before = np.random.Generator(np.random.PCG64())
    before.bit_generator.state = world.random.bit_generator.state
    readings = device.read(world, robots)
    expected = reference(device, world, robots, before)
    assert world.random.bit_generator.state == before.bit_generator.state
    return readings, expected


def check_but_for_bearings(readings: Floats, expected: Floats, width: int) -> None:
    """Readings are equal, bearings but for their last bit: the second of `width` numbers each."""
    bearings = np.zeros(readings.shape[1], dtype=bool)
    bearings[2::width] = True
    np.testing.assert_array_equal(readings[:, ~bearings], expected[:, ~bearings])
    np.testing.assert_allclose(readings[:, bearings], expected[:, bearings], rtol=0, atol=5e-15)


@pytest.mark.parametrize("name", HEARING)
@given(world=talking())
@settings(max_examples=60)
def test_range_and_bearing(name: str, world: World) -> None:
    """But for the last bit of arcus tangents, as with exponentials above."""
    readings, expected = both_ways(HEARING[name], world, numpy_sensors.range_and_bearing)
    check_but_for_bearings(readings, expected, 2 + HEARING[name].data_size)


@pytest.mark.parametrize("name", NOISY)
@given(world=talking())
def test_noisy_range_and_bearing(name: str, world: World) -> None:
    readings, expected = both_ways(NOISY[name], world, numpy_sensors.range_and_bearing)
    np.testing.assert_allclose(readings, expected, rtol=1e-13, atol=1e-13)


@given(
    world=talking(),
    size=st.integers(1, MESSAGE_MAX),
    numbers=st.lists(st.integers(0, 255), min_size=3 * MESSAGE_MAX, max_size=3 * MESSAGE_MAX),
    lengths=st.lists(st.integers(0, MESSAGE_MAX), min_size=3, max_size=3),
)
def test_messages(world: World, size: int, numbers: list[int], lengths: list[int]) -> None:
    rows = np.array([2, 0, 1])
    values = np.zeros((3, 1 + size))
    values[:, 0] = np.minimum(lengths, size)
    values[:, 1:] = np.reshape(numbers, (3, -1))[:, :size]
    expected = world.messages.copy()
    expected["length"][rows], expected["range_m"][rows] = values[:, 0], 0.7
    said = np.arange(size) < values[:, :1]
    expected["data"][rows] = 0
    expected["data"][rows[:, None], np.arange(size)] = np.where(said, values[:, 1:], 0.0)
    MessagesActuator(size, range_m=0.7).apply(world, rows, values, values)
    for field in ("length", "data", "range_m"):
        np.testing.assert_array_equal(world.messages[field], expected[field])


@st.composite
def shining(draw: st.DrawFn) -> World:
    """A world in which some LEDs of robots are lit."""
    world = draw(worlds())
    random = np.random.default_rng(draw(st.integers(0, 99)))
    world.led_colors[:] = random.integers(0, 256, world.led_colors.shape)
    world.led_colors[random.random(world.led_colors.shape[:2]) < 0.7] = 0
    return world


CAMERAS = {
    "epuck": argos("epuck_omnidirectional_camera", omnidirectional_camera),
    "few places": OmnidirectionalCamera(0.2, False, 0.0, 2),
    "square": OmnidirectionalCamera(0.105, True, 0.0, 25),
    "noisy": OmnidirectionalCamera(0.3, False, 0.05, 5),
    "noisy square": OmnidirectionalCamera(0.2, True, 0.3, 9),
}


@pytest.mark.parametrize("name", CAMERAS)
@given(world=shining())
@settings(max_examples=60)
def test_camera(name: str, world: World) -> None:
    """But for the last bit of arcus tangents."""
    readings, expected = both_ways(CAMERAS[name], world, numpy_sensors.camera)
    check_but_for_bearings(readings, expected, 5)
    blob = (100.0, 1.0, 255.0, 255.0, 255.0)  # cm, rad, the range of a colour
    assert CAMERAS[name].scale.unit == (0.0, *blob * CAMERAS[name].max_blobs)


@pytest.mark.parametrize("xml", ["epuck_rgb_leds", "leds", "epuck_base_leds"])
@given(
    world=shining(),
    numbers=st.lists(st.integers(0, 255), min_size=3 * 33, max_size=3 * 33),
    dark=st.integers(0, 33),
)
def test_single_leds(xml: str, world: World, numbers: list[int], dark: int) -> None:
    actuator, rows = leds_actuators.from_argos(element(f"<{xml} />"), Scope({}, 0)), [2, 0, 1]
    count, first = {"epuck_rgb_leds": (3, 8), "leds": (11, 0), "epuck_base_leds": (8, 0)}[xml]
    width = count if xml == "epuck_base_leds" else 3 * count
    values = np.reshape(numbers, (3, 33))[:, :width] * 1.0
    values[:, dark:] = 0.0
    expected = world.led_colors.copy()
    if width == count:
        red = np.array([255, 0, 0])
        expected[rows, :count] = np.where(values[:, ::-1, None] > 0.0, red, 0)
    else:
        expected[rows, first : first + count] = values.reshape(3, count, 3)
    whole = world.leds.copy()
    whole[rows] = expected[rows].max(axis=1)
    assert actuator.layout == f"{width}*u1"
    actuator.apply(world, np.array(rows), values, values)
    np.testing.assert_array_equal(world.led_colors, expected)
    np.testing.assert_array_equal(world.leds, whole)


def test_memory_that_c_and_numpy_share_is_laid_out_alike() -> None:
    kind = kernel_ffi.typeof("struct vs_message")
    assert kernel_ffi.sizeof(kind) == MESSAGE.itemsize and MESSAGE.fields is not None
    offsets = {name: MESSAGE.fields[name][1] for name in MESSAGE.names or ()}
    assert {name: field.offset for name, field in kind.fields} == offsets


def test_no_two_leds_of_a_robot_are_farther_apart_than_c_looks() -> None:
    for name in ("epuck", "footbot"):
        model = model_of(name)
        world = World([1], models={1: model})
        camera = OmnidirectionalCamera(0.3, True, 0.0, 25, model.camera.height_m)
        apart_m = camera.kernel(world, world.robots).cdata.apart_m
        leds_m = np.array(model.lamps_m)[:, :2]
        assert np.hypot(*(leds_m[:, None] - leds_m[None]).transpose(2, 0, 1)).max() <= apart_m < 0.2
