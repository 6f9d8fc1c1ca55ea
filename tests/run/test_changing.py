"""What people may change in a running world, what not and why, and who hears of it."""

from __future__ import annotations

from typing import Any

import pytest

from tests.run.changed_run import ChangedRun
from vsense.base.errors import VsenseError
from vsense.config.experiment import load
from vsense.run.changes import DRAG_TIMEOUT_NS, MOST_AT_ONCE, MOST_WAITING
from vsense.run.changing import MOST_ROBOTS, Change, Ground, carry_out
from vsense.run.environment import Environment
from vsense.run.orders import OrderError
from vsense.world.entities import VIRTUAL_TAG_MIN, VirtualRobot

MOVE = {"kind": "move", "name": "nest", "x_m": 0.1, "y_m": 0.2}
ROBOT = load("foraging").robots[0].id
NOISE = {"kind": "set", "controller": "ant", "name": "rgb_ground", "setting": "noise_level"}


@pytest.mark.parametrize(
    "said, says",
    [
        (None, "object"),
        ([MOVE], "object"),
        ({}, "kind.*None"),
        ({"kind": ["move"]}, "a change's kind"),
        ({**MOVE, "x_m": float("nan")}, "x_m is nan"),
        ({**MOVE, "x_m": float("inf")}, "x_m is inf"),
        ({**MOVE, "y_m": True}, "y_m.*True"),
        ({**MOVE, "y_m": "1"}, "y_m.*'1'"),
        ({**MOVE, "y_m": 10**400}, "y_m is 1"),
        ({**MOVE, "name": 7}, "name.*7.*text"),
        ({**MOVE, "name": "x" * 201}, "at most 200"),
        ({**MOVE, "name": "a\nb"}, "is no text"),
        ({**MOVE, "name": "\ud800"}, "is no text"),
        ({**MOVE, "final": 1}, "true or false"),
        ({**MOVE, "by": "Eve"}, "'by'"),
        ({"kind": "move", "name": "nest", "x_m": 0.1}, "'y_m'"),
        ({**NOISE, "value": None}, "value is None"),
        ({**NOISE, "value": [1]}, "value is"),
    ],
)
def test_what_makes_no_sense_is_said(said: object, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        Change.read(said)


def test_numbers_are_read_up_to_a_bound() -> None:
    assert Change.read({**MOVE, "x_m": -1e9}).x_m == -1e9
    with pytest.raises(ValueError, match=r"x_m is -1000000001.0, .* at most 1e\+09"):
        Change.read({**MOVE, "x_m": -1e9 - 1})


def test_a_change_is_read_as_it_was_told() -> None:
    for said in (MOVE, {**NOISE, "value": 0.5}, {"kind": "remove", "name": "visitor 1"}):
        change = Change.read(said)
        assert Change.read(change.data()) == change


@pytest.mark.parametrize(
    "said, says",
    [
        ({**MOVE, "x_m": 9.0}, "nest: 9, 0.2 m is outside of the arena"),
        ({**MOVE, "name": "nset"}, "there is no 'nset' in the world; is 'nest' meant"),
        ({**MOVE, "name": ROBOT}, "is a robot that drives by itself"),
        ({**MOVE, "name": "wall_north"}, "stands in the real arena"),
        ({"kind": "remove", "name": "nest"}, "is no virtual robot"),
        ({"kind": "remove", "name": "nobody"}, "there is no 'nobody'"),
        ({"kind": "add", "name": "nest", "x_m": 0, "y_m": 0}, "there is a 'nest' already"),
        ({"kind": "add", "name": ROBOT, "x_m": 0, "y_m": 0}, f"there is a '{ROBOT}' already"),
        ({**NOISE, "value": -1}, "noise_level is -1, expected a number from 0 to 1e"),
        ({**NOISE, "value": "much"}, "expected a number"),
        ({**NOISE, "setting": "latency", "value": 1.5}, "expected a whole number from 0 to 1000"),
        ({**NOISE, "setting": "colour", "value": 1}, "no setting 'colour'"),
        ({**NOISE, "name": "nose", "value": 1}, "there is no sensor 'nose'"),
        ({**NOISE, "controller": "bee", "value": 1}, "there is no controller 'bee'"),
        ({"kind": "set", "name": "trail", "setting": "diffusion_m2_s", "value": 5}, "too fast"),
        ({"kind": "set", "name": "trail", "setting": "cell_m", "value": 5}, "no 'cell_m' to be"),
        ({"kind": "set", "name": "nest", "setting": "radius_m", "value": 0}, "radius_m is 0.0"),
        ({"kind": "set", "name": "what", "setting": "radius_m", "value": 1}, "no 'what' in the"),
        ({"kind": "set", "setting": "nest", "value": "nowhere"}, "parameter nest names 'nest'"),
        ({"kind": "set", "setting": "rest", "value": "1"}, "there is no parameter 'rest'"),
    ],
)
def test_what_cannot_be_changes_nothing(said: dict[str, Any], says: str) -> None:
    run = ChangedRun()
    world, before = run.environment.world, run.environment.world.version
    rates = world.fields["trail"].rates
    run.ask(**said)
    run.live(1, {})
    ((text, ok),) = run.answers
    assert not ok and says in text and "\n" not in text
    assert (world.version, world.fields["trail"].rates) == (before, rates)
    assert run.told == []


@pytest.mark.parametrize(
    "name, parameter, value, says",
    [
        ("foraging", "food", "trail", "'food'.*'trail'"),
        ("foraging", "food", ROBOT, f"there is no zone '{ROBOT}'"),
        ("phototaxis", "light", "wall_north", "light 'wall_north'"),
        ("phototaxis", "turn_s", "soon", "120.0.*'soon'"),
        ("predator_prey", "prey", "predatr", "'predatr'.*'predator'"),
        ("predator_prey", "prey", "predator", "'prey'.*'predator' 4"),
        ("predator_prey", "rest_s", "nan", "10.0.*'nan'"),
    ],
)
def test_a_parameter_cannot_end_the_run(
    name: str, parameter: str, value: str | float, says: str
) -> None:
    run = ChangedRun(name)
    before = dict(run.environment.world.params)
    with pytest.raises(OrderError, match=says):
        carry_out(
            Change.read({"kind": "set", "setting": parameter, "value": value}), run.environment
        )
    assert run.environment.world.params == before


def test_numbers_remain_numbers() -> None:
    world = (run := ChangedRun("predator_prey")).environment.world
    world.params |= {"count": "3", "half": "0.5"}
    for parameter, value, found in (("count", 12.0, "12"), ("half", 0.25, "0.25")):
        said = {"kind": "set", "setting": parameter, "value": value}
        carry_out(Change.read(said), run.environment)
        assert world.params[parameter] == found
    with pytest.raises(OrderError, match=r"12.*'3\.7\d*'.*12\.0"):
        carry_out(Change.read({"kind": "set", "setting": "count", "value": 3.7}), run.environment)


def test_settings_say_what_was_set() -> None:
    run = ChangedRun()
    run.ask(**NOISE, value=0.25)
    run.ask(kind="set", name="trail", setting="evaporation_per_s", value=0.5)
    run.ask(kind="set", setting="food", value="nest")
    run.ask(kind="set", name="nest", setting="radius_m", value=0.4)
    run.live(1, {})
    assert [ok for _, ok in run.answers] == [True] * 4
    told = run.changes.settings(run.environment)
    (sensor,) = [row for row in told["sensors"] if row["name"] == "rgb_ground"]
    assert sensor["noise_level"] == 0.25 and sensor["latency"] == 0
    assert told["fields"][0]["evaporation_per_s"] == 0.5 and told["params"]["food"] == "nest"
    assert not told["locked"] and not told["objects"] and not told["solids"]
    assert run.told[0] == "Ada: noise_level of rgb_ground (ant) is 0.25"


def test_a_locked_run_says_so_and_a_blind_one_has_no_sensors() -> None:
    with pytest.raises(OrderError, match="locked"):
        ChangedRun(locked=True).ask(**MOVE)
    run = ChangedRun(blind=True)
    run.ask(**NOISE, value=0.25)
    run.live(1, {})
    assert run.answers[0][1] is False and "without virtual sensors" in run.answers[0][0]


def test_hands_make_no_timestep_late_and_no_queue_grows() -> None:
    run = ChangedRun()
    for _ in range(MOST_WAITING):
        run.ask(**MOVE)
    with pytest.raises(OrderError, match="too many changes"):
        run.ask(**MOVE)
    run.live(1, {})
    assert len(run.answers) == MOST_AT_ONCE


def test_of_a_drag_the_end_is_told_once_or_a_moment_after_it_was_broken_off() -> None:
    run = ChangedRun()
    for x_m in (0.1, 0.2, 0.3):
        run.ask(**{**MOVE, "x_m": x_m, "final": x_m == 0.3})
    run.live(1, {})
    assert run.told == ["Ada: nest is at 0.30, 0.20 m"]
    run.ask(**{**MOVE, "x_m": 0.4, "final": False})
    run.changes.carry_out(run.environment, 1, 1)
    assert len(run.told) == 1
    run.now_ns += DRAG_TIMEOUT_NS + 1
    run.changes.carry_out(run.environment, 2, 2)
    assert run.told[1] == "Ada: nest is at 0.40, 0.20 m"


def test_virtual_robots_come_and_go(monkeypatch: pytest.MonkeyPatch) -> None:
    run = ChangedRun()
    world, said = run.environment.world, {"kind": "add", "x_m": 0.1, "y_m": 0.2}
    for _ in range(MOST_ROBOTS):
        carry_out(Change.read(said), run.environment)
    with pytest.raises(VsenseError, match="virtual robots"):
        carry_out(Change.read(said), run.environment)
    count = len(world.robots)
    carry_out(Change.read({"kind": "remove", "name": "visitor 7"}), run.environment)
    carry_out(Change.read(said), run.environment)
    assert len(world.robots) == count and "visitor 7" not in world.entities
    assert len({robot["tag"] for robot in world.robots}) == count
    # Where the experiment's functions may count robots, none comes or goes.
    monkeypatch.setattr(Environment, "robots_may_change", False)
    for change in ({"kind": "remove", "name": "visitor 8"}, {**said, "name": "late"}):
        with pytest.raises(VsenseError, match="none can come or go"):
            carry_out(Change.read(change), run.environment)
    assert len(world.robots) == count and "visitor 8" in world.entities


def test_nobody_inherits_the_controller_of_a_robot_that_is_gone() -> None:
    run = ChangedRun()
    environment, world = run.environment, run.environment.world

    def added(name: str) -> int:
        said = {"kind": "add", "name": name, "x_m": 0.1, "y_m": 0.2}
        carry_out(Change.read(said), environment)
        return next(int(e.tag) for e in world.entities.values() if e.id == name)  # type: ignore[union-attr]

    def life() -> list[int]:
        # Loop functions put robots, too.
        world.put(VirtualRobot("theirs", VIRTUAL_TAG_MIN + 7, 0.3, 0.3))
        tags = [VIRTUAL_TAG_MIN + 7]
        for name in ("theirs", "mine"):
            carry_out(Change.read({"kind": "remove", "name": name}), environment)
            tags += [added("mine")]
        return [*tags, added("yours")]

    tags = life()
    assert len(set(tags)) == 4 and tags == sorted(tags)
    world.reset()
    assert life() == tags, "made again, the world is the same"


def test_loop_functions_that_count_robots_keep_them() -> None:
    run = ChangedRun("predator_prey")
    with pytest.raises(OrderError, match=r"count.*robots"):
        carry_out(Change.read({"kind": "add", "x_m": 0, "y_m": 0}), run.environment)


def test_a_light_that_circles_goes_on_from_where_it_was_dragged_to() -> None:
    run = ChangedRun("phototaxis")
    drag = {"kind": "move", "name": "lamp", "x_m": -0.3, "y_m": 0.4}
    run.live(12, {5: lambda: run.ask(**drag)})
    x_m, y_m, _ = run.environment.world.lights()[0].position_m
    # 15 degrees of its orbit in 5 s at the most: it has not jumped back to the other side.
    assert abs(x_m + 0.3) < 0.05 and abs(y_m - 0.4) < 0.05


def test_what_is_real_moves_where_somebody_can_move_it() -> None:
    run, put = ChangedRun("pollutant"), []
    (thing,) = run.environment.experiment.objects
    said = Change.read({"kind": "move", "name": thing.id, "x_m": 0.3, "y_m": 0.2})
    with pytest.raises(OrderError, match="is real"):
        carry_out(said, run.environment)
    ground = Ground(lambda *where: put.append(where), rebuilds=True)
    carry_out(said, run.environment, ground)
    assert put == [(0, 0.3, 0.2, 0.0)]
    wall = Change.read({"kind": "move", "name": "wall_north", "x_m": 0.0, "y_m": 0.5})
    carry_out(wall, run.environment, ground)
    moved = run.environment.world.entities["wall_north"]
    assert moved.position_m[:2] == (0.0, 0.5), moved  # type: ignore[union-attr]
