"""A robot is put in for another between runs: who may be, when, and what then is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from vsense.base.errors import UsageError
from vsense.config import roster
from vsense.config.casting import Casting
from vsense.config.experiment import load
from vsense.config.specs import Experiment, Stage
from vsense.robots.compiling import BuildError
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.table import ToldProgram
from vsense.run import programs
from vsense.run.cast import Cast, parts_of, played, recast, spares_for
from vsense.run.control import Control, State
from vsense.run.orders import Order, OrderError, OrderKind, read_pair

ROSTER = """
[[robot]]
tag = 23
[[robot]]
tag = 24
[[robot]]
tag = 37
spare = true
[[robot]]
tag = 40
out_of_order = "left motor stalls"
"""


def foraging(folder: Path) -> Experiment:
    """Two robots of a roster play; 37 is a spare and 40 is broken."""
    path = folder / "robots.toml"
    path.write_text(ROSTER)
    two = Casting.of(roster.read(path), limit=2)
    spec = load("foraging", stage=Stage.LAB, casting=two)
    robots = tuple(replace(r, tag=tag) for r, tag in zip(spec.robots, (23, 24)))
    return replace(spec, robots=robots)


def test_a_part_stays_what_it_is_whoever_plays_it(tmp_path: Path) -> None:
    before = foraging(tmp_path)
    after = recast(before, (23, 37))
    assert [robot.tag for robot in after.robots] == [37, 24]
    assert [replace(r, tag=0) for r in after.robots] == [replace(r, tag=0) for r in before.robots]
    assert parts_of(after) == {37: 23, 24: 24}
    assert spares_for(before) == [37] and spares_for(after) == [23]
    # Put back, or handed on: the part is still 23's.
    assert recast(after, (37, 23)).robots == before.robots
    assert parts_of(recast(after, (37, 23))) == {23: 23, 24: 24}
    assert parts_of(recast(after, (37, 99))) == {99: 23, 24: 24}


@pytest.mark.parametrize(
    ("pair", "text"),
    [
        ((25, 37), "tag 25.*23, 24"),
        ((23, 24), "24.*experiment"),
        ((23, 40), "40.*stalls"),
    ],
)
def test_who_cannot_play_is_refused_with_the_reason(
    tmp_path: Path, pair: tuple[int, int], text: str
) -> None:
    with pytest.raises(UsageError, match=text):
        recast(foraging(tmp_path), pair)


def test_requests_are_checked_against_those_before_them(
    tmp_path: Path,
) -> None:
    taken: list[int] = []
    spec = foraging(tmp_path)
    cast = Cast(lambda: [spec], taken.append, lambda tag: "is no robot" if tag == 99 else "")
    assert cast.ask((23, 37), "ben").startswith("robot 37 takes the role of 23")
    for pair, text in {
        (24, 37): "37.*experiment",
        (23, 41): "robot.*tag 23",
        (24, 99): "is no robot",
    }.items():
        with pytest.raises(OrderError, match=text):
            cast.ask(pair, "ben")
    assert taken == [37], "nobody is leased who does not come"
    assert [tuple(request) for request in cast.due()] == [((23, 37), "ben")]
    assert cast.due() == []


def test_spares_are_asked_for_while_there_are_some(tmp_path: Path) -> None:
    spec, said = foraging(tmp_path), []
    cast = Cast(lambda: [spec], able=lambda tag: "is no robot" if tag == 99 else "")
    low = {24: "is low", 23: "is lower"}
    cast.ask_for_spares(low, lambda *words: said.append(words))
    assert [tuple(request) for request in cast.due()] == [((24, 37), "is low")] and said == []
    spec = recast(spec, (24, 37))
    assert cast.substitutes([23, 37]) == {}
    spec = recast(spec, (37, 24))
    assert cast.substitutes([23]) == {23: 37}, "a spare that was put back may be put in again"


def test_a_spare_that_cannot_come_is_said(tmp_path: Path) -> None:
    spec, said = foraging(tmp_path), []
    cast = Cast(lambda: [spec], able=lambda tag: "is no robot")
    cast.ask_for_spares({24: "is low"}, lambda *words: said.append(words))
    (words,) = said
    assert "24" in words[0] and "is no robot" in words[0] and words[1] == "warning"
    assert cast.due() == []


def test_only_between_runs() -> None:
    asked: list[tuple[tuple[int, int], str]] = []
    fixed = Control(lambda wanted: None, lambda text: None)
    order = Order(OrderKind.REPLACE, "ben", pair=(23, 37))
    with pytest.raises(OrderError, match="no robot can be replaced here"):
        fixed.give(order)
    assert OrderKind.REPLACE not in fixed.can

    def replace(pair: tuple[int, int], by: str) -> str:
        asked.append((pair, by))
        return "done"

    control = Control(lambda wanted: None, lambda text: None, replace=replace)
    assert OrderKind.REPLACE in control.can and control.give(order) == "done"
    for state in State:
        control.state = state
        between = state in (State.WAITING, State.READY, State.ENDED)
        assert (OrderKind.REPLACE in control.can) == between, state
        if not between:
            with pytest.raises(OrderError, match=f"run 1 is {state.value}: .* between runs only"):
                control.give(order)
    assert asked == [((23, 37), "ben")]


@pytest.mark.parametrize("said", [None, "23=37", [23], [23, 37, 1], [True, 2], [-1, 2], [1, 65536]])
def test_what_is_no_pair_is_refused(said: object) -> None:
    with pytest.raises(ValueError, match=r"pair.*tags"):
        read_pair(said)


def test_a_pair_is_any_two_tags() -> None:
    assert read_pair([0, 65535]) == (0, 65535)


@pytest.mark.parametrize(
    ("is_argos", "is_policy", "name"),
    [(True, False, "walk"), (False, True, "walk"), (False, False, "")],
)
def test_a_program_whose_source_has_no_name_is_called_as_its_file(
    is_argos: bool, is_policy: bool, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_compiler() -> None:
        raise BuildError("there is no compiler")

    kinds = {"is_argos": is_argos, "is_policy": is_policy}
    program = SimpleNamespace(sources=[], short_name="walk", **kinds)
    monkeypatch.setattr(programs.build, "on_robots", lambda given: given)
    monkeypatch.setattr(programs.build, "source_tree", no_compiler)
    controller: Any = SimpleNamespace(id="ants", program=program)
    experiment: Any = SimpleNamespace(controllers=[controller])
    assert programs.told_programs(experiment) == {"ants": ToldProgram(name, "")}


def test_who_played_is_told_with_uid_and_program_as_far_as_it_is_known(tmp_path: Path) -> None:
    spec = recast(foraging(tmp_path), (23, 37))
    status = RobotStatus(
        *(37, "a", True, bytes(range(16)), "ant", "1", "05ae"), since_ns=1, heard_ns=1, udp=True,
        telemetry=None, sessions=1, sent=0, superseded=0, unsent=0, received=0, accepted=0,
        dropped={},
    )  # fmt: skip
    first, second = played(spec, {37: status})
    assert (first["part"], first["tag"], first["name"]) == (23, 37, spec.robots[0].id)
    assert (first["uid"], first["hash"]) == ("000102030405060708090a0b0c0d0e0f", "05ae")
    assert (second["part"], second["tag"], second["uid"]) == (24, 24, None)
