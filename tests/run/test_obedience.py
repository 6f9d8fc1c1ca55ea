"""A robot that goes on after STOP is said loudly, and nobody else is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.run.stage import status
from vsense.base.arena import POSE, ArenaState
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.wire import Telemetry, Wanted
from vsense.run.alarms import Obedience, disobeys

S = 1_000_000_000
MS = 1_000_000
STANDS = Telemetry(state=Wanted.STOP)
RUNS = Telemetry(state=Wanted.RUN)
TURNS = Telemetry(state=Wanted.STOP, left_steps_s=-1)


def robot(
    said: Telemetry, heard_ms: int, wanted: Wanted = Wanted.STOP, ordered_ms: int = 0
) -> RobotStatus:
    return status(
        7,
        "seven",
        telemetry=said,
        heard_ns=heard_ms * MS,
        wanted=wanted,
        ordered_ns=ordered_ms * MS,
    )


@pytest.mark.parametrize("said", [RUNS, TURNS])
@pytest.mark.parametrize("wanted", [Wanted.STOP, Wanted.PAUSE, Wanted.IDLE])
def test_what_it_reports_counts_after_150_ms(said: Telemetry, wanted: Wanted) -> None:
    assert disobeys(robot(said, 149, wanted), 160 * MS) == ""
    text = disobeys(robot(said, 150, wanted), 160 * MS)
    assert text.startswith(f"does NOT stop: told to {wanted.name.lower()} 0.16 s ago, it reports")
    assert disobeys(robot(STANDS, 150, wanted), 160 * MS) == ""


def test_who_may_move_or_is_not_there_is_not_accused() -> None:
    for wanted in (Wanted.RUN, Wanted.HOME):
        assert disobeys(robot(RUNS, 900, wanted), S) == ""
    assert disobeys(replace(robot(RUNS, 900), connected=False), S) == ""
    assert disobeys(replace(robot(RUNS, 900), telemetry=None), S) == ""
    # What was heard before the order, and nothing since.
    assert disobeys(robot(RUNS, 200, ordered_ms=100), 5 * S) == ""


def test_it_is_said_once_and_so_is_its_end() -> None:
    watch = Obedience()
    said = [
        *(robot(RUNS, 900, Wanted.RUN), robot(RUNS, 1000, ordered_ms=950)),
        *(robot(RUNS, ms, ordered_ms=950) for ms in range(1050, 2000, 100)),
        *(robot(STANDS, ms, ordered_ms=950) for ms in range(2000, 2500, 100)),
    ]
    lines = [line for one in said for line in watch.update({7: one}, None, one.heard_ns or 0)]
    assert lines == [
        "ROBOT 7 does NOT stop: LIFT IT (told to stop 0.20 s ago, it reports that it runs)",
        "robot 7 obeys again",
    ]


def seen(ms: int, x_m: float, yaw_rad: float = 0.0) -> ArenaState:
    robots = np.zeros(1, dtype=POSE)
    row = robots[0]
    row["tag"], row["seen"], row["capture_ns"] = 7, True, ms * MS
    row["x_m"], row["yaw_rad"] = x_m, yaw_rad
    return ArenaState(ms // 100, ms * MS, robots, 1)


def watched(poses: list[tuple[float, float]], ran: bool = True) -> list[tuple[int, str]]:
    """What is said from STOP on, every 100 ms, of a robot that says that it stands."""
    watch, lines = Obedience(), []
    if ran:
        watch.update({7: robot(RUNS, 0, Wanted.RUN)}, None, 0)
    for number, (x_m, yaw_rad) in enumerate(poses):
        ms = 100 * number
        state = seen(ms, x_m, yaw_rad)
        lines += [(ms, t) for t in watch.update({7: robot(STANDS, ms)}, state, ms * MS)]
    return lines


def test_a_robot_that_is_seen_moving_is_told_whatever_it_says() -> None:
    forward = [(0.003 * n, 0.0) for n in range(20)]
    (ms, text), *_ = watched(forward)
    assert ms == 400 and text.endswith("told to stop 0.40 s ago, the cameras see it move)")
    turning = [(0.0, math.remainder(3.0 + 0.05 * n, math.tau)) for n in range(20)]
    assert len(watched(turning)) == 1
    lines = watched(forward + [forward[-1]] * 8)
    assert [text.split()[0] for _, text in lines] == ["ROBOT", "robot"]


def test_what_the_cameras_saw_before_a_run_counts_for_nothing_after_it() -> None:
    watch = Obedience()
    watch.update({7: robot(RUNS, 0, Wanted.RUN)}, None, 0)
    for ms in range(0, 1000, 100):
        watch.update({7: robot(STANDS, ms)}, seen(ms, 0.0001 * ms), ms * MS)
    assert watch.update({7: robot(RUNS, 1000, Wanted.RUN)}, None, S) == ["robot 7 obeys again"]
    stopped = robot(STANDS, 1100, ordered_ms=1050)
    assert watch.update({7: stopped}, seen(1100, 0.5), 1100 * MS) == []


def test_who_stands_and_is_then_carried_is_not_accused() -> None:
    still, carried = (
        [(0.0005 * (n % 2), 0.001) for n in range(12)],
        [(0.1 * n, 1.0) for n in range(20)],
    )
    assert watched(still + carried) == []
    assert watched(carried, ran=False) == [], "people place robots before the run"


def test_a_robot_that_moves_without_a_link_is_told_and_who_stands_is_not() -> None:
    def lost(poses: list[float]) -> tuple[Obedience, list[tuple[int, str]]]:
        watch, lines = Obedience(), []
        watch.update({7: robot(RUNS, 0, Wanted.RUN)}, None, 0)
        gone = replace(robot(RUNS, 0, Wanted.RUN), connected=False)
        for number, x_m in enumerate(poses):
            ms = 100 * number
            found = watch.update({7: gone}, seen(ms, x_m), ms * MS)
            lines += [(ms, line) for line in found]
        return watch, lines

    # A robot stops by itself 0.4 s after the last that it heard.
    coasting = [0.02 * min(n, 5) for n in range(30)]
    assert lost(coasting)[1] == []
    watch, ((ms, text),) = lost([0.02 * n for n in range(30)])
    assert 800 <= ms <= 1300
    assert text.startswith("ROBOT 7 moves without a link: LIFT IT (nothing heard for ")
    (alarm,) = watch.alarms
    assert (alarm.kind, alarm.text) == ("no_link", "robot 7 moves without a link: lift it")
    assert "the cameras see it move; or switch it off" in alarm.cause
    watch.update({7: robot(RUNS, 3000, Wanted.RUN)}, None, 3000 * MS)
    assert watch.alarms == ()


def test_who_moves_without_a_link_and_is_told_to_stop_is_told_again() -> None:
    watch = Obedience()
    watch.update({7: robot(RUNS, 0, Wanted.RUN)}, None, 0)
    gone = replace(robot(RUNS, 0, Wanted.RUN), connected=False)
    lines = []
    for ms in range(0, 3000, 100):
        if ms == 2000:
            gone = replace(gone, wanted=Wanted.STOP, ordered_ns=ms * MS)
        lines += watch.update({7: gone}, seen(ms, 2e-4 * ms), ms * MS)
    assert [line.partition(":")[0] for line in lines] == [
        "ROBOT 7 moves without a link", "ROBOT 7 does NOT stop",
    ]  # fmt: skip


def test_one_that_hung_before_it_was_told_to_stop_is_not_believed_to_stand() -> None:
    watch = Obedience()
    runs, gone = robot(RUNS, 900, Wanted.RUN), replace(robot(RUNS, 900), connected=False)
    watch.update({7: runs}, seen(900, 0.0), 900 * MS)
    assert not watch.is_unsure({7: runs}, 950 * MS), "its next report will say"
    assert watch.is_unsure({7: gone}, 2000 * MS)
    assert not watch.is_unsure({7: gone}, 2900 * MS), "by then the cameras have seen it"
    for ms in range(1900, 2400, 100):
        watch.update({7: gone}, seen(ms, 0.0), ms * MS)
    assert not watch.is_unsure({7: gone}, 2400 * MS), "it stands"


def test_a_robot_that_does_not_obey_is_an_alarm_until_it_does() -> None:
    watch = Obedience()
    watch.update({7: robot(RUNS, 400)}, None, 400 * MS)
    (alarm,) = watch.alarms
    assert (alarm.kind, alarm.text) == ("disobeys", "robot 7 does NOT stop: lift it")
    assert alarm.cause.startswith("told to stop 0.40 s ago, it reports that it runs; ")
    watch.update({7: robot(STANDS, 500)}, None, 500 * MS)
    assert watch.alarms == ()
