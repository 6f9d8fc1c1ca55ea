"""The polluted triangle against the thesis's own formulas, an angular test, and symmetries."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from vsense.world.pollution import Cone, PollutantSource

ANGLES = st.floats(-2 * math.pi, 2 * math.pi)
LENGTHS = st.floats(0.1, 5.0)
PLACES = st.tuples(st.floats(-5, 5), st.floats(-5, 5))
CONES = st.builds(Cone, st.floats(-5, 5), st.floats(-5, 5), ANGLES, st.floats(0.05, 3.1), LENGTHS)
CLEAR_M = 1e-9
"""Points nearer to an edge than this may fall on either side of it by rounding alone."""


def barycentric(cone: Cone, x: float, y: float) -> bool:
    """The test as the thesis writes it (4.2.3, ComputePollutedCone and IsInPollutedCone)."""
    x1, y1 = cone.x_m, cone.y_m
    low, high = cone.direction_rad - cone.wide_rad / 2, cone.direction_rad + cone.wide_rad / 2
    x2, y2 = x1 + cone.max_distance_m * math.cos(low), y1 + cone.max_distance_m * math.sin(low)
    x3, y3 = x1 + cone.max_distance_m * math.cos(high), y1 + cone.max_distance_m * math.sin(high)
    determinant = (y2 - y3) * (x1 - x3) + (x3 - x2) * (y1 - y3)
    r1 = ((y2 - y3) * (x - x3) + (x3 - x2) * (y - y3)) / determinant
    r2 = ((y3 - y1) * (x - x3) + (x1 - x3) * (y - y3)) / determinant
    return 0 <= r1 <= 1 and 0 <= r2 <= 1 and r1 + r2 <= 1


def angular(cone: Cone, x: float, y: float) -> bool:
    """Near enough along the axis, and bearing from the apex within half of the opening."""
    distance = math.hypot(x - cone.x_m, y - cone.y_m)
    bearing = math.atan2(y - cone.y_m, x - cone.x_m) - cone.direction_rad
    bearing = math.remainder(bearing, 2 * math.pi)
    reach = cone.max_distance_m * math.cos(cone.wide_rad / 2)
    return abs(bearing) <= cone.wide_rad / 2 and distance * math.cos(bearing) <= reach


def turned(points: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


@given(CONES, PLACES)
def test_agrees_with_the_thesis_and_with_the_angular_criterion(
    cone: Cone, point: tuple[float, float]
) -> None:
    assume(abs(float(cone.edge_distance(point))) > CLEAR_M * (1 + 10 / math.sin(cone.wide_rad)))
    inside = bool(cone.contains(point))
    assert inside == barycentric(cone, *point)
    assert inside == angular(cone, *point)


@given(CONES, st.lists(PLACES, min_size=1, max_size=20), ANGLES, PLACES)
def test_rotating_mirroring_and_shifting_everything_changes_nothing(
    cone: Cone, places: list[tuple[float, float]], angle: float, shift: tuple[float, float]
) -> None:
    points = np.array(places)
    before = cone.edge_distance(points)
    apex = np.array([cone.x_m, cone.y_m])
    x, y = turned(apex, angle) + shift
    rotated = Cone(x, y, cone.direction_rad + angle, cone.wide_rad, cone.max_distance_m)
    mirrored = Cone(cone.x_m, -cone.y_m, -cone.direction_rad, cone.wide_rad, cone.max_distance_m)
    for moved, image in (
        (rotated, turned(points, angle) + shift),
        (mirrored, points * [1, -1]),
    ):
        after = moved.edge_distance(image)
        np.testing.assert_allclose(np.abs(after), np.abs(before), atol=1e-9)
        clear = np.abs(before) > CLEAR_M
        assert np.array_equal(moved.contains(image)[clear], cone.contains(points)[clear])


@given(CONES)
def test_apex_is_inside_exactly_and_every_corner_to_rounding(cone: Cone) -> None:
    assert cone.contains((cone.x_m, cone.y_m))
    np.testing.assert_allclose(cone.edge_distance(cone.vertices()), 0.0, atol=1e-12)
    middle = cone.vertices().mean(axis=0)
    assert cone.contains(middle)
    assert float(cone.edge_distance(middle)) < 0.0


def test_edges_and_corners_of_a_cone_without_rounding_are_inside() -> None:
    cone = Cone(0.0, 0.0, 0.0, math.pi / 2, 1.0)
    reach = 1.0 * math.cos(math.pi / 4)
    on_edge = [(0.0, 0.0), (reach, 0.0), (reach, reach / 2)]
    assert cone.contains(on_edge).all()
    beyond = np.nextafter(reach, 2.0)
    assert not cone.contains([(beyond, 0.0), (-1e-12, 0.0), (0.0, 1e-12)]).any()


@pytest.mark.parametrize("direction_deg", [180.0, -180.0, 179.0, -179.0, 540.0])
def test_defect_10_angles_are_not_compared_without_wrapping_at_180_degrees(
    direction_deg: float,
) -> None:
    cone = Cone(0.0, 0.0, math.radians(direction_deg), math.radians(60), 1.0)
    bearings = np.radians([180 - 28, 180 + 28, -180 + 28, 180, -180, 0, 90, 180 - 32, 180 + 32])
    points = 0.5 * np.stack((np.cos(bearings), np.sin(bearings)), axis=-1)
    assert cone.contains(points).tolist() == [True] * 5 + [False] * 4


@given(CONES, PLACES, PLACES)
def test_edge_distance_is_continuous_and_its_sign_tells_inside(
    cone: Cone, a: tuple[float, float], b: tuple[float, float]
) -> None:
    distances = cone.edge_distance((a, b))
    assert abs(distances[0] - distances[1]) <= math.dist(a, b) + 1e-9
    assert np.array_equal(distances < 0, cone.contains((a, b)) & (distances != 0))


@given(CONES, PLACES)
def test_edge_distance_is_to_the_nearest_point_of_the_edge(
    cone: Cone, point: tuple[float, float]
) -> None:
    corners = cone.vertices()
    (ax, ay), (bx, by) = corners[1:] - corners[0]
    assert ax * by > ay * bx, "counter-clockwise"
    share = np.linspace(0, 1, 2001)[:, None]
    edge = np.concatenate([a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0))])
    nearest = np.linalg.norm(edge - point, axis=1).min()
    step = np.ptp(edge, axis=0).max() / 1000
    assert nearest - step <= abs(float(cone.edge_distance(point))) <= nearest + 1e-9


def test_the_wind_turns_at_its_timestep_counter_clockwise() -> None:
    source = PollutantSource(1, math.radians(170), 1.0, 1.0, turn_timestep=5, turn_rad=math.pi / 2)
    directions = [math.degrees(source.cone_at(0, 0, k).direction_rad) for k in (0, 4, 5, 6)]
    assert directions == pytest.approx([170, 170, -100, -100])
    assert PollutantSource(1, 0.0, 1.0, 1.0).cone_at(0, 0, 10**6).direction_rad == 0.0
