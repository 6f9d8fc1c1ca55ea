"""The proximity ring: table values, monotone, symmetric, nobody between two sensors unseen."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.world.physics.motion import Physics
from vsense.world.physics.proximity_ring import RING_RAW_MAX, ProximityRing, readings
from vsense.world.robot_models import EPUCK

HEADINGS_RAD, POSITIONS_M = EPUCK.ring.headings_rad, np.array(EPUCK.ring.places_m)
TABLE_M, TABLE_RAW = np.array(EPUCK.ring.table_m), np.array(EPUCK.ring.table_raw)
NOISE_RAW = EPUCK.ring.noise_raw

Rows = list[list[float]]
bearings = st.floats(-math.pi, math.pi)
ranges_m = st.floats(0.0705, 0.15)
sensors = st.integers(0, 7)
EXACTLY_MIRRORED = [0, 2, 3, 4, 5, 7]
"""Webots turns ps1 and ps6 by 45.9 and 45.8 degrees."""


def ring(me: list[float], others: Rows, boxes: Rows) -> tuple[ProximityRing, np.ndarray]:
    physics = Physics([me], others, boxes, 0)
    return ProximityRing(physics.near, 1), physics.poses


def clean(others: Rows, boxes: Rows, me: list[float] | None = None) -> np.ndarray:
    """Readings (8,) of a robot without noise."""
    proximity, poses = ring(me or [0, 0, 0], others, boxes)
    return readings(proximity.distances(poses))[0]


def ahead_of(sensor: int, distance_m: float) -> np.ndarray:
    """The point straight ahead of a sensor of the robot at the origin."""
    heading = HEADINGS_RAD[sensor]
    return POSITIONS_M[sensor] + distance_m * np.array([math.cos(heading), math.sin(heading)])


@pytest.mark.parametrize("sensor", range(8))
@pytest.mark.parametrize(("distance_m", "raw"), list(zip(TABLE_M, TABLE_RAW)))
def test_a_wall_straight_ahead_reads_as_in_the_table(sensor, distance_m, raw) -> None:
    middle = ahead_of(sensor, distance_m + 0.05)
    value = clean([], [[*middle, float(HEADINGS_RAD[sensor]), 0.1, 1.0]])[sensor]
    assert value == pytest.approx(raw, abs=1e-6)


@given(sensors, st.floats(0.0, 0.07))
def test_between_the_table_values_lies_a_straight_line(sensor, distance_m) -> None:
    middle = ahead_of(sensor, distance_m + 0.05)
    value = clean([], [[*middle, float(HEADINGS_RAD[sensor]), 0.1, 1.0]])[sensor]
    assert value == pytest.approx(np.interp(distance_m, TABLE_M, TABLE_RAW), abs=1e-6)


@given(sensors, st.floats(0.0, 0.1), st.floats(0.0, 0.1))
def test_who_comes_nearer_reads_no_lower(sensor, one_m, other_m) -> None:
    near_m, far_m = sorted((one_m, other_m))
    near, far = (
        clean([[*ahead_of(sensor, distance_m + EPUCK.radius_m), 0.0]], [])[sensor]
        for distance_m in (near_m, far_m)
    )
    assert near >= far


@given(bearings, ranges_m)
def test_a_mirrored_neighbour_reads_mirrored(bearing, range_m) -> None:
    x, y = range_m * math.cos(bearing), range_m * math.sin(bearing)
    one, other = clean([[x, y, 0.0]], []), clean([[x, -y, 0.0]], [])
    np.testing.assert_allclose(
        one[EXACTLY_MIRRORED], other[::-1][EXACTLY_MIRRORED], rtol=1e-6, atol=1e-6
    )


@given(bearings, ranges_m, bearings, st.floats(-2, 2), st.floats(-2, 2))
def test_turning_the_whole_arena_changes_no_reading(bearing, range_m, turn, x, y) -> None:
    def moved(pose: list[float]) -> list[float]:
        c, s = math.cos(turn), math.sin(turn)
        return [x + c * pose[0] - s * pose[1], y + s * pose[0] + c * pose[1], pose[2] + turn]

    other = [range_m * math.cos(bearing), range_m * math.sin(bearing), 0.3]
    wall = [0.06, -0.05, 0.4]
    here = clean([other], [[*wall, 0.02, 0.5]])
    there = clean([moved(other)], [[*moved(wall), 0.02, 0.5]], moved([0, 0, 0]))
    np.testing.assert_allclose(here, there, atol=0.01)


@given(bearings)
def test_a_touching_neighbour_is_felt_at_every_bearing(bearing) -> None:
    x, y = 0.0705 * math.cos(bearing), 0.0705 * math.sin(bearing)
    assert clean([[x, y, 0.0]], []).max() > 500


@given(st.floats(0.0, 0.06), st.integers(0, 5))
def test_a_ray_far_from_a_sensors_axis_counts_less(distance_m, ray) -> None:
    along = np.full((2, 7), np.inf)
    along[0, ray], along[1, 3] = distance_m, distance_m
    aside, ahead = readings(along)
    assert aside < ahead or ray == 3
    assert ahead == pytest.approx(np.interp(distance_m, TABLE_M, TABLE_RAW))


@given(bearings)
def test_a_neighbour_is_felt_most_on_its_side(bearing) -> None:
    x, y = 0.08 * math.cos(bearing), 0.08 * math.sin(bearing)
    strongest = int(clean([[x, y, 0.0]], []).argmax())
    place = math.atan2(POSITIONS_M[strongest, 1], POSITIONS_M[strongest, 0])
    assert math.cos(place - bearing) > math.cos(math.radians(45))


def test_readings_come_clockwise_from_the_front_right() -> None:
    for bearing, pair in ((-20, 0), (-90, 2), (-151, 3), (151, 4), (90, 5), (20, 7)):
        angle = math.radians(bearing)
        values = clean([[0.08 * math.cos(angle), 0.08 * math.sin(angle), 0.0]], [])
        assert values.argmax() == pair


@given(st.floats(0.075, 0.09), st.floats(0.17, 0.3), st.floats(-0.02, 0.02))
def test_who_stands_behind_another_is_not_felt(near_m, far_m, aside_m) -> None:
    shade = [near_m, 0.0, 0.0]
    np.testing.assert_array_equal(clean([shade, [far_m, aside_m, 0.0]], []), clean([shade], []))


@given(bearings)
def test_out_of_reach_is_nothing(bearing) -> None:
    other = [0.18 * math.cos(bearing), 0.18 * math.sin(bearing), 0.0]
    np.testing.assert_array_equal(clean([other], [[0.3, 0, 0, 0.1, 1]]), np.full(8, TABLE_RAW[-1]))


@settings(max_examples=20)
@given(bearings, ranges_m, bearings, st.floats(0.05, 0.12))
def test_rays_end_where_a_point_on_them_first_is_inside_something(
    bearing, range_m, wall_at, gap_m
) -> None:
    """Against an independent way to find hits: walking along each ray in tiny steps."""
    other = np.array([range_m * math.cos(bearing), range_m * math.sin(bearing)])
    c, s = math.cos(wall_at), math.sin(wall_at)
    wall = [gap_m * c, gap_m * s, wall_at, 0.02, 0.1]
    proximity, poses = ring([0, 0, 0], [[*other, 0.0]], [wall])
    found = proximity.distances(poses)[0]
    fan = np.radians(np.linspace(-30, 30, found.shape[1]))
    angles = HEADINGS_RAD[:, None] + fan
    step = 1e-4
    walk = np.arange(0, 0.07, step)
    points = (
        POSITIONS_M[:, None, None]
        + walk[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, :, None]
    )
    in_body = np.hypot(*np.moveaxis(points - other, -1, 0)) < EPUCK.radius_m
    offset = points - wall[:2]
    across, along = offset @ [c, s], offset @ [-s, c]
    hit = in_body | ((np.abs(across) < 0.01) & (np.abs(along) < 0.05))
    walked = np.where(hit.any(axis=-1), walk[hit.argmax(axis=-1)], np.inf)
    met = np.isfinite(walked)
    assert (np.abs(found[met] - walked[met]) <= 2 * step).all()
    # A ray that only grazes something can slip between two steps of the walk.
    assert np.count_nonzero(found[~met] < walk[-1]) <= 3


def test_noise_is_small_seeded_and_within_the_converter() -> None:
    physics = Physics([[0, 0, 0], [0.0705, 0, 0]], [], [], 0)
    one, same, other = (ProximityRing(physics.near, seed) for seed in (1, 1, 2))
    values = np.array([one.read(physics.poses) for _ in range(500)])
    again = np.array([same.read(physics.poses) for _ in range(500)])
    np.testing.assert_array_equal(values, again)
    assert (values[0] != other.read(physics.poses)).any()
    assert values.dtype == np.int16
    assert values.min() >= 0
    assert values.max() <= RING_RAW_MAX
    expected = readings(one.distances(physics.poses))
    assert (np.abs(values.mean(axis=0) - expected) < 2.0).all()
    assert (np.abs(values.std(axis=0) - NOISE_RAW) < 1.5).all()


def test_every_robot_has_its_own_ring() -> None:
    physics = Physics([[0, 0, 0], [0.08, 0, 0], [1, 1, 0]], [], [[1.06, 1, 0, 0.01, 1]], 0)
    values = readings(ProximityRing(physics.near, 1).distances(physics.poses))
    assert values[0].argmax() in (0, 7)
    assert values[1].argmax() in (3, 4)
    assert values[2].argmax() in (0, 7)


def test_a_cylinder_is_felt_by_its_own_size() -> None:
    for radius_m in (0.01, 0.2):
        physics = Physics([[0, 0, 0]], [], [], 0, [[0.0, 0.031 + 0.02 + radius_m, radius_m]])
        values = readings(ProximityRing(physics.near, 1).distances(physics.bodies))[0]
        assert values.argmax() == 5
        assert values[5] == pytest.approx(384.0, abs=1e-6)
