"""Spares are put in for robots that cannot go on; others are left out, or end the series."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest

from tests.run.stage import status
from vsense.base.errors import UsageError
from vsense.base.terminal import Console
from vsense.config import roster
from vsense.config.casting import Casting
from vsense.robots.link.wire import Telemetry
from vsense.run.robots import Readiness
from vsense.studies.series._order import pending
from vsense.studies.series._parts import PlanLoader, SeriesCast
from vsense.studies.series._plan import read
from vsense.studies.series._staged import StagedRun

PLAN = """
mode = "lab"
experiment = "aggregation"
[[condition]]
name = "a"
[[condition]]
name = "b"
blind = true
[[start]]
seed = 3
[robots]
count = 3
battery_v = 3.5
"""


def cast_of(tmp_path: Path) -> tuple[SeriesCast, io.StringIO, list[int]]:
    path = tmp_path / "plan.toml"
    path.write_text(PLAN)
    loader = PlanLoader(read(path))
    tags = [robot.tag for robot in loader.load_all()["a"].experiment.robots]
    robots = "".join(f"[[robot]]\ntag = {tag}\n" for tag in tags)
    spares = "".join(f"[[robot]]\ntag = {tag}\nspare = true\n" for tag in (61, 62, 63))
    (tmp_path / "robots.toml").write_text(f'{robots}{spares}out_of_order = "limps"\n')
    known = roster.read(tmp_path / "robots.toml")
    loader = PlanLoader(loader.plan, casting=Casting.of(known))
    said = io.StringIO()
    return SeriesCast(loader.load_all(), Console(said)), said, tags


def test_spares_play_in_every_condition_until_there_are_none(tmp_path: Path) -> None:
    cast, said, (first, second, third) = cast_of(tmp_path)
    assert cast.put_in_for({second: "is not seen"}) == []
    assert cast.tags == {first, 61, third}
    assert f"robot {second} is not seen: robot 61 has its role from now on" in said.getvalue()
    # The spare itself breaks: whoever was replaced does not come back by itself.
    assert cast.put_in_for({61: "was lost", third: "was lost"}) == [third]
    assert cast.tags == {first, 62, third}
    assert "there is no spare for it" in said.getvalue()
    for planned in cast.by_condition.values():
        assert [robot.tag for robot in planned.experiment.robots] == [first, 62, third]


def test_a_spare_plays_where_conditions_have_different_robots(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    text = PLAN.replace('name = "b"', 'name = "b"\nexperiment = "predator_prey"')
    path.write_text(text.replace("count = 3", ""))
    (tmp_path / "robots.toml").write_text("[[robot]]\ntag = 61\nspare = true\n")
    known = roster.read(tmp_path / "robots.toml")
    loader = PlanLoader(read(path), casting=Casting.of(known))
    cast = SeriesCast(loader.load_all(), Console(io.StringIO()))
    mine, others = ([r.tag for r in cast.by_condition[name].experiment.robots] for name in "ab")
    assert mine[-1] not in others
    assert cast.put_in_for({mine[-1]: "was lost"}) == []
    assert cast.tags == {61, *mine[:-1], *others}
    # Whom people put in while a run of b waits leaves the spare of a in its part.
    b = cast.by_condition["b"].experiment.casting
    cast.follow("b", replace(b, replaced=(*b.replaced, (others[-1], 62))))
    assert cast.tags == {61, 62, *mine[:-1], *others} - {others[-1]}


def test_people_may_move_a_spare_on_in_any_order(tmp_path: Path) -> None:
    cast, _, (first, second, third) = cast_of(tmp_path)
    first_casting = cast.by_condition["a"].experiment.casting
    cast.follow("a", replace(first_casting, replaced=((first, 61), (second, 62))))
    # While one run waits: second is repaired, then 62 takes over from 61.
    second_casting = cast.by_condition["a"].experiment.casting
    cast.follow("a", replace(second_casting, replaced=((first, 62),)))
    assert cast.tags == {62, second, third}
    assert all(p.experiment.casting.replaced == ((first, 62),) for p in cast.by_condition.values())
    # Two robots exchange their parts.
    cast.follow("a", replace(second_casting, replaced=((second, third), (third, second))))
    assert [r.tag for r in cast.by_condition["b"].experiment.robots] == [first, third, second]


def test_nobody_plays_two_parts(tmp_path: Path) -> None:
    cast, _, (first, second, _third) = cast_of(tmp_path)
    casting = cast.by_condition["a"].experiment.casting
    with pytest.raises(UsageError):
        cast.follow("a", replace(casting, replaced=((first, 61), (second, 61))))


def test_a_run_knows_who_cannot_begin(tmp_path: Path) -> None:
    cast, _, (first, second, third) = cast_of(tmp_path)
    plan = read(tmp_path / "plan.toml")
    run = pending(plan, [])[0]
    staged = StagedRun.of(plan, run, cast.by_condition[run.cell.condition])
    names = {robot.tag: robot.id for robot in staged.experiment.robots}
    there = Readiness.of(names, {}, {first, second}, {first}, {})
    assert staged.missing(there) == {second: "is not seen", third: "is not connected"}
    volts = {first: 3400, second: 3500, third: 0}
    told = {
        tag: status(tag, names[tag], telemetry=Telemetry(battery_mv=mv))
        for tag, mv in volts.items()
    }
    assert staged.low(told) == {first: "has 3.40 V left, and drove home"}
    without = StagedRun.of(plan, run, cast.by_condition[run.cell.condition], [second])
    assert [robot.tag for robot in without.experiment.robots] == [first, third]
    before = {r.tag: r.pose for r in staged.experiment.robots}
    assert {r.tag: r.pose for r in without.experiment.robots} == {
        tag: before[tag] for tag in (first, third)
    }, "the starts are those of all"


def test_what_pollutes_is_not_left_out(tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(PLAN.replace("aggregation", "pollutant-moving"))
    plan = read(tmp_path / "plan.toml")
    loader = PlanLoader(plan)
    known, run = loader.load_all(), pending(plan, [])[0]
    sources = known["a"].experiment.sources
    assert sources
    with pytest.raises(UsageError, match="pollutes"):
        StagedRun.of(plan, run, known[run.cell.condition], [sources[0].tag])
