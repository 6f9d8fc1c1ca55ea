"""The world: who was seen where, how old that is, and when a cone goes."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.arena import POSE, ArenaState
from vsense.world.entities import VIRTUAL_TAG_MIN, VirtualRobot
from vsense.world.pollution import PollutantSource
from vsense.world.sightings import standing
from vsense.world.world import NEVER_NS, World

States = Callable[..., ArenaState]
SOURCE = PollutantSource(tag=22, direction_rad=0.0, wide_rad=1.0, max_distance_m=1.0)
STEP_NS = 100_000_000


def test_robots_keep_the_order_of_their_tags_and_strangers_are_passed_over(state: States) -> None:
    world = World([7, 3, 9])
    world.update(state({3: (3, 0, 0), 5: (5, 0, 0), 7: (7, 0, 0)}, STEP_NS), 0)
    assert world.robots["tag"].tolist() == [7, 3, 9]
    assert world.robots["x_m"].tolist() == [7.0, 3.0, 0.0]
    assert world.robots["seen"].tolist() == [True, True, False]
    assert world.robots["capture_ns"].tolist() == [STEP_NS, STEP_NS, NEVER_NS]


def test_an_arena_state_without_robots(state: States) -> None:
    world = World([7], [SOURCE])
    world.update(state({}, STEP_NS), 0)
    assert not world.robots["seen"].any()
    assert world.cone(SOURCE) is None
    World([]).update(state({7: (0, 0, 0)}, STEP_NS), 0)


def test_defect_12_a_lost_robot_is_not_silently_where_it_was(state: States) -> None:
    world = World([7])
    world.update(state({7: (1, 2, 3)}, STEP_NS), 0)
    for later, gone in ((2, {7: (9.0, 9.0, 0.0)}), (3, {})):
        world.update(state(gone, later * STEP_NS, lost=frozenset({7})), 0)
        robot = world.robots[0]
        assert not robot["seen"]
        assert (robot["x_m"], robot["y_m"]) == (1.0, 2.0)
        assert world.capture_ns - robot["capture_ns"] == (later - 1) * STEP_NS
    world.update(state({7: (4, 5, 0)}, 4 * STEP_NS), 0)
    assert world.robots[0]["seen"]
    assert world.robots[0]["x_m"] == 4.0


def test_defect_12_the_cone_of_a_lost_source_ages_and_goes(state: States) -> None:
    world = World([], [SOURCE])
    assert world.age_ns(SOURCE) is None
    assert world.cone(SOURCE) is None
    world.update(state({22: (0.5, -0.5, 0)}, STEP_NS), 0)
    assert world.age_ns(SOURCE) == 0
    last = STEP_NS + SOURCE.memory_ns
    world.update(state({22: (9, 9, 0)}, last, lost=frozenset({22})), 49)
    cone = world.cone(SOURCE)
    assert cone is not None
    assert (cone.x_m, cone.y_m) == (0.5, -0.5)
    assert world.age_ns(SOURCE) == SOURCE.memory_ns
    world.update(state({}, last + 1), 50)
    assert world.cone(SOURCE) is None
    world.update(state({22: (0.1, 0.2, 0)}, last + STEP_NS), 51)
    cone = world.cone(SOURCE)
    assert cone is not None
    assert (cone.x_m, cone.y_m) == (0.1, 0.2)


def test_the_cone_follows_a_moving_source_and_the_turning_wind(state: States) -> None:
    source = PollutantSource(22, 0.0, 1.0, 1.0, turn_timestep=2, turn_rad=1.5)
    world = World([], [source])
    seen = []
    for k in range(4):
        world.update(state({22: (0.1 * k, 0, 1.0)}, (k + 1) * STEP_NS), k)
        cone = world.cone(source)
        assert cone is not None
        seen.append((round(cone.x_m, 9), round(cone.direction_rad, 9)))
    assert seen == [(0.0, 0.0), (0.1, 0.0), (0.2, 1.5), (0.3, 1.5)]


PLACES = st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3, 3))
HISTORIES = st.lists(
    st.tuples(st.dictionaries(st.integers(1, 5), PLACES), st.frozensets(st.integers(1, 5))),
    max_size=8,
)


@given(HISTORIES)
def test_every_history_gives_each_robot_its_last_sighting(
    state: States, history: list[tuple[Mapping[int, tuple[float, float, float]], frozenset[int]]]
) -> None:
    world, last = World([4, 2]), {}
    for k, (places, lost) in enumerate(history, 1):
        world.update(state(places, k * STEP_NS, lost), k)
        last |= {tag: (place, k) for tag, place in places.items() if tag not in lost}
        for robot in world.robots:
            place, when = last.get(int(robot["tag"]), ((0.0, 0.0, 0.0), None))
            assert (robot["x_m"], robot["y_m"], robot["yaw_rad"]) == place
            assert robot["capture_ns"] == (NEVER_NS if when is None else when * STEP_NS)
            assert bool(robot["seen"]) == (when == k)


def test_the_world_does_not_change_the_arena_state(state: States) -> None:
    arena = state({7: (1, 2, 3), 22: (0, 0, 0)}, STEP_NS)
    before = arena.robots.copy()
    world = World([7], [SOURCE])
    world.update(arena, 0)
    world.update(state({}, 2 * STEP_NS), 1)
    assert np.array_equal(arena.robots, before)
    assert before.dtype == POSE


def test_a_virtual_robot_is_always_seen_where_it_is() -> None:
    (row,) = standing([VirtualRobot("ghost", VIRTUAL_TAG_MIN, 0.5, -0.2, 0.1)], 7)
    names = ("tag", "x_m", "y_m", "yaw_rad", "capture_ns", "seen", "confidence")
    assert [row[name] for name in names] == [VIRTUAL_TAG_MIN, 0.5, -0.2, 0.1, 7, True, 1.0]
