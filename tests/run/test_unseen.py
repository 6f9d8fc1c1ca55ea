"""A robot that no camera sees stands until it is seen again: the table of `vsense.run._unseen`."""

from __future__ import annotations

import numpy as np
import pytest

from tests.run.stage import Stage, experiment
from vsense.base.arena import POSE, ArenaState
from vsense.config.experiment import load
from vsense.run._unseen import UnseenRobots
from vsense.run.orders import Order, OrderKind

MS = 1_000_000


def state(ms: int, *seen: int) -> ArenaState:
    """An arena state with robots 7 and 8, of which some are seen."""
    rows = np.zeros(2, dtype=POSE)
    rows["tag"], rows["seen"] = (7, 8), [tag in seen for tag in (7, 8)]
    return ArenaState(ms // 100, ms * MS, rows, len(seen))


def watched(
    *sightings: tuple[int, ...], limit_s: float | None = 1.0
) -> tuple[UnseenRobots, list[str]]:
    """What is said of a run with a state each 100 ms, in which these are seen."""
    unseen = UnseenRobots({7: "seven", 8: "eight"}, limit_s)
    lines = [
        f"{100 * n} {line}"
        for n, tags in enumerate(sightings)
        for line in unseen.update(state(100 * n, *tags))
    ]
    return unseen, lines


def test_who_is_not_seen_for_a_second_stands_until_three_sightings_in_a_row() -> None:
    hidden = [(7, 8)] * 3 + [(8,)] * 12 + [(7, 8), (7, 8), (8,), (7, 8), (7, 8), (7, 8), (7, 8)]
    unseen, lines = watched(*hidden)
    assert lines == [
        "1200 robot seven stands: not seen for 1.0 s",
        "2000 robot seven is seen again and goes on; it stood 0.8 s",
    ]
    assert unseen.tags == frozenset() and unseen.stood_ns == {7: 800 * MS}


def test_who_was_never_seen_stands_too() -> None:
    unseen, lines = watched(*[(8,)] * 11)
    assert unseen.tags == {7} and lines == ["1000 robot seven stands: not seen for 1.0 s"]


def test_where_robots_drive_on_unseen_nobody_stands() -> None:
    unseen, lines = watched(*[(8,)] * 50, limit_s=None)
    assert unseen.tags == frozenset() and lines == []


def test_times_without_arena_states_and_pauses_count_for_nobody() -> None:
    unseen = UnseenRobots({7: "seven"}, 1.0)
    unseen.update(state(0, 7))
    unseen.update(state(10_000))
    assert unseen.tags == frozenset()
    for ms in range(10_100, 10_600, 100):
        unseen.update(state(ms))
        unseen.pause()
    assert unseen.tags == frozenset()


def test_a_new_run_begins_with_nobody_standing() -> None:
    unseen, _ = watched(*[()] * 12)
    assert unseen.tags == {7, 8}
    unseen.begin({7: "seven"})
    assert unseen.tags == frozenset() and unseen.stood_ns == {}
    assert unseen.update(state(0)) == []


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        ("", 1.0),
        ('vs:unseen="drive"', None),
        ('vs:unseen="stand" vs:unseen_s="2.5"', 2.5),
    ],
)
def test_what_the_file_says(attributes: str, expected: float | None, tmp_path) -> None:  # type: ignore[no-untyped-def]
    text = load("pollutant").path.read_text()
    path = tmp_path / "mine.argos"
    path.write_text(text.replace('random_seed="1"', f'random_seed="1" {attributes}'))
    assert load(str(path)).unseen_s == expected


def test_the_runner_holds_that_robot_alone_and_says_how_long_it_stood() -> None:
    stage = Stage(experiment(timesteps=40))
    hidden, other = sorted(robot.tag for robot in stage.experiment.robots)
    (name,) = (robot.id for robot in stage.experiment.robots if robot.tag == hidden)
    stage.connected, stage.seen = {hidden, other}, {hidden, other}
    stage.runner.wait(0.0)
    held: list[frozenset[int]] = []
    for step in stage.runner.timesteps():
        held.append(stage.held)
        if step.run_timestep == 5:
            stage.seen = {other}
        elif step.run_timestep == 25:
            stage.seen = {hidden, other}
    assert {frozenset(), frozenset({hidden})} == set(held)
    first, last = held.index({hidden}), len(held) - held[::-1].index({hidden})
    assert (first, last) == (15, 28), "a second after it was last seen, to its third sighting"
    said = stage.terminal.getvalue()
    assert f"robot {name} stands: not seen for 1.0 s" in said
    assert f"robot {name} is seen again and goes on; it stood 1.3 s" in said
    assert stage.runner.unseen.stood_ns == {hidden: 1_300 * MS}


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
        assert stage.held == frozenset()
