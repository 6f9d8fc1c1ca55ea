"""Bodies that give way to each other and to boxes; distances are in `tests/c/test_physics.c`."""

from __future__ import annotations

import numpy as np

from vsense.world.physics.motion import TICK_NS, Physics
from vsense.world.robot_models import EPUCK


def separated(
    robots: list[list[float]], objects: list[list[float]], boxes: list[list[float]]
) -> np.ndarray:
    """Places (n, 2) of robots that stand, and of objects, after one tick."""
    poses = [[[*place, 0.0] for place in places] for places in (robots, objects)]
    physics = Physics(poses[0], poses[1], boxes, 0)
    physics.tick(TICK_NS)
    return physics.poses[:, :2]


def test_nobody_moves_who_touches_nobody() -> None:
    places = [[0.0, 0.0], [0.0701, 0.0], [0.0, 0.0701]]
    moved = separated(places, [], [[-0.0401, 0, 0, 0.01, 1]])
    np.testing.assert_array_equal(moved, places)


def test_two_equals_give_way_alike() -> None:
    moved = separated([[0.0, 0.0], [0.066, 0.0]], [], [])
    np.testing.assert_allclose(moved, [[-0.002, 0.0], [0.068, 0.0]], atol=2e-5)


def test_who_cannot_move_does_not() -> None:
    moved = separated([[0.0, 0.0]], [[0.066, 0.0]], [])
    np.testing.assert_allclose(moved, [[-0.004, 0.0], [0.066, 0.0]], atol=2e-5)


def test_a_chain_carries_the_push_to_its_end() -> None:
    """Six in a row, the first 1 mm inside a wall: all move on by that millimetre."""
    places = [[0.07 * robot + EPUCK.radius_m - 1e-3, 0.0] for robot in range(6)]
    moved = separated(places, [], [[-0.005, 0, 0, 0.01, 1]])
    np.testing.assert_allclose(moved, [[x + 1e-3, y] for x, y in places], atol=5e-5)


def test_two_on_the_same_spot_are_parted() -> None:
    moved = separated([[0.0, 0.0], [0.0, 0.0]], [], [])
    assert np.hypot(*(moved[0] - moved[1])) > 2 * EPUCK.radius_m - 1e-4
