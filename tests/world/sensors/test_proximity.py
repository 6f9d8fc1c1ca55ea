"""The proximity ring that feels what is not there."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

import numpy as np
import pytest

from tests.world.sensors.scenes import STEP_NS, Place, element, mount, read, sensor, world_of
from vsense.base.errors import ConfigError
from vsense.world.entities import VIRTUAL_TAG_MIN, Box, Cylinder, VirtualRobot
from vsense.world.robot_models import model_of
from vsense.world.sensors import proximity
from vsense.world.sensors.bank import SensorBank
from vsense.world.sensors.base import RobotSettings, Scope

ONE_LINE = 'vs:ring="4" vs:field_of_view="0"'


def ring(more: str = "") -> object:
    return sensor(f"<virtual_proximity_sensor {ONE_LINE} {more}/>")


def wall(gap_m: float, physical: bool = False) -> Box:
    """A wall ahead of a robot in the origin, this far from its sensor."""
    return Box("wall", (0.036 + gap_m + 0.01, 0.0, 0.0), (0.02, 1.0, 0.1), physical=physical)


def shares_at(gaps_m: Sequence[float]) -> list[float]:
    """What one sensor of each of many robots reads before a wall, so far from it."""
    places = {tag: (-gap_m, 0.2 * tag, 0.0) for tag, gap_m in enumerate(gaps_m)}
    wide = Box("wall", (0.036 + 0.01, 0.0, 0.0), (0.02, 1000.0, 0.1))
    return [reading[0] / 4095.0 for reading in read(ring(), places, [wide])]


@pytest.mark.parametrize(
    ("distance", "share"),
    [
        (0.0, 1.0),
        (0.01, 298.701 * 1e-4 - 0.368961 + 1.08212),
        (0.02, 298.701 * 4e-4 - 0.737922 + 1.08212),
        (0.04, 298.701 * 16e-4 - 1.475844 + 1.08212),
        (0.0501, 0.0),
        (1.0, 0.0),
    ],
)
def test_the_response_by_hand(distance: float, share: float) -> None:
    assert shares_at([distance]) == [pytest.approx(share)]


def test_the_response_never_rises_with_the_distance() -> None:
    felt = shares_at(np.linspace(0.0, 0.06, 601).tolist())
    assert (np.diff(felt) <= 1e-12).all()
    assert (felt[0], felt[-1]) == (1.0, 0.0)


def test_a_wall_ahead_is_felt_ahead_only() -> None:
    (reading,) = read(ring(), {1: (0, 0, 0)}, [wall(0.02)])
    share = 298.701 * 4e-4 - 0.737922 + 1.08212
    assert reading == pytest.approx([4095 * share, 0, 0, 0])
    assert read(ring(), {1: (0, 0, 0)}, [wall(0.051)]) == [[0.0] * 4]
    assert read(ring(), {1: (0, 0, 0)}, [wall(-0.005)])[0][0] == 4095.0


def test_what_is_too_low_or_floats_above_is_not_felt() -> None:
    low = Box("low", (0.08, 0.0, 0.0), (0.02, 1.0, 0.03))
    above = Box("above", (0.08, 0.0, 0.04), (0.02, 1.0, 0.03))
    assert read(ring(), {1: (0, 0, 0)}, [low, above]) == [[0.0] * 4]


def test_the_own_body_is_not_felt_but_others_are() -> None:
    places = {1: (0.0, 0.0, 0.0), 2: (0.09, 0.0, 0.0)}
    first, second = read(ring(), places)
    felt = 4095 * shares_at([0.09 - 0.036 - 0.035])[0]
    assert first == pytest.approx([felt, 0, 0, 0])
    assert second == pytest.approx([0, 0, felt, 0])


def test_a_fused_ring_leaves_to_the_real_one_what_it_can_feel() -> None:
    fused = ring('vs:fuse="true"')
    assert (fused.name, ring().name) == ("+proximity", "proximity")
    robots = {1: (0.0, 0.0, 0.0), 2: (0.0, 0.09, 0.0)}
    real = [wall(0.02, physical=True), Cylinder("real", (-0.07, 0, 0), 0.02, 0.1, physical=True)]
    assert read(fused, robots, real)[0] == [0.0] * 4
    assert [value > 0 for value in read(ring(), robots, real)[0]] == [True, True, True, False]
    virtual = [
        wall(0.02),
        Cylinder("virtual", (-0.07, 0, 0), 0.02, 0.1),
        VirtualRobot("ghost", VIRTUAL_TAG_MIN, 0.0, -0.09),
    ]
    assert [v > 0 for v in read(fused, robots, virtual)[0]] == [True, False, True, True]
    everything = ring('vs:fuse="true" vs:obstacles="all"')
    assert read(everything, robots, real)[0][0] > 0
    replaced = ring('vs:obstacles="virtual"')
    assert (replaced.name, read(replaced, robots, real)[0]) == ("proximity", [0.0] * 4)


def test_doors_that_open_are_felt_no_more() -> None:
    device, world = ring('vs:fuse="true"'), world_of({1: (0, 0, 0)}, [wall(0.02)])
    assert device.read(world, world.robots)[0, 0] > 0
    world.move("wall", 0.0, 5.0)
    assert device.read(world, world.robots)[0].tolist() == [0.0] * 4
    world.move("wall", 0.066, 0.0)
    assert device.read(world, world.robots)[0, 0] > 0
    world.remove("wall")
    assert device.read(world, world.robots)[0].tolist() == [0.0] * 4


def test_no_robot_hides_between_two_sensors_of_a_fused_ring() -> None:
    fused = sensor('<virtual_proximity_sensor vs:fuse="true"/>')
    single = sensor('<virtual_proximity_sensor vs:fuse="true" vs:field_of_view="0"/>')
    missed = []
    for bearing in np.radians(np.arange(-180, 180, 3)):
        x, y = 0.085 * math.cos(bearing), 0.085 * math.sin(bearing)
        ghost = VirtualRobot("ghost", VIRTUAL_TAG_MIN, x, y)
        assert max(read(fused, {1: (0, 0, 0)}, [ghost])[0]) > 0, math.degrees(bearing)
        missed.append(max(read(single, {1: (0, 0, 0)}, [ghost])[0]) == 0)
    assert any(missed)


def test_a_longer_range_stretches_the_curve() -> None:
    long = ring('vs:range="0.5"')
    (share,) = shares_at([0.02])
    assert read(long, {1: (0, 0, 0)}, [wall(0.2)])[0][0] == pytest.approx(4095 * share)


def test_it_travels_as_the_whole_numbers_of_the_real_ring() -> None:
    bank = SensorBank([mount('<virtual_proximity_sensor vs:fuse="true"/>')], [1])
    assert (bank.table[0].name, bank.table[0].layout) == ("+proximity", "8*u2")
    world = world_of({1: (0, 0, 0)}, [wall(0.0)])
    ((value, capture_ns),) = bank.encode(world, 0)[1]
    readings = struct.unpack("<8H", value)
    assert capture_ns == STEP_NS
    # ps0 and ps7 look ahead, ps3 and ps4 back.
    assert min(readings[0], readings[7]) > 3900
    assert readings[3:5] == (0, 0)


def test_noise_is_a_share_of_the_whole_range() -> None:
    tags = range(500)
    noisy = mount('<virtual_proximity_sensor vs:fuse="true" vs:bias="0.5" noise_level="0.1"/>')
    world = world_of({tag: (float(tag), 0.0, 0.0) for tag in tags})
    sent = SensorBank([noisy], tags).encode(world, 0)
    readings = np.array([struct.unpack("<8H", sent[tag][0][0]) for tag in tags])
    assert (readings.min(), readings.max()) == (1638, 2457)


def test_wrong_attributes_are_refused() -> None:
    for xml, words in (
        ('vs:fuse="yes"', "vs:fuse: 'yes'"),
        ('vs:range="0"', "vs:range: 0.*range"),
        ('vs:obstacles="real"', "vs:obstacles: 'real'"),
        ('vs:ring="nine"', "vs:ring: 'nine'.*'epuck'"),
    ):
        with pytest.raises(ConfigError, match=words):
            sensor(f"<virtual_proximity_sensor {xml}/>")


@pytest.mark.parametrize(
    ("one", "one_reads", "other", "other_reads"),
    [
        (
            (-0.375632, 0.95763, 0.364415),
            (0.0, 0.966995, 0.744772, 0.0, 0.0, 0.0, 0.0, 0.0),
            (-0.382843, 1.027007, 0.514445),
            (0.0,) * 8,
        ),
        (
            (-0.063225, 0.554532, -2.988163),
            (0.0,) * 8,
            (-0.131308, 0.545639, -0.719996),
            (0.0,) * 8,
        ),
        (
            (0.921166, 0.51689, 1.428233),
            (0.94288, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.7622),
            (0.940924, 0.584029, -2.98385),
            (0.0,) * 8,
        ),
    ],
)
def test_robots_that_touch_read_what_argos_reads(
    one: Place, one_reads: Sequence[float], other: Place, other_reads: Sequence[float]
) -> None:
    """Poses and readings of a foraging swarm in ARGoS 3.0.0-beta59, argos3-epuck 66cb8d9."""
    device = proximity.from_argos(element("<epuck_proximity />"), Scope({}, 0))
    readings = read(device, {1: one, 2: other})
    for ours, theirs in zip(readings, (one_reads, other_reads)):
        in_argos_order = np.array(ours[::-1]) / proximity.ARGOS_FULL
        assert in_argos_order == pytest.approx(theirs, abs=1e-4)  # poses are rounded to 1e-6 m


@pytest.mark.parametrize("gap_m", [0.03, 0.0401, 0.06, 0.085, 0.119, 0.121])
@pytest.mark.parametrize("yaw_deg", [0.0, 20.0, 45.0])
def test_a_khepera_reads_the_curve_of_its_plug_in(gap_m: float, yaw_deg: float) -> None:
    """argos3-kheperaiv 235eaa1, kheperaiv_proximity_default_sensor.cpp: worked out by hand."""

    def reading(away_rad: float) -> float:
        along_m = (0.0704 + gap_m) / math.cos(away_rad) - 0.0704
        if abs(away_rad) >= math.pi / 2.0 or along_m > 0.12:
            return 0.0
        return 1.0 if along_m < 0.04 else min(max(4.14 * math.exp(-33.0 * along_m) - 0.085, 0), 1)

    scope = Scope({}, 0, robots=RobotSettings.of(model_of("kheperaiv")))
    device = proximity.from_argos(element("<kheperaiv_proximity />"), scope)
    ahead = Box("wall", (0.0704 + gap_m + 0.01, 0.0, 0.0), (0.02, 9.0, 0.1))
    (ours,) = read(device, {1: (0.0, 0.0, math.radians(yaw_deg))}, [ahead])
    # ARGoS counts counter-clockwise from straight ahead.
    away = [math.remainder(math.radians(yaw_deg + 45.0 * i), 2.0 * math.pi) for i in range(8)]
    in_argos_order = np.array(ours[::-1]) / proximity.ARGOS_FULL
    assert in_argos_order == pytest.approx([reading(rad) for rad in away], abs=1e-6)
