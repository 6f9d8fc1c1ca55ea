"""Who is lost, and who is moved by hand: nobody else is accused."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from tests.run.stage import status
from vsense.base.arena import POSE, ArenaState
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.wire import StopCause, Telemetry
from vsense.run._witness import Witness
from vsense.run.verdict import RobotRecord

MS = 1_000_000
STANDS, DRIVES = Telemetry(), Telemetry(left_steps_s=900, right_steps_s=900)
NAMES = {7: "seven", 8: "eight"}


def arena(ms: int, places: dict[int, tuple[float, float]]) -> ArenaState:
    robots = np.zeros(len(places), dtype=POSE)
    for row, (tag, (x_m, y_m)) in zip(robots, places.items()):
        row["tag"], row["seen"], row["x_m"], row["y_m"] = tag, True, x_m, y_m
    return ArenaState(ms // 100, ms * MS, robots, 1)


def both(said: Telemetry, **seven: object) -> dict[int, RobotStatus]:
    return {
        7: status(7, "seven", **{"telemetry": said, "connected": True, **seven}),
        8: status(8, "eight", telemetry=DRIVES, connected=True),
    }


def watched(moments: Iterable[tuple[int, float]], said: Telemetry, eight_m: float) -> Witness:
    """Robot 7 at x by ms, and robot 8 somewhere."""
    witness = Witness(NAMES)
    for ms, x_m in moments:
        witness.observe(arena(ms, {7: (x_m, 0.0), 8: (eight_m, 0.0)}), both(said), ms * MS)
    return witness


def test_who_is_neither_seen_nor_connected_is_lost() -> None:
    witness = Witness(NAMES)
    for ms in range(0, 10_000, 100):
        unseen, unlinked = 2000 <= ms < 5000, 4000 <= ms < 7500
        places = {8: (1.0, 0.0)} if unseen else {7: (0.0, 0.0), 8: (1.0, 0.0)}
        witness.observe(arena(ms, places), both(STANDS, connected=not unlinked), ms * MS)
    assert {r.name: r.lost_s for r in witness.records.values()} == pytest.approx(
        {"seven": 5.6, "eight": 0.1}
    )
    assert witness.gone == []


def test_who_was_never_there_and_who_is_gone_at_the_end() -> None:
    witness = Witness(NAMES)
    for ms in range(0, 3100, 100):
        places = {7: (0.0, 0.0)} if ms < 1000 else {}
        witness.observe(arena(ms, places), both(STANDS), ms * MS)
    assert {r.name: r.lost_s for r in witness.records.values()} == pytest.approx(
        {"seven": 2.1, "eight": 3.0}
    )
    assert witness.gone == [7, 8]


def test_nobody_is_lost_in_a_pause_nor_by_one_timestep_at_the_end() -> None:
    witness = Witness(NAMES)
    for run_ms in range(0, 3100, 100):
        ms = run_ms + (60_000 if run_ms >= 1000 else 0)
        places = {7: (0.0, 0.0), 8: (1.0, 0.0)} if run_ms < 3000 else {8: (1.0, 0.0)}
        witness.observe(arena(ms, places), both(STANDS), run_ms * MS)
    assert {r.name: r.lost_s for r in witness.records.values()} == pytest.approx(
        {"seven": 0.1, "eight": 0.1}
    )
    assert witness.gone == []


def test_who_is_moved_in_a_pause_is_moved_by_hand() -> None:
    witness = Witness(NAMES)
    for run_ms, ms, x_m in ((0, 0, 0.0), (100, 100, 0.0), (200, 9200, 0.3)):
        witness.observe(arena(ms, {7: (x_m, 0.0), 8: (1.0, 0.0)}), both(DRIVES), run_ms * MS)
    assert witness.records[7].moved_mm == pytest.approx(300 - 16)


def test_a_robot_that_drives_as_fast_as_it_can_is_not_moved_by_hand() -> None:
    drive = [(ms, 0.129 * ms / 1000.0) for ms in range(0, 8000, 100)]
    assert watched(drive, DRIVES, 3.0).records[7].moved_mm == 0.0
    # Nor is one that was not seen for three seconds of that.
    assert watched(drive[:20] + drive[50:], DRIVES, 3.0).records[7].moved_mm == 0.0


def test_a_robot_that_jumps_is() -> None:
    jump = [(0, 0.0), (100, 0.01), (200, 0.25), (300, 0.26)]
    assert watched(jump, DRIVES, 3.0).records[7].moved_mm == pytest.approx(240 - 16)


def test_a_robot_that_stands_and_is_moved_slowly_is() -> None:
    pushed = [(ms, 0.05 * max(ms - 2000, 0) / 1000.0) for ms in range(0, 4000, 100)]
    assert watched(pushed, STANDS, 3.0).records[7].moved_mm == pytest.approx(50.0, abs=6.0)
    assert watched(pushed, DRIVES, 3.0).records[7].moved_mm == 0.0
    # Another robot stands beside it, and may have pushed it.
    assert watched(pushed, STANDS, 0.08).records[7].moved_mm == 0.0


def test_cameras_that_tremble_move_nobody() -> None:
    tremble = [(ms, 0.002 * (ms // 100 % 2) + 1e-6 * ms) for ms in range(0, 20_000, 100)]
    assert watched(tremble, STANDS, 3.0).records[7].moved_mm < 5.0


def test_who_they_are_and_what_they_run() -> None:
    witness = Witness(NAMES)
    told = both(
        Telemetry(battery_mv=3700), uid=b"\x01" * 16, controller="walk", hash="abc", connected=True,
        version="0.1.0+0123",
    )  # fmt: skip
    witness.observe(arena(0, {}), told, 0)
    assert witness.volts == [3.7]
    assert witness.uids[0] == "01" * 16
    assert {"walk=abc", "vsensed=0.1.0+0123"} <= set(witness.programs)


def seen_twice(first: RobotStatus, later: RobotStatus) -> RobotRecord:
    """What there was of robot 7 in two seconds: one second as at first, one as later."""
    witness = Witness({7: "seven"}, {50: "lamp", 51: "box"})
    for ms in range(0, 2000, 100):
        places = {7: (0.0, 0.0), 51: (1.0, 0.0)}
        witness.observe(arena(ms, places), {7: first if ms < 1000 else later}, ms * MS)
    assert witness.unseen == ["lamp"]
    return witness.records[7]


def seven(**known: object) -> RobotStatus:
    return status(7, "seven", **known)


STALE = Telemetry(stop_cause=StopCause.STALE)


def test_who_never_came_and_why_and_what_others_run() -> None:
    away = seen_twice(seven(connected=False), seven(connected=False, refused="runs 'walk'"))
    assert (away.came, away.refused, away.unlinked_s) == (False, "runs 'walk'", 1.9)
    late = seen_twice(seven(connected=False, refused="runs 'walk'"), seven(other_program="runs x"))
    assert (late.came, late.refused, late.other_program) == (True, "", "runs x")
    assert late.unlinked_s == pytest.approx(0.9) and late.seen


def test_who_never_acted_on_a_reading() -> None:
    assert not seen_twice(seven(telemetry=STALE), seven(telemetry=STALE)).acted
    assert seen_twice(seven(telemetry=STALE), seven()).acted
    assert seen_twice(seven(telemetry=None), seven(telemetry=None)).acted, "nobody knows"
    wanted = seven(telemetry=Telemetry(stop_cause=StopCause.WANTED))
    assert not seen_twice(wanted, seven(telemetry=STALE)).acted, "it stood all the time"


def test_nobody_is_accused_of_the_time_in_which_the_tracker_was_silent() -> None:
    witness = Witness({7: "seven"})
    hung = seven(telemetry=Telemetry(stop_cause=StopCause.NO_BEAT))
    for ms, status_of in (
        (0, seven()),
        (100, seven(connected=False)),
        (5100, hung),
        (5200, seven()),
    ):
        witness.observe(arena(ms, {7: (0.0, 0.0)}), {7: status_of}, ms * MS)
    record = witness.records[7]
    assert (record.unlinked_s, record.held_s) == (0.1, 0.3)


def test_whose_daemon_was_started_again_and_who_holds_its_wheels() -> None:
    assert seen_twice(seven(starts=2), seven(starts=3)).starts == 1
    assert seen_twice(seven(starts=0, connected=False), seven(starts=1)).starts == 0
    held = seen_twice(seven(), seven(telemetry=Telemetry(stop_cause=StopCause.BASE)))
    assert (held.held_s, held.held_by) == (pytest.approx(1.0), "its base did not answer")
