"""Verdict and advice on a link, and what people are shown of it."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from tests.rigs.processes import free_port
from tests.robots.link.rig import KEYED, MS, PATIENCE_S, TABLE, Robot
from tests.run.stage import counted
from vsense import cli
from vsense.base.clock import host_ns
from vsense.robots.link.status import LinkFigures
from vsense.robots.link.table import ExpectedRobot
from vsense.run import link_check
from vsense.run.link_check import LinkLoad, RunLinkCheck, as_json, judge, table, worst

GOOD = LinkFigures(
    heard_s=60.0,
    packets=1200,
    loss_up=0.0,
    loss_down=0.01,
    round_trip_p50_ms=2.0,
    round_trip_p99_ms=9.0,
    jitter_ms=1.0,
    gap_ms=80.0,
    late=0.0,
    signal_dbm=-55.0,
    weakest_dbm=-58,
    bit_rate_mbit_s=54.0,
    retries=0,
    power_saving=False,
    sessions=1,
)
THERE = replace(counted(1), connected=True, udp=True)


@pytest.mark.parametrize(
    ("change", "holds", "verdict", "advice"),
    [
        ({}, True, "holds 100 ms", ""),
        ({"power_saving": True}, True, "holds 100 ms", "vsense robot deploy turns it off"),
        ({"signal_dbm": -82.0}, True, "holds 100 ms", "-82 dBm is weak"),
        ({"loss_down": 0.2}, True, "holds 100 ms", "another channel"),
        ({"gap_ms": 300.0}, True, "but nothing was heard for 0.30 s", "another channel"),
        ({"gap_ms": 400.0}, False, "nothing heard for 0.4 s", "another channel"),
        ({"gap_ms": 900.0, "power_saving": True}, False, "nothing heard for 0.9 s", "power saving"),
        ({"stale": 1}, False, "would have stopped once", "another channel"),
        ({"round_trip_p99_ms": 140.0}, False, "the timestep of 100 ms", "packets wait somewhere"),
        ({"late": 0.02}, False, "2.0 % of its control steps began late", "the board is late"),
        ({"packets": 0}, False, "not connected", "is it on"),
    ],
)
def test_verdicts(change: dict[str, float], holds: bool, verdict: str, advice: str) -> None:
    one = judge(THERE, replace(GOOD, **change), 0.1)  # type: ignore[arg-type]
    assert one.holds == holds
    assert verdict in one.verdict
    assert advice in one.advice and bool(advice) == bool(one.advice)


def test_who_was_turned_away_and_who_has_no_udp() -> None:
    old = replace(THERE, refused="runs an older vsensed: bring it this one with ...")
    one = judge(old, LinkFigures(), 0.1)
    assert (one.verdict, one.advice) == ("turned away", old.refused)
    blocked = judge(replace(THERE, udp=False), GOOD, 0.1)
    assert blocked.holds and blocked.advice.startswith("no UDP gets through")


def test_the_worst_is_named_and_all_is_in_the_table() -> None:
    good = judge(THERE, GOOD, 0.1)
    weak = judge(replace(THERE, tag=8, name="b"), replace(GOOD, gap_ms=700.0), 0.1)
    gone = judge(replace(THERE, tag=9, name="c"), LinkFigures(), 0.1)
    assert worst([good, weak]) is weak and worst([gone, weak, good]) is gone and worst([]) is None
    text = table([good, weak, gone]).splitlines()
    assert "-55" in text[1] and text[1].endswith("holds 100 ms")
    assert text[-2] == "the worst link: 9 c: not connected"
    assert text[-1] == "1 of 3 robots would hold the experiment"
    assert "the worst" not in table([weak]), "there is one"
    asleep = judge(THERE, replace(GOOD, power_saving=True, gap_ms=60.0), 0.1)
    assert worst([good, asleep]) is asleep, "it holds, and something is to be done about it"
    told = as_json([good, weak], {"experiment": "foraging"})
    assert (told["holds"], told["worst"], told["robots"][0]["gap_ms"]) == (False, 8, 80.0)


class MeasuredServer:
    """What a check asks of a server: two robots, and one with the original's client."""

    def __init__(self) -> None:
        self.began = 0

    def measure(self) -> None:
        self.began += 1

    def measured(self) -> dict[int, LinkFigures]:
        gone = LinkFigures()
        return {7: replace(GOOD, power_saving=True), 8: gone, 9: gone}

    def robots(self) -> dict[int, Any]:
        there = replace(THERE, sessions=1)
        away = replace(there, tag=8, connected=False)
        return {7: there, 8: away, 9: replace(there, tag=9, sessions=0)}


def test_a_check_before_a_run_measures_those_that_have_sessions(monkeypatch) -> None:
    server, said, now_ns = MeasuredServer(), list[str](), [10**9]
    monkeypatch.setattr(link_check, "host_ns", lambda: now_ns[0])
    check = RunLinkCheck(server, 2.0, 0.1, said.append)  # type: ignore[arg-type]
    assert not check.cut_short and check() == "links are measured: 0 of 2 s, wheels stand still"
    now_ns[0] += 10**9
    assert check().startswith("links are measured: 1 of 2 s") and check.cut_short
    now_ns[0] += 10**9
    assert check() == check() == "" and server.began == 1 and not check.cut_short
    assert [verdict.tag for verdict in check.verdicts] == [7, 8]
    # Whoever never came is in the run's own words.
    assert check.words.startswith("robot 7 before the run: holds 100 ms, power saving is on")
    assert "robot 8" not in check.words and "links over 2 s" in said[0]


def test_what_goes_wrong_with_the_link_is_said_and_that_it_begins_is_not() -> None:
    said: list[str] = []
    expected = {1: ExpectedRobot("epuck_1", TABLE)}
    with LinkLoad(expected, 100 * MS, ("127.0.0.1", 0), KEYED, said.append) as load:
        host: Any = SimpleNamespace(clock=host_ns, port=load.port, server=load)
        robot, other = Robot(host, 1).open(), Robot(host, 1, uid=bytes(16))
        assert said == [] and load.robots()[1].connected
        other.connect()
        until_s = time.monotonic() + PATIENCE_S
        while not said:
            assert time.monotonic() < until_s
        assert "another robot" in said[0] or "refused" in said[0]
    for one in (robot, other):
        one.close()
    assert len(said) == 1


def test_a_command_that_fails_says_so_beside_its_json(capsys: pytest.CaptureFixture[str]) -> None:
    words = f"robot link 31,1843 --json --wait 1 --insecure --host 127.0.0.1 --port {free_port()}"
    assert cli.main(words.split()) == 1
    out, err = capsys.readouterr()
    assert json.loads(out)["holds"] is False
    assert "2 of 2 links do not hold; robot 31 (robot): not connected" in err
