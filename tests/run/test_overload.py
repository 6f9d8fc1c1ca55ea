"""What is said while timesteps are late."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.run.stage import Stage, experiment
from vsense.base.arena import POSE, ArenaState
from vsense.robots.link.wire import StopCause, Telemetry
from vsense.run.alarms import Overload
from vsense.run.runtime import Step
from vsense.run.verdict import RunRecord, VoidCriteria, judged

MS = 1_000_000
DT_NS = 100 * MS
EMPTY = ArenaState(0, 0, np.zeros(0, POSE), 0)


def step(number: int, *stages_ms: int) -> Step:
    """A timestep whose stages take so long."""
    capture, ready, arena, sent = np.cumsum((number * DT_NS, *(MS * ms for ms in stages_ms)))
    return Step(number, number, int(capture), int(ready), int(arena), int(sent), EMPTY, ())


def said(steps: list[Step], robots: Any = None) -> list[tuple[int, str]]:
    """What is said, and after which timestep."""
    overload, robots = Overload(DT_NS), robots or {}
    lines = [(some.run_timestep, overload.add(some, robots)) for some in steps]
    return [(number, text) for number, text in lines if text is not None]


def test_a_run_on_time_is_silent() -> None:
    assert said([step(n, 10, 5, 5) for n in range(1000)]) == []
    assert said([step(n, 10, 5, 95 if n % 11 == 0 else 5) for n in range(990)]) == []


INVALID = "a run with more than 10 % left out is invalid, unless its plan says otherwise"


@pytest.mark.parametrize(
    ("stages_ms", "cause"),
    [
        ((180, 5, 5), "pictures take 180 ms of 100 ms"),
        ((10, 150, 5), "tracking takes 150 ms of 100 ms"),
        ((10, 5, 120), "world and sensors take 120 ms of 100 ms"),
    ],
)
def test_it_says_what_takes_the_time(stages_ms: tuple[int, int, int], cause: str) -> None:
    stage = Stage(experiment(robots=2))
    first, second = (robot.tag for robot in stage.experiment.robots)
    stage.connected = {first, second}
    stage.statuses = {second: {"telemetry": Telemetry(stop_cause=StopCause.STALE)}}
    stage.statuses[first] = {"telemetry": Telemetry()}
    steps = [step(n, *stages_ms) for n in range(0, 200, 2)]
    assert said(steps, stage.robots())[0] == (
        100,
        f"this computer makes 5.0 of 10 timesteps per second; {INVALID}:"
        " of 101 in the last 10 s 51 were late and 50 left out;"
        f" robots stood still for old readings 50 % of the time; {cause}",
    )


def test_it_is_said_when_it_begins_now_and_then_and_when_it_ends() -> None:
    late, on_time = (200, 0, 0), (10, 0, 0)
    steps = [step(n, *(late if 100 <= n < 1000 else on_time)) for n in range(1200)]
    lines = said(steps)
    assert [number for number, _ in lines] == [199, 799, 1099]
    assert lines[-1][1] == "timesteps are on time again"


def test_at_the_end_the_whole_run_is_judged_once() -> None:
    overload = Overload(DT_NS)
    for n in range(0, 400, 4):
        overload.add(step(n, 250, 50, 50), {})
    assert overload.verdict() == (
        f"this computer made 2.5 of 10 timesteps per second; {INVALID}: of 397 100"
        " were late and 297 left out"
    )
    assert overload.verdict() is None
    # What is said and the verdict agree, on either side of the limit.
    for left_out, why in ((11, "11.0 % of the timesteps left out: too slow"), (10, "")):
        steps = {"timesteps": 100 - left_out, "left_out_timesteps": left_out, "late_timesteps": 11}
        assert judged(steps, RunRecord(), VoidCriteria())["why"] == why
        for n in range(left_out, 100):
            overload.add(step(n if n > left_out else 0, 10, 0, 0), {})
        assert (INVALID in str(overload.verdict())) is bool(why)
    for n in range(100):
        overload.add(step(n, *((200, 0, 0) if n % 5 == 0 else (10, 0, 0))), {})
    assert overload.verdict() == "timesteps were late: of 100 20 were late and 0 left out"
    for n in range(80):
        overload.add(step(n, 10, 0, 0), {})
    assert str(overload.verdict(100)).endswith("of 100 0 were late and 20 left out"), "as its table"


def test_a_run_that_can_be_slower_is_told_a_pace_that_would_do() -> None:
    overload = Overload(DT_NS, can_slow=True)
    told = [overload.add(step(n, 180, 5, 5), {}) for n in range(0, 200, 2)]
    (line,) = [text for text in told if text is not None]
    assert line.endswith("of 100 ms; it would keep up with --pace 0.35"), "half of them, and spare"
    assert str(overload.verdict()).endswith("; it would keep up with --pace 0.35")


@pytest.mark.parametrize("times", [6, 12])
def test_one_silence_after_the_other_is_overload(times: int) -> None:
    overload = Overload(DT_NS, can_slow=True)
    lines = [overload.add(step(n, 550, 5, 5), {}) for n in range(0, 400, times)]
    assert any(lines) and overload.alarm is not None
    assert f"{10 / times:.1f} of 10 timesteps per second" in str(overload.alarm)


def test_a_silence_and_another_run_are_no_overload() -> None:
    steps = [step(n, 10, 0, 0) for n in (*range(50), *range(150, 200), *range(300, 350))]
    assert said([*steps, *(step(n, 10, 0, 0) for n in range(99))]) == []


def test_the_runner_tells_people() -> None:
    class Slow(Stage):
        def step(self, timeout_s: float) -> Step:
            some = super().step(timeout_s)
            return replace(some, sent_ns=some.capture_ns + 2 * DT_NS)

    stage = Slow(experiment(timesteps=120))
    stage.connected = stage.seen = stage.tags
    stage.runner.wait(0.0)
    assert len(list(stage.runner.timesteps())) == 120
    told = stage.terminal.getvalue()
    assert told.count("timesteps are late: of 100 in the last 10 s 100 were late") == 1


def test_it_is_an_alarm_as_long_as_it_lasts() -> None:
    overload = Overload(DT_NS, "this computer")
    for some in (step(n, 10, 5, 120) for n in range(0, 220, 2)):
        overload.add(some, {})
    assert overload.alarm is not None and overload.alarm.kind == "overload"
    assert overload.alarm.text == "this computer makes 5.0 of 10 timesteps per second"
    assert overload.alarm.cause == f"{INVALID}; world and sensors take 120 ms of 100 ms"
    for some in (step(n, 10, 5, 5) for n in range(220, 440)):
        overload.add(some, {})
    assert overload.alarm is None
