"""The verdict on a run: every way in which what was there can differ from what was expected."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import pytest

from vsense.run.verdict import RobotRecord, RunRecord, VoidCriteria, exit_code, judged

PLAN = VoidCriteria(lost_s=5.0, moved_mm=30.0, fenced_s=0.5, late=0.01)
NO_PLAN = VoidCriteria()
LENIENT = VoidCriteria(ended_early=False, away_from_start=False)


def run(*robots: dict[str, Any], **known: Any) -> RunRecord:
    """A run in which two robots did all that was expected, but for what is said of the first."""
    first = replace(RobotRecord(name="a"), **(robots[0] if robots else {}))
    return RunRecord(robots=(first, RobotRecord(name="b")), **known)


OTHER = "runs 'foraging', the file says 'pollutant'"

ROBOTS: list[tuple[dict[str, Any], VoidCriteria, str, str]] = [
    ({}, NO_PLAN, "", ""),
    ({"came": False}, NO_PLAN, "a never came", ""),
    ({"came": False, "refused": OTHER}, NO_PLAN, f"a was refused: it {OTHER}", ""),
    ({"came": False, "seen": False, "unlinked_s": 60.0}, LENIENT, "a never came", ""),
    ({"other_program": OTHER}, NO_PLAN, "", f"a {OTHER}"),
    ({"seen": False}, NO_PLAN, "never seen: a", ""),
    ({"acted": False}, NO_PLAN, "a never had fresh readings", ""),
    ({"starts": 1}, NO_PLAN, "started again in mid-run: a's controller", ""),
    ({"held_s": 1.5, "held_by": "base"}, NO_PLAN, "a held its wheels for 1.5 s (base)", ""),
    ({"held_s": 0.5, "held_by": "base"}, NO_PLAN, "", ""),
    ({"unlinked_s": 1.2}, NO_PLAN, "a had no link for 1.2 s", ""),
    ({"unlinked_s": 1.2}, PLAN, "", "a had no link for 1.2 s"),
    ({"unlinked_s": 0.4}, NO_PLAN, "", "a had no link for 0.4 s"),
    ({"lost_s": 60.0}, NO_PLAN, "", ""),
    ({"lost_s": 5.1}, PLAN, "a lost for 5.1 s", ""),
    ({"lost_s": 5.0}, PLAN, "", ""),
    ({"away": "stuck"}, NO_PLAN, "not at the start: a (stuck)", ""),
    ({"away": "stuck"}, LENIENT, "", ""),
    ({"moved_mm": 31.0}, PLAN, "a moved by 31 mm by hand", ""),
    ({"moved_mm": 30.0}, PLAN, "", ""),
    ({"moved_mm": 31.0}, NO_PLAN, "", ""),
    ({"unseen_s": 2.0}, NO_PLAN, "", "a stood 2.0 s unseen"),
    ({"fenced_s": 0.6}, NO_PLAN, "", "a stood 0.6 s for the fence"),
    ({"fenced_s": 0.6}, PLAN, "a stood 0.6 s for the fence", "a stood 0.6 s for the fence"),
    ({"rests": True, "came": False, "seen": False}, NO_PLAN, "", "a rested: its battery was low"),
    ({"rests": True, "away": "late"}, NO_PLAN, "", "a rested: its battery was low"),
]


RUNS: list[tuple[dict[str, Any], VoidCriteria, str, str]] = [
    ({"ended": "stopped by ben"}, NO_PLAN, "stopped by ben before its end", ""),
    ({"ended": ""}, NO_PLAN, "failed before its end", ""),
    ({"ended": "stopped by ben"}, LENIENT, "", ""),
    ({"ended": "interrupted", "endless": True}, NO_PLAN, "", ""),
    ({"ended": "stop", "timesteps": False}, LENIENT, "nothing was measured: stop", ""),
    ({"late": 0.02}, PLAN, "2.0 % of the timesteps late", ""),
    ({"late": 0.01}, PLAN, "", ""),
    ({"late": 0.1}, NO_PLAN, "", ""),
    ({"late": 0.9}, NO_PLAN, "", "90.0 % of the timesteps late"),
    ({"late": 0.9, "left_out": 0.1}, NO_PLAN, "", "90.0 % of the timesteps late"),
    ({"late": 0.9, "left_out": 0.2}, NO_PLAN, "20.0 % of the timesteps left out: too slow", ""),
    ({"late": 0.3, "left_out": 0.2}, VoidCriteria(late=0.4), "", "30.0 % of the timesteps late"),
    ({"silent_s": 1.1}, NO_PLAN, "no arena state for 1.1 s", ""),
    ({"silent_s": 0.9}, NO_PLAN, "", ""),
    ({"unseen": ["lamp"]}, NO_PLAN, "never seen: lamp", ""),
    ({"changes": 1}, NO_PLAN, "", "its world was changed once by hand"),
    ({"changes": 3}, NO_PLAN, "", "its world was changed 3 times by hand"),
    ({"link_check": "robot 3 sleeps"}, NO_PLAN, "", "robot 3 sleeps"),
    ({"failed": ["x"]}, NO_PLAN, "failed in mid-run: x", ""),
    ({"failed": ["x"], "ended": "failed"}, NO_PLAN, "failed in mid-run: x", ""),
    ({"failed": ["x"], "timesteps": False}, NO_PLAN, "nothing was measured: x", ""),
    ({"unlogged": ["x"]}, LENIENT, "its figures are not of all of it: its logs lack x", ""),
    ({"complaints": ["mine asks for x"]}, NO_PLAN, "", "mine asks for x"),
]


@pytest.mark.parametrize(
    ("record", "criteria", "why", "note"),
    [*((run(robot), *rest) for robot, *rest in ROBOTS), *((run(**k), *rest) for k, *rest in RUNS)],
)
def test_what_was_not_as_the_file_describes_it(
    record: RunRecord, criteria: VoidCriteria, why: str, note: str
) -> None:
    verdict = record.judge(criteria)
    assert (verdict.why, verdict.note) == (why, note)


def test_the_tables_above_have_every_way_in_which_a_run_can_differ() -> None:
    named = {name for robot, *_ in ROBOTS for name in robot}
    assert named == {field.name for field in fields(RobotRecord)} - {"name"}
    named = {name for known, *_ in RUNS for name in known}
    assert named == {field.name for field in fields(RunRecord)} - {"robots"}


def test_all_reasons_stand_one_after_the_other_and_many_robots_are_counted() -> None:
    robots = [RobotRecord(name=f"r{n}", came=False) for n in range(8)]
    record = RunRecord(ended="stopped by ben", robots=robots, unseen=["lamp"])
    assert record.judge(NO_PLAN).why == (
        "stopped by ben before its end; r0 never came, r1 never came, r2 never came, r3 never came,"
        " r4 never came, r5 never came and 2 more; never seen: lamp"
    )


def test_the_exit_code_is_that_of_runs_that_nobody_has_ended() -> None:
    steps = {"timesteps": 90, "left_out_timesteps": 10, "late_timesteps": 15}
    good, missing, stopped = (
        judged(steps, record, VoidCriteria(late=0.15))
        for record in (run(), run({"came": False}), run(ended="stopped by ben"))
    )
    assert [s["verdict"] for s in (good, missing, stopped)] == ["valid", "void", "void"]
    assert judged(steps, run(), VoidCriteria(late=0.14))["why"] == "15.0 % of the timesteps late"
    assert exit_code([good, good]) == exit_code([good, stopped]) == exit_code([]) == 0
    assert exit_code([good, missing]) == exit_code([good], ["time"]) == 1
    assert exit_code([good], ["interrupted"]) == 0
    both = judged(steps, run({"came": False}, ended="stopped by ben", endless=True), NO_PLAN)
    assert exit_code([both]) == 1, "an endless run has no other end"
