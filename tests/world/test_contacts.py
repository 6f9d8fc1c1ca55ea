"""Bodies and boxes: distances, neighbours, and giving way."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vsense.world.contacts import BODY_RADIUS_M, Boxes, Contacts, Neighbourhood

metres = st.floats(-0.5, 0.5)
sizes = st.floats(0.01, 0.6)
angles = st.floats(-3.14, 3.14)


def outline(row: tuple[float, float, float, float, float]) -> np.ndarray:
    """Points (k, 2) all around a box, at most 2 mm from each other."""
    x, y, yaw, size_x, size_y = row
    along = np.linspace(-0.5, 0.5, 301)
    edge = np.full_like(along, 0.5)
    local = np.concatenate(
        [
            np.stack(side, axis=1)
            for side in ((along, edge), (along, -edge), (edge, along), (-edge, along))
        ]
    ) * (size_x, size_y)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return local @ turn.T + (x, y)


@given(st.tuples(metres, metres, angles, sizes, sizes), metres, metres)
def test_the_distance_to_a_box_is_that_to_its_nearest_outline(row, x, y) -> None:
    point = np.array([[x, y]])
    gap, _ = Boxes.from_rows([row]).gaps(point, np.array([0]))
    nearest = np.hypot(*(outline(row) - point).T).min()
    assert abs(abs(gap[0]) - nearest) < 2e-3


@given(st.tuples(metres, metres, angles, sizes, sizes), metres, metres)
def test_the_way_out_of_a_box_leads_to_its_surface(row, x, y) -> None:
    boxes, box = Boxes.from_rows([row]), np.array([0])
    point = np.array([[x, y]])
    gap, normal = boxes.gaps(point, box)
    assert abs(np.hypot(*normal[0]) - 1.0) < 1e-12
    assert abs(boxes.gaps(point - gap[:, None] * normal, box)[0][0]) < 1e-9


def test_a_point_in_a_box_is_at_a_negative_distance() -> None:
    gap, normal = Boxes.from_rows([[0, 0, 0, 0.2, 0.4]]).gaps(
        np.array([[0.07, 0.0]]), np.array([0])
    )
    np.testing.assert_allclose(gap, [-0.03])
    np.testing.assert_allclose(normal, [[1.0, 0.0]])


@given(st.lists(st.tuples(metres, metres), min_size=2, max_size=12), st.integers(0, 2**32 - 1))
def test_pairs_hold_until_somebody_has_moved_far(places, seed) -> None:
    """A walk in small steps never leaves a pair out that is near enough to matter."""
    positions = np.array(places)
    step = np.random.default_rng(seed)
    near = Neighbourhood(len(positions), Boxes.from_rows([[0, 0.6, 0.3, 1, 0.01]]))
    for _ in range(30):
        positions = positions + step.uniform(-0.0013, 0.0013, positions.shape)
        near.update(positions)
        apart = np.hypot(*(positions[:, None] - positions[None]).transpose(2, 0, 1))
        np.fill_diagonal(apart, 1.0)
        must = set(zip(*np.nonzero(apart < 0.1 + BODY_RADIUS_M)))
        assert must <= set(zip(near.robot, near.body))


def contacts(positions: np.ndarray, mobility: list[float], rows: list[list[float]]) -> Contacts:
    near = Neighbourhood(len(positions), Boxes.from_rows(rows))
    return Contacts(np.array(mobility), near)


def test_nobody_moves_who_touches_nobody() -> None:
    positions = np.array([[0.0, 0.0], [0.0701, 0.0], [0.0, 0.0701]])
    before = positions.copy()
    contacts(positions, [1.0] * 3, [[-0.0401, 0, 0, 0.01, 1]]).separate(positions)
    np.testing.assert_array_equal(positions, before)


def test_two_equals_give_way_alike() -> None:
    positions = np.array([[0.0, 0.0], [0.066, 0.0]])
    contacts(positions, [1.0, 1.0], []).separate(positions)
    np.testing.assert_allclose(positions, [[-0.002, 0.0], [0.068, 0.0]], atol=2e-5)


def test_who_cannot_move_does_not() -> None:
    positions = np.array([[0.0, 0.0], [0.066, 0.0]])
    contacts(positions, [1.0, 0.0], []).separate(positions)
    np.testing.assert_allclose(positions, [[-0.004, 0.0], [0.066, 0.0]], atol=2e-5)


def test_a_chain_carries_the_push_to_its_end() -> None:
    """Six in a row, the first 1 mm inside a wall: all move on by that millimetre."""
    positions = np.stack([0.07 * np.arange(6) + BODY_RADIUS_M - 1e-3, np.zeros(6)], axis=1)
    expected = positions + np.array([1e-3, 0.0])
    contacts(positions, [1.0] * 6, [[-0.005, 0, 0, 0.01, 1]]).separate(positions)
    np.testing.assert_allclose(positions, expected, atol=5e-5)


def test_two_on_the_same_spot_are_parted() -> None:
    positions = np.zeros((2, 2))
    contacts(positions, [1.0, 1.0], []).separate(positions)
    assert np.hypot(*(positions[0] - positions[1])) > 2 * BODY_RADIUS_M - 1e-4
