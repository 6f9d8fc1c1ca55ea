"""The way home in the bench's physics, with the daemon's own walk, and what goes wrong on it."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from tests.bench.homing import HomingField
from vsense.base.arena import POSE, ArenaState
from vsense.config.experiment import load
from vsense.config.specs import Pose
from vsense.robots.link.table import STAY, Goal
from vsense.run.homing import _traffic
from vsense.run.homing import floor as floor_module
from vsense.run.homing._homing import Homing
from vsense.run.homing.floor import DrivingFloor
from vsense.run.homing.robots import MIN_GAP_M, HomingLimits, Traveller, Trouble
from vsense.world.entities import Arena
from vsense.world.robot_models import EPUCK

ARENA = Arena((2.0, 2.0, 1.0), (0.0, 0.0, 0.0))
WALL = (0.0, 0.0, 0.0, 0.04, 1.2)
"""Across the middle, free at both ends."""


def test_robots_come_home_past_one_that_is_dead_and_one_that_is_not_seen() -> None:
    row = HomingField(3).run(3)
    assert (row.home, row.able) == (14, 14)
    assert row.is_good


def homing(homes: dict[int, Pose], floor: DrivingFloor | None = None, **limits: float) -> Homing:
    names = {tag: f"epuck_{tag}" for tag in homes}
    kinds = dict.fromkeys(homes, "a")
    return Homing(homes, names, kinds, floor or DrivingFloor(ARENA), HomingLimits(**limits))


def state(number: int, poses: dict[int, Pose]) -> ArenaState:
    rows = np.zeros(len(poses), dtype=POSE)
    for row, (tag, pose) in zip(rows, sorted(poses.items())):
        row["tag"], row["seen"] = tag, True
        row["x_m"], row["y_m"], row["yaw_rad"] = pose
    now_ns = 10**9 + number * 10**8
    return ArenaState(timestep=number, capture_ns=now_ns, robots=rows, detected=len(poses))


def test_who_is_home_stays_and_all_are_done() -> None:
    homes = {1: Pose(0.0, 0.0, 1.0), 2: Pose(0.5, 0.0, 0.0)}
    planned = homing(homes)
    goals = [planned.step(state(n, homes), {}) for n in range(8)]
    assert goals[0] == {1: STAY, 2: STAY}
    assert planned.done and not planned.news
    assert [arrival.trouble for arrival in planned.arrivals()] == ["", ""]


def test_a_goal_is_ahead_and_to_the_left_as_the_robot_sees_it() -> None:
    planned = homing({1: Pose(0.0, 0.05, 0.0)})
    # It looks along -y: what lies at +y is behind it.
    goal = planned.step(state(0, {1: Pose(0.0, 0.0, -math.pi / 2.0)}), {})[1]
    assert goal.x_mm <= -20 and abs(goal.y_mm) <= 1
    goal = planned.step(state(1, {1: Pose(0.05, 0.05, math.pi / 2.0)}), {})[1]
    assert goal.y_mm >= 20 and abs(goal.x_mm) <= 1
    goal = planned.step(state(2, {1: Pose(0.0, 0.05, -1.0)}), {})[1]
    assert goal == (0, 0, 10000)


def test_a_robot_that_does_not_move_is_freed_then_left_and_named() -> None:
    planned = homing({1: Pose(0.5, 0.0, 0.0)})
    stuck = {1: Pose(-0.5, 0.0, 0.0)}
    for number in range(200):
        planned.step(state(number, stuck), {})
        if planned.done:
            break
    assert [line for line in planned.news if "to free it" in line][-1].endswith(
        "try 3 of 3 to free it"
    )
    assert planned.news[-1] == "robot 1 is left where it is, 1.00 m from its start: stuck"
    assert planned.arrivals()[0].trouble == "stuck"
    assert planned.step(state(200, stuck), {}) == {1: STAY}


@pytest.mark.parametrize(
    ("trouble", "words"),
    [(Trouble.NO_LINK, "no link"), (Trouble.TOO_OLD, "deploy"), (Trouble.HELD, "battery")],
)
def test_who_cannot_be_told_is_named_and_waited_for_in_vain(trouble: Trouble, words: str) -> None:
    homes = {1: Pose(0.5, 0.0, 0.0), 2: Pose(-0.5, 0.0, 0.0)}
    planned = homing(homes, hindered_s=2.0)
    there = {1: homes[1], 2: Pose(0.0, 0.5, 0.0)}
    for number in range(60):
        planned.step(state(number, there), {2: trouble})
    assert planned.done
    assert words in planned.news[0]
    assert [words in arrival.trouble for arrival in planned.arrivals()] == [False, True]


def test_who_is_not_seen_stands_until_it_is_and_nobody_else_does() -> None:
    homes = {1: Pose(0.8, 0.0, 0.0), 2: Pose(-0.8, 0.0, 0.0)}
    there = {1: Pose(0.0, 0.5, 0.0), 2: Pose(0.0, -0.5, math.pi)}
    planned = homing(homes)
    planned.step(state(0, there), {})
    goals = [planned.step(state(n, {2: there[2]}), {}) for n in range(1, 6)]
    assert goals[-1][1] == STAY and goals[-1][2] != STAY
    assert "not seen" in planned.news[0]
    assert planned.step(state(7, there), {})[1] != STAY
    assert "drives on" in planned.news[1]


def test_who_stays_unseen_is_left_where_it_was_and_named() -> None:
    homes = {1: Pose(0.8, 0.0, 0.0), 2: Pose(-0.8, 0.0, 0.0), 3: Pose(0.0, 0.8, 0.0)}
    planned = homing(homes, hindered_s=2.0)
    for number in range(60):
        seen = {1: homes[1], 3: Pose(0.0, 0.3, 0.0)} if number < 3 else {1: homes[1]}
        planned.step(state(number, seen), {})
    assert planned.done
    assert "robot 3 is left where it is, 0.50 m from its start: not seen" in planned.news
    assert "robot 2 is left where it is: not seen" in planned.news, "it never was seen"
    assert {a.tag: a.trouble for a in planned.arrivals()} == {1: "", 2: "not seen", 3: "not seen"}


def test_a_floor_knows_the_smallest_and_the_largest_of_its_robots() -> None:
    whole = load("pollutant")
    robots = [
        replace(robot, model=replace(EPUCK, radius_m=radius_m))
        for robot, radius_m in zip(whole.robots, (0.05, 0.17, 0.08))
    ]
    floor = DrivingFloor.of(replace(whole, robots=tuple(robots)))
    assert (floor._smallest_m, floor._largest_m) == (0.05, 0.17)


def test_ways_lead_around_walls_and_there_may_be_none() -> None:
    floor = DrivingFloor(ARENA, [WALL])
    way = floor.way((-0.5, 0.0), (0.5, 0.0), 0.05)
    assert way is not None and way[-1] == (0.5, 0.0)
    assert max(abs(y) for _, y in way) > 0.6
    points = [(-0.5, 0.0), *way]
    shortest_m = 2.0 * math.hypot(0.5, 0.65)
    length_m = sum(map(math.dist, points, points[1:]))
    assert shortest_m <= length_m < 1.15 * shortest_m
    closed = DrivingFloor(ARENA, [(0.0, 0.0, 0.0, 0.04, 2.0)])
    assert closed.way((-0.5, 0.0), (0.5, 0.0), 0.05) is None


def test_a_corner_that_is_reached_makes_way_for_the_next() -> None:
    planned = homing({1: Pose(0.5, 0.5, 0.0)})
    (robot,) = planned.robots.values()
    robot.observe(Pose(0.0, 0.0, 0.0), 1)
    nobody, now_ns = np.zeros((0, 3)), 2
    # Other calls of a round plan anew.
    planned._round, row = 1, 0
    robot.best_m, robot.best_ns = robot.left_m, now_ns
    robot.way = [(0.05, 0.0), (0.5, -0.1), (0.5, 0.5)]
    planned._plan = lambda *_: None  # type: ignore[method-assign]
    goal, speed_m_s = planned._target(robot, row, nobody, now_ns)
    assert (goal, speed_m_s) == ((0.5, -0.1), _traffic.MAX_M_S)
    assert robot.way == [(0.5, -0.1), (0.5, 0.5)]


def test_a_blocked_robot_is_told_and_left_after_the_time() -> None:
    planned = homing(
        {1: Pose(0.5, 0.0, 0.0)}, DrivingFloor(ARENA, [(0.0, 0.0, 0.0, 0.04, 2.0)]), all_s=3.0
    )
    for number in range(40):
        planned.step(state(number, {1: Pose(-0.5, 0.0, 0.0)}), {})
    assert planned.done and planned.arrivals()[0].trouble == "blocked"
    assert "blocked" in planned.news[0]


def test_four_centimetres_nearer_are_progress_and_two_are_not() -> None:
    for step_m, progresses in ((0.04, True), (0.02, False)):
        one = Traveller(1, "a", Pose(0.0, 0.0, 0.0), Pose(0.0, 0.0, 0.0), best_ns=1)
        one.pose = Pose(1.0, 0.0, 0.0)
        assert one.progresses(1, 5)
        one.pose = Pose(1.0 - step_m, 0.0, 0.0)
        assert one.progresses(6, 5) == progresses


def test_who_does_not_overlap_leaves_its_distance_and_no_more() -> None:
    """Wherever it stands: as far as it is on each of ten steps, less the least distance."""
    apart_m = np.full((3, 3), 0.2)
    for gap_m, left_m in ((0.3, 0.1), (0.15, _traffic.OVERLAP_TOLERANCE_M)):
        poses = np.array([(0.5, -0.5, 0.0), (0.5 + gap_m, -0.5, 0.0), (0.5, -0.5 - gap_m, 0.0)])
        traffic = SimpleNamespace(poses=poses, apart_m=apart_m)
        stay = np.repeat(poses[:, np.newaxis, :2], 10, axis=1)
        gaps = _traffic._robot_gaps(traffic, 0, stay[:1], stay)  # type: ignore[arg-type]
        assert gaps.shape == (1, 3, 10) and (gaps[0, 0] == math.inf).all()
        assert gaps[0, 1:] == pytest.approx(np.full((2, 10), left_m))


def test_a_pause_takes_nobodys_time() -> None:
    planned = homing({1: Pose(0.5, 0.0, 0.0)}, all_s=3.0)
    for number in (0, 1, 2, 500, 501):
        planned.rest()
        planned.step(state(number, {1: Pose(-0.5, 0.0, 0.0)}), {})
    assert not planned.done and planned.spent_s < 1.0


def test_the_planner_foretells_what_the_daemon_does() -> None:
    """The numbers of `robot/homing.c`: 930 and 350 steps/s of 0.1288 mm, wheels 53 mm apart."""
    assert pytest.approx(930 * 0.1288e-3, rel=0.01) == _traffic.MAX_M_S
    assert pytest.approx(2 * 350 * 0.1288 / 53.0, rel=0.01) == _traffic.TURN_MAX_RAD_S
    assert pytest.approx(2 * 514 * 0.1288 / 53.0, rel=0.01) == _traffic.TURN_RATE_PER_S
    poses = np.array([[0.0, 0.0, 0.0]])
    ahead = _traffic.predict(poses, np.zeros((1, 1)), np.full((1, 1), 0.12), np.array([0.2]))
    assert ahead[0, 0, 3, 0] == pytest.approx(0.12) and ahead[0, 0, -1, 0] == pytest.approx(0.2)


def test_ways_lead_around_tagged_objects_and_robots_that_do_not_play() -> None:
    """The polluter of the thesis stands in the arena, and spares may: bodies that nobody drives."""
    planned = homing({1: Pose(0.5, 0.0, 0.0), 2: Pose(-0.8, 0.8, 0.0)})
    there = {1: Pose(-0.5, 0.0, 0.0), 2: Pose(-0.8, 0.8, 0.0), 99: Pose(0.0, 0.0, 0.0)}
    goals = planned.step(state(0, there), {})
    assert set(goals) == {1, 2} and planned.robots[1].way[-1] == (0.5, 0.0), "none is exchanged"
    way = [there[1][:2], *planned.robots[1].way]
    line = np.concatenate([np.linspace(*ends, 50) for ends in pairwise(way)])
    assert np.hypot(line[:, 0], line[:, 1]).min() > 2.0 * EPUCK.radius_m
    assert [arrival.tag for arrival in planned.arrivals()] == [1, 2]


def test_each_robot_keeps_clear_of_the_bodies_that_there_are() -> None:
    """Ways around a wide body are wide; small robots stand nearer to each other than to it."""
    wide = {99: replace(EPUCK, radius_m=0.17)}
    homes = {1: Pose(0.6, 0.0, 0.0), 2: Pose(0.6, 0.075, 0.0)}
    floor = DrivingFloor(ARENA, radii_m=(EPUCK.radius_m, 0.17))
    planned = Homing(homes, {}, dict.fromkeys(homes, "a"), floor, models=wide)
    poses = {1: Pose(-0.6, 0.0, 0.0), 2: Pose(-0.6, 0.2, 0.0), 99: Pose(0.0, 0.0, 0.0)}
    lines = {tag: [] for tag in homes}
    for number in range(300):
        goals = planned.step(state(number, poses), {})
        if planned.done:
            break
        for tag, goal in goals.items():
            poses[tag] = driven(poses[tag], goal)
            lines[tag].append(poses[tag][:2])
    assert planned.done and not planned.news
    for line in lines.values():
        assert np.hypot(*np.array(line).T).min() > 0.17 + EPUCK.radius_m + 0.015
    assert math.dist(poses[1][:2], poses[2][:2]) < 0.17 + EPUCK.radius_m


def driven(pose: Pose, goal: Goal) -> Pose:
    """Where a robot is 0.1 s later by the law of `_traffic`, without the daemon's whole numbers."""
    far_m, aside = math.hypot(goal.x_mm, goal.y_mm) / 1e3, math.atan2(goal.y_mm, goal.x_mm)
    if far_m < 0.005:
        far_m, aside = 0.0, goal.heading / 1e4
    most = _traffic.TURN_MAX_RAD_S
    turn = 0.1 * min(max(_traffic.TURN_RATE_PER_S * aside, -most), most)
    speed = min(_traffic.MAX_M_S, _traffic.RATE_PER_S * far_m)
    ahead = 0.1 * speed * max(0.0, 1.0 - abs(aside) / _traffic.NARROW_RAD)
    yaw = pose.yaw_rad + turn / 2.0
    return Pose(
        pose.x_m + ahead * math.cos(yaw), pose.y_m + ahead * math.sin(yaw), pose.yaw_rad + turn
    )


def test_a_home_that_is_taken_goes_to_nobody_who_could_have_another() -> None:
    homes = {1: Pose(0.5, 0.0, 0.0), 2: Pose(-0.5, 0.0, 0.0)}
    planned = homing(homes)
    dead = {1: Pose(0.0, 0.3, 0.0), 2: Pose(0.5, 0.0, 0.0)}
    planned.step(state(0, dead), {2: Trouble.NO_LINK})
    assert planned.robots[1].home == homes[2]


@pytest.mark.parametrize("gap_m", [0.5, 1.5])
def test_a_home_beside_which_somebody_stands_for_good_is_taken(gap_m: float) -> None:
    """By the least gap between two bodies: at half of it there is no room, at 1.5 there is."""
    away_m = 2.0 * EPUCK.radius_m + gap_m * MIN_GAP_M
    homes = {1: Pose(0.5, 0.0, 0.0), 2: Pose(-0.5, 0.0, 0.0)}
    planned = homing(homes)
    planned.step(
        state(0, {1: Pose(0.0, 0.3, 0.0), 2: Pose(0.5, away_m, 0.0)}), {2: Trouble.NO_LINK}
    )
    assert planned.robots[1].home == homes[2 if gap_m < 1.0 else 1]


def test_clearance_is_the_distance_from_the_nearest_disc_or_wall() -> None:
    discs = np.array([[0.4, -0.3, 0.1], [-0.6, 0.2, 0.05]])
    points = np.array([(0.1, 0.1), (0.4, -0.3), (-0.6, 0.5), (0.95, 0.0)])
    free_m = DrivingFloor(ARENA).clearance_m(points, discs)
    assert free_m == pytest.approx([0.4, -0.1, 0.25, 0.05])


def test_ways_go_from_each_cell_to_one_beside_it() -> None:
    toll = [[1.0] * 5 for _ in range(4)]
    for column in range(3):
        toll[column][2] = math.inf
    cells = floor_module._a_star(toll, (0, 0), (0, 4))
    assert cells is not None and (cells[0], cells[-1]) == ((0, 0), (0, 4))
    assert all(max(abs(a - c), abs(b - d)) == 1 for (a, b), (c, d) in pairwise(cells))
    assert math.inf not in {toll[i][j] for i, j in cells}


def traffic(x_m: float, heading: float) -> _traffic.Traffic:
    """A robot that drives along x to a place a metre ahead, and one that stands on its way."""
    return _traffic.Traffic(
        poses=np.array([[0.0, 0.0, 0.0], [x_m, 0.0, 0.0]]),
        moves=np.array([True, False]),
        targets=np.array([[1.0, 0.0], [x_m, 0.0]]),
        speeds=np.array([0.12, 0.0]),
        reach_m=np.array([1.0, 0.0]),
        order=[0, 1],
        apart_m=np.full((2, 2), 2.0 * EPUCK.radius_m + 0.005),
        room_m=np.full(2, EPUCK.radius_m),
        headings=np.array([heading, 0.0]),
        driven=np.array([0.1, 0.0]),
    )


@pytest.mark.parametrize("heading", [0.6, -0.6])
def test_a_robot_passes_who_stands_in_its_way_on_the_side_that_it_has_begun(heading: float) -> None:
    floor = DrivingFloor(Arena((4.0, 4.0, 1.0), (0.0, 0.0, 0.0)))
    blocked = _traffic.decide(traffic(0.14, heading), floor)
    assert not blocked.wanted[0] and blocked.speeds[0] > 0.0
    assert 0.2 < math.copysign(1.0, heading) * blocked.headings[0] < 1.6
    free = _traffic.decide(traffic(-0.5, 0.0), floor)
    assert free.wanted[0] and free.headings[0] == pytest.approx(0.0)
