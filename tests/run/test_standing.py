"""Which robots stand while others run, and why: the table of `vsense.run._standing`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from tests.run.stage import Stage, experiment
from vsense.base.arena import POSE, ArenaState
from vsense.config.experiment import load
from vsense.config.geofence import Geofence, Polygon
from vsense.config.specs import Experiment
from vsense.robots.link._peer import Orders
from vsense.robots.link.wire import Wanted
from vsense.run._standing import NOT_SEEN, StandingRobots
from vsense.run.alarms import Obedience
from vsense.run.orders import Order, OrderKind

MS = 1_000_000
MIDDLE = (0.0, 0.0)
SQUARE = Polygon(((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)))
ZONE = Polygon(((0.5, 0.5), (1.0, 0.5), (1.0, 1.0), (0.5, 1.0)))
FENCE = Geofence(SQUARE, (ZONE,), {"cap": 0.3})
"""It keeps robots off whoever wears tag 9."""


def swarm(fence: Geofence | None = None, limit_s: float | None = 1.0) -> Experiment:
    """Robots 7 and 8, called seven and eight, and a cap with tag 9."""
    whole = load("pollutant")
    pairs = zip(whole.robots, ((7, "seven"), (8, "eight")))
    robots = tuple(replace(robot, tag=tag, id=id) for robot, (tag, id) in pairs)
    objects = (replace(whole.objects[0], tag=9, id="cap"),)
    return replace(whole, robots=robots, objects=objects, unseen_s=limit_s, geofence=fence)


def state(ms: int, *seen: int, **places: tuple[float, float]) -> ArenaState:
    """An arena state with tags 7 to 9, of which some are `seen` in the middle.

    Others are at `places`: seven, eight or cap, x_m and y_m.
    """
    rows = np.zeros(3, dtype=POSE)
    rows["tag"], rows["seen"] = (7, 8, 9), [tag in seen for tag in (7, 8, 9)]
    for name, place in places.items():
        row = ("seven", "eight", "cap").index(name)
        rows["seen"][row] = True
        rows["x_m"][row], rows["y_m"][row] = place
    return ArenaState(ms // 100, ms * MS, rows, int(rows["seen"].sum()))


def watched(
    *sightings: tuple[int, ...], limit_s: float | None = 1.0
) -> tuple[StandingRobots, list[str]]:
    """What is said of a run with a state each 100 ms, in which these are seen."""
    standing = StandingRobots(swarm(limit_s=limit_s))
    lines = [
        f"{100 * n} {line}"
        for n, tags in enumerate(sightings)
        for line in standing.update(state(100 * n, *tags))
    ]
    return standing, lines


def led(
    standing: StandingRobots, *places: tuple[float, float] | None, homing: bool = False
) -> list[str]:
    """What is said while robot 7 is led over these places, None: not seen; 8 is in the middle."""
    lines = []
    for n, place in enumerate(places):
        known = {} if place is None else {"seven": place}
        said = standing.update(state(100 * n, 8, **known), homing)
        lines += [f"{100 * n} {line}" for line in said]
    return lines


def test_who_is_not_seen_for_a_second_stands_until_three_sightings_in_a_row() -> None:
    hidden = [(7, 8)] * 3 + [(8,)] * 12 + [(7, 8), (7, 8), (8,), (7, 8), (7, 8), (7, 8), (7, 8)]
    unseen, lines = watched(*hidden)
    assert lines == [
        "1200 robot 7 stands: not seen for 1.0 s",
        "2000 robot 7 is seen again and goes on; it stood 0.8 s",
    ]
    assert unseen.reasons == {} and unseen.stood_s(7) == (0.8, 0.0)


def test_who_was_never_seen_stands_too() -> None:
    unseen, lines = watched(*[(8,)] * 11)
    assert unseen.reasons == {7: NOT_SEEN} and lines == ["1000 robot 7 stands: not seen for 1.0 s"]


def test_where_robots_drive_on_unseen_nobody_stands() -> None:
    unseen, lines = watched(*[(8,)] * 50, limit_s=None)
    assert unseen.reasons == {} and lines == []


def test_times_without_arena_states_and_pauses_count_for_nobody() -> None:
    unseen = StandingRobots(swarm())
    unseen.update(state(0, 7, 8))
    unseen.update(state(10_000))
    assert unseen.reasons == {}
    for ms in range(10_100, 10_600, 100):
        unseen.update(state(ms))
        unseen.pause()
    assert unseen.reasons == {}


def test_a_new_run_begins_with_nobody_standing() -> None:
    unseen, _ = watched(*[()] * 12)
    assert unseen.reasons.keys() == {7, 8}
    unseen.begin()
    assert unseen.reasons == {} and unseen.stood_s(7) == (0.0, 0.0)
    assert unseen.update(state(0)) == []


def test_the_fence_itself_is_inside() -> None:
    standing = StandingRobots(swarm(FENCE))
    standing.update(state(0, 8, seven=(1.0, 0.0)))
    assert standing.reasons == {}
    standing.update(state(100, 8, seven=(1.0 + 1e-9, 0.0)))
    assert standing.reasons.keys() == {7}


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        ("", 1.0),
        ('vs:unseen="drive"', None),
        ('vs:unseen="stand" vs:unseen_s="2.5"', 2.5),
    ],
)
def test_what_the_file_says(attributes: str, expected: float | None, tmp_path: Path) -> None:
    text = load("pollutant").path.read_text()
    path = tmp_path / "mine.argos"
    path.write_text(text.replace('random_seed="1"', f'random_seed="1" {attributes}'))
    assert load(str(path)).unseen_s == expected


def test_the_runner_holds_that_robot_alone_and_says_how_long_it_stood() -> None:
    stage = Stage(experiment(timesteps=40))
    hidden, other = sorted(robot.tag for robot in stage.experiment.robots)
    stage.connected, stage.seen = {hidden, other}, {hidden, other}
    stage.runner.wait(0.0)
    held: list[dict[int, str]] = []
    for step in stage.runner.timesteps():
        held.append(stage.held)
        if step.run_timestep == 5:
            stage.seen = {other}
        elif step.run_timestep == 25:
            stage.seen = {hidden, other}
    reason = {hidden: NOT_SEEN}
    assert all(reasons in ({}, reason) for reasons in held)
    first, last = held.index(reason), len(held) - held[::-1].index(reason)
    assert (first, last) == (15, 28), "a second after it was last seen, to its third sighting"
    said = stage.terminal.getvalue()
    assert f"robot {hidden} stands: not seen for 1.0 s" in said
    assert f"robot {hidden} is seen again and goes on; it stood 1.3 s" in said
    assert stage.runner.standing.stood_s(hidden) == (pytest.approx(1.3), 0.0)


def test_nobody_is_held_in_a_pause() -> None:
    stage = Stage(experiment(timesteps=60))
    tags = {robot.tag for robot in stage.experiment.robots}
    stage.connected, stage.seen = tags, tags
    stage.runner.wait(0.0)
    give = stage.runner.control.give
    for step in stage.runner.timesteps():
        if step.run_timestep == 5 and not stage.acts:
            stage.seen = set()
            give(Order(OrderKind.PAUSE, "test"))
            stage.acts = {
                stage.calls + 30: lambda: stage.seen.update(tags),
                stage.calls + 31: lambda: give(Order(OrderKind.START, "test")),
            }
        assert stage.held == {}


def test_who_leaves_stands_until_it_is_back_by_a_margin() -> None:
    standing = StandingRobots(swarm(FENCE))
    out, edge, inside = (1.01, 0.0), (0.99, 0.0), (0.97, 0.0)
    lines = led(standing, inside, edge, out, edge, inside, inside, edge, inside, inside, inside)
    assert lines == [
        "200 robot 7 stands: outside of the fence",
        "900 robot 7 is where it may be and goes on; it stood 0.7 s",
    ]
    assert standing.reasons == {} and standing.stood_s(7) == (0.0, pytest.approx(0.7))


def test_who_stands_outside_at_the_start_never_goes() -> None:
    standing = StandingRobots(swarm(FENCE))
    assert led(standing, (1.5, 0.0)) == ["0 robot 7 stands: outside of the fence"]
    assert standing.reasons == {7: "outside of the fence"}


def test_without_a_fence_of_its_own_the_arena_is_one() -> None:
    arena = swarm()
    standing = StandingRobots(arena)
    half_m = arena.arena.size_m[0] / 2.0
    assert led(standing, (half_m - 0.03, 0.0)) == []
    assert led(standing, (half_m + 0.01, 0.0)) == ["0 robot 7 stands: outside of the fence"]


def test_forbidden_zones_and_what_is_kept_off() -> None:
    standing = StandingRobots(swarm(FENCE))
    assert led(standing, (0.6, 0.7)) == ["0 robot 7 stands: in forbidden zone 1"]
    standing.begin()
    lines = standing.update(state(0, seven=(0.0, -0.5), eight=(0.0, 0.5), cap=(0.0, -0.3)))
    assert lines == ["robot 7 stands: nearer than 0.3 m to cap"]
    # Who is not seen is where it was seen last, but not for ever.
    for ms in range(100, 5_000, 100):
        assert standing.update(state(ms, seven=(0.0, -0.5), eight=(0.0, 0.5))) == []
    lines = [
        line
        for ms in range(5_000, 5_500, 100)
        for line in standing.update(state(ms, seven=(0.0, -0.5), eight=(0.0, 0.5)))
    ]
    assert lines == ["robot 7 is where it may be and goes on; it stood 5.3 s"]


def test_robots_keep_off_a_robot_that_goes_on_itself() -> None:
    standing = StandingRobots(swarm(Geofence(SQUARE, (), {"eight": 0.3})))
    led(standing, (0.2, 0.0))
    assert standing.reasons == {7: "nearer than 0.3 m to robot 8"}


def test_who_left_unseen_stands_when_it_comes_back_outside() -> None:
    standing = StandingRobots(swarm(FENCE))
    lines = led(standing, MIDDLE, *[None] * 11, *[(1.2, 0.0)] * 4, *[MIDDLE] * 3)
    assert lines == [
        "1000 robot 7 stands: not seen for 1.0 s",
        "1200 robot 7 stands: outside of the fence",
        "1400 robot 7 is seen again; it stood 0.4 s",
        "1800 robot 7 is where it may be and goes on; it stood 0.6 s",
    ]


def test_who_was_last_seen_outside_stands_also_where_the_unseen_drive_on() -> None:
    standing = StandingRobots(swarm(FENCE, limit_s=None))
    led(standing, MIDDLE, (1.2, 0.0), *[None] * 50)
    assert standing.reasons == {7: "outside of the fence"}


def test_on_the_way_home_robots_stand_for_what_they_keep_off_only() -> None:
    standing = StandingRobots(swarm(FENCE))
    assert led(standing, (1.2, 0.0), (0.7, 0.7), *[None] * 20, homing=True) == []
    standing.update(state(9_000, seven=(1.2, 0.0), cap=(1.2, 0.2)), homing=True)
    assert standing.reasons == {7: "nearer than 0.3 m to cap"}


def test_a_fence_only_adds_to_those_who_stand() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        with_fence, without = (
            StandingRobots(swarm(FENCE)),
            StandingRobots(
                swarm(Geofence(Polygon(tuple((9 * x, 9 * y) for x, y in SQUARE.corners))))
            ),
        )
        places = rng.uniform(-0.5, 0.5, (3, 2))
        for ms in range(0, 6_000, 100):
            places = places + rng.normal(0.0, 0.1, (3, 2))
            seen = rng.random(3) < rng.choice([0.1, 0.9])
            names = zip(("seven", "eight", "cap"), places.tolist(), seen)
            now = state(ms, **{name: (x, y) for name, (x, y), is_seen in names if is_seen})
            for standing in (with_fence, without):
                standing.update(now)
            assert with_fence.reasons.keys() >= without.reasons.keys()
            outside = [
                tag
                for tag, row in ((7, 0), (8, 1))
                if seen[row] and np.abs(places[row]).max() > 1.0
            ]
            assert with_fence.reasons.keys() >= set(outside)


@pytest.mark.parametrize("wanted", Wanted)
def test_who_is_held_is_told_to_move_in_no_state(wanted: Wanted) -> None:
    for resting, held in product((frozenset(), frozenset({7})), ({}, {7: "outside"})):
        told = Orders(1, wanted, 0, resting, held).of(7).wanted
        alone = Orders(1, wanted, 0, resting).of(7).wanted
        if held and alone in (Wanted.RUN, Wanted.HOME):
            assert told == Wanted.PAUSE
        else:
            assert told == alone


def test_the_runner_holds_who_leaves_in_the_run_and_before_its_first_timestep() -> None:
    stage = Stage(replace(experiment(timesteps=20), geofence=FENCE))
    first, second = sorted(robot.tag for robot in stage.experiment.robots)
    stage.connected = stage.seen = {first, second}
    stage.places[first] = (1.5, 0.0)
    stage.runner.wait(0.0)
    held = [(step.run_timestep, stage.held) for step in stage.runner.timesteps()]
    assert held and all(reasons == {first: "outside of the fence"} for _, reasons in held)
    assert stage.held_from is not None and stage.held_from < (stage.first or 0)


def test_who_leaves_and_does_not_stand_is_said_as_disobedient() -> None:
    stage = Stage(replace(experiment(timesteps=20), geofence=FENCE))
    tag = stage.experiment.robots[0].tag
    stage.connected = stage.seen = {robot.tag for robot in stage.experiment.robots}
    obedience, said = Obedience(), []
    held: dict[str, object] = {"held": "outside of the fence", "wanted": Wanted.PAUSE}
    for ms in range(0, 3_000, 100):
        stage.statuses[tag] = (
            {"wanted": Wanted.RUN} if ms < 500 else {**held, "ordered_ns": 500 * MS}
        )
        stage.places[tag] = (1.0 + ms / 1e4, 0.0)
        robots, seen = stage.robots(), stage.arena_state(ms * MS)
        said += obedience.update(robots, seen, ms * MS)
    assert len(said) == 1 and "does NOT stop: LIFT IT" in said[0]


def accused(places: Callable[[int], tuple[float, float] | None]) -> list[str]:
    """What is said of a robot that is at these places (None: not seen) at these milliseconds."""
    stage = Stage(replace(experiment(timesteps=20), geofence=FENCE))
    tag, other = sorted(robot.tag for robot in stage.experiment.robots)
    stage.connected = {tag, other}
    standing, obedience = StandingRobots(stage.experiment), Obedience()
    said, held_ms = [], dict[int, int]()
    for ms in range(0, 6_000, 100):
        place = places(ms)
        stage.seen = {other} if place is None else {tag, other}
        stage.places[tag] = place or MIDDLE
        seen = stage.arena_state(ms * MS)
        standing.update(seen)
        held_ms = {held: held_ms.get(held, ms) for held in standing.reasons}
        why = standing.reasons.get(tag, "")
        wanted = Wanted.PAUSE if why else Wanted.RUN
        ordered_ns = held_ms.get(tag, 0) * MS
        stage.statuses[tag] = {"wanted": wanted, "held": why, "ordered_ns": ordered_ns}
        said += obedience.update(stage.robots(), seen, ms * MS)
        alarms = len(obedience.alarms)
    return [*said, f"{alarms} alarms"]


def test_who_disobeys_and_leaves_the_cameras_view_stays_an_alarm() -> None:
    said = accused(lambda ms: (0.9 + 1.3 * ms / 1e4, 0.0) if ms < 3_000 else None)
    assert len(said) == 2 and "does NOT stop: LIFT IT" in said[0] and said[1] == "1 alarms"


def test_who_was_not_seen_and_is_carried_outside_is_not_accused() -> None:
    def carried(ms: int) -> tuple[float, float] | None:
        if ms < 500:
            return MIDDLE
        return None if ms < 3_000 else (1.3 - 3.0 * (ms - 3_000) / 1e4, 0.0)

    assert accused(carried) == ["0 alarms"]


@pytest.mark.parametrize("rests", [False, True])
def test_who_cannot_be_held_or_rests_is_not_counted(rests: bool) -> None:
    stage = Stage(replace(experiment(timesteps=30), geofence=FENCE))
    first, other = sorted(robot.tag for robot in stage.experiment.robots)
    stage.connected = stage.seen = {first, other}
    if rests:
        stage.resting = frozenset({first})
    else:
        stage.statuses = {first: {"sessions": 0}}
    stage.places = {first: (1.5, 0.0)}
    stage.runner.wait(0.0)
    for _ in stage.runner.timesteps():
        assert stage.held == {}
    assert "stands" not in stage.terminal.getvalue()
