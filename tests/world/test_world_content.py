"""What else is in the world: virtual robots, bodies in the way, fields, the floor; and reset."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.rigs.lines import blocked
from vsense.base.arena import ArenaState
from vsense.world import Box, Cylinder, Floor, Light, VirtualRobot, World, Zone
from vsense.world.entities import Arena, WorldError
from vsense.world.fields import Field
from vsense.world.pollution import PollutantSource
from vsense.world.world import BODY_MEMORY_NS, NEVER_NS

States = Callable[..., ArenaState]
STEP_NS = 100_000_000
GHOST = VirtualRobot("ghost", 70_000, 0.5, 0.0, 1.0)
SOURCE = PollutantSource(tag=22, direction_rad=0.0, wide_rad=1.0, max_distance_m=1.0)


def free(world: World, start: tuple[float, ...], end: tuple[float, ...], skip: int = -1) -> bool:
    return not blocked([start], [end], world.bodies(), skip)[0]


def test_virtual_robots_come_after_the_real_ones_and_are_always_seen(state: States) -> None:
    world = World([9, 7], entities=[GHOST])
    assert world.real_robots == 2
    world.update(state({7: (1, 1, 0)}, STEP_NS), 0)
    assert world.robots["tag"].tolist() == [9, 7, 70_000]
    assert world.robots["seen"].tolist() == [False, True, True]
    assert world.robots["capture_ns"].tolist() == [NEVER_NS, STEP_NS, STEP_NS]
    world.move("ghost", 0.25, 0.5)
    assert world.robots[2]["x_m"] == 0.25 and world.robots[2]["yaw_rad"] == 1.0
    world.remove("ghost")
    assert world.robots["tag"].tolist() == [9, 7]


def test_leds_and_messages_follow_their_robots(state: States) -> None:
    world = World([9], entities=[GHOST, VirtualRobot("other", 70_001, 0, 0)])
    world.leds[:] = [(1, 0, 0), (2, 0, 0), (3, 0, 0)]
    world.messages["length"] = [1, 2, 3]
    world.remove("ghost")
    assert world.leds[:, 0].tolist() == [1, 3] and world.messages["length"].tolist() == [1, 3]
    world.put(GHOST)
    assert world.robots["tag"].tolist() == [9, 70_001, 70_000]
    assert world.leds[:, 0].tolist() == [1, 3, 0] and world.messages["length"].tolist() == [1, 3, 0]


def test_sightings_cannot_be_written_to(state: States) -> None:
    world = World([9])
    world.update(state({9: (1, 1, 0)}, STEP_NS), 0)
    with pytest.raises(ValueError, match="read-only"):
        world.robots["x_m"] = 3.0
    with pytest.raises(ValueError, match="read-only"):
        world.robots[0] = world.robots[0]


def test_everything_known_stands_in_the_way(state: States) -> None:
    world = World([1, 2], entities=[GHOST], objects=[30], sources=[SOURCE])
    places = {1: (0, 0, 0), 2: (0, 1, 0), 30: (0, 2, 0), 22: (0, 3, 0)}
    assert free(world, (-1, 0, 0.03), (0.4, 0, 0.03)), "nobody has been seen yet"
    world.update(state(places, STEP_NS), 0)
    for _, y, _ in places.values():
        assert not free(world, (-1, y, 0.03), (0.4, y, 0.03))
        assert free(world, (-1, y, 0.08), (0.4, y, 0.08)), "above the bodies"
    assert not free(world, (0.2, 0, 0.03), (1, 0, 0.03)), "virtual robots are bodies, too"
    assert free(world, (0, 0, 0.03), (0.4, 0, 0.03), skip=0)
    assert len(world.bodies()) == 5


def test_who_is_not_seen_is_in_the_way_for_a_while(state: States) -> None:
    world = World([1])
    world.update(state({1: (0, 0, 0)}, STEP_NS), 0)
    world.update(state({}, STEP_NS + BODY_MEMORY_NS), 1)
    assert not free(world, (-1, 0, 0.03), (1, 0, 0.03))
    world.update(state({}, STEP_NS + BODY_MEMORY_NS + 1), 2)
    assert free(world, (-1, 0, 0.03), (1, 0, 0.03))


def test_doors_open_while_the_world_runs() -> None:
    world = World([], entities=[Box("door", (0, 0, 0), (0.1, 1.0, 0.2))])
    line = (-1, 0, 0.1), (1, 0, 0.1)
    assert not free(world, *line)
    world.move("door", 0.0, 1.5)
    assert free(world, *line)
    world.put(Cylinder("post", (0.5, 0, 0), 0.1, 0.3))
    assert not free(world, *line)
    world.remove("post")
    assert free(world, *line)


def test_kinds_and_the_painted_floor() -> None:
    spot = Zone("spot", "circle", 0, 0, radius_m=1, color=(255, 0, 0))
    world = World([], entities=[Light("lamp", (0, 0, 1)), spot], floor=Floor(color=(0, 0, 9)))
    assert [light.id for light in world.lights()] == ["lamp"] and world.zones() == (spot,)
    assert world.boxes() == () and world.cylinders() == ()
    points = [(0, 0), (3, 0)]
    assert world.floor.sample(points)[:, 0].tolist() == [255.0, 0.0]
    world.move("spot", 3.0, 0.0)
    assert world.floor.sample(points)[:, 0].tolist() == [0.0, 255.0]
    world.floor = Floor(color=(7, 7, 7))
    assert world.floor.sample(points)[:, 0].tolist() == [7.0, 255.0]


def test_the_floor_is_white_where_nothing_is_said() -> None:
    assert World([]).floor.sample([(0, 0)]).tolist() == [[255.0] * 4]


def test_fields_evolve_by_a_timestep() -> None:
    smell = Field("smell", Arena((1, 1, 1), (0, 0, 0)), 0.05, evaporation_per_s=np.log(2.0))
    world = World([], fields=[smell], timestep_s=0.5)
    world.fields["smell"].deposit([(0, 0)], 1.0)
    world.step()
    world.step()
    assert smell.total() == pytest.approx(0.5)


def test_a_field_that_is_too_fast_for_the_timestep_is_refused() -> None:
    smell = Field("smell", Arena((1, 1, 1), (0, 0, 0)), 0.01, 0.0, 0.1)
    with pytest.raises(WorldError, match="too fast"):
        World([], fields=[smell], timestep_s=1.0)


def test_reset_goes_back_to_the_start(state: States) -> None:
    smell = Field("smell", Arena((1, 1, 1), (0, 0, 0)), 0.05)
    world = World([4], entities=[GHOST, Light("lamp", (0, 0, 1))], fields=[smell], seed=5)
    world.update(state({4: (1, 1, 0)}, STEP_NS), 0)
    first = world.random.random(3).tolist()
    world.move("ghost", 3.0, 3.0)
    world.remove("lamp")
    world.floor = Floor(color=(0, 0, 0))
    world.leds[:] = 9
    world.messages["length"] = 4
    world.results["measure"] = 3.0
    smell.deposit([(0, 0)], 1.0)
    world.reset()
    assert world.random.random(3).tolist() == first
    assert world.robots["x_m"].tolist() == [1.0, 0.5], "what was seen stays"
    assert list(world.entities) == ["ghost", "lamp"] and not world.results
    assert not world.leds.any() and not world.messages["length"].any() and smell.total() == 0.0
    assert world.floor.sample([(0, 0)])[0, 0] == 255.0


def test_seeds_decide_what_is_drawn() -> None:
    draws = [World([], seed=seed).random.random() for seed in (1, 1, 2)]
    assert draws[0] == draws[1] != draws[2]


def test_time_counts_from_the_runs_first_timestep(state: States) -> None:
    world = World([], timestep_s=0.2)
    times = []
    for timestep in (-3, 0, 1, 5):
        world.update(state({}, STEP_NS), timestep)
        times.append(world.time_s)
    assert times == [0.0, 0.0, 0.2, 1.0]


def test_poses_by_tag(state: States) -> None:
    world = World([4], sources=[SOURCE], entities=[GHOST])
    assert world.pose(4) is None and world.pose(99) is None
    world.update(state({4: (1, 2, 3), 22: (5, 6, 0)}, STEP_NS), 0)
    for tag, x_m in ((4, 1.0), (22, 5.0), (70_000, 0.5)):
        pose = world.pose(tag)
        assert pose is not None and pose["x_m"] == x_m


def test_a_robot_may_be_the_source(state: States) -> None:
    world = World([22], sources=[SOURCE])
    world.update(state({22: (0.5, 0.25, 0)}, STEP_NS), 0)
    cone = world.cone(SOURCE)
    assert cone is not None and (cone.x_m, cone.y_m) == (0.5, 0.25)
    assert len(world.objects) == 0 and len(world.bodies()) == 1


def test_a_thousand_robots(state: States) -> None:
    places = {tag: (tag % 40 / 4.0, tag // 40 / 4.0, 0.0) for tag in range(1000)}
    world = World(reversed(range(1000)))
    world.update(state(places, STEP_NS), 0)
    assert world.robots["tag"].tolist() == list(reversed(range(1000)))
    assert world.robots["x_m"][0] == places[999][0] and world.robots["seen"].all()
    start, end = np.array([(-1.0, 0.1, 0.03)]), np.array([(11.0, 0.1, 0.03)])
    assert not blocked(start, end, world.bodies())[0]
    assert blocked(start - [0, 0.1, 0], end - [0, 0.1, 0], world.bodies())[0]
