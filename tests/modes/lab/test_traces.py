"""The traces of the lab's daemons: what is read of a run, and what a full disk has left of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from vsense.base.shared import LabError
from vsense.modes.lab._swarm import LabRobot, last_traced, read_trace

LINE = (
    "step {n} timestep {n} run 1 now_ns {n} rx_ns 3 capture_ns 2 age_ns 4 bound_ns 5 stale 0"
    " left 7 right 8 leds 0 values -\n"
)


@pytest.fixture
def robot(tmp_path: Path) -> LabRobot:
    return LabRobot(Path("daemon"), 31, "red", "argos:x", 0, 0.0, tmp_path / "31.trace")


COLUMNS = "# columns: step timestep run now_ns rx_ns capture_ns left right leds values\n"
"""What each daemon begins with, also one that was started again."""


def steps(robot: LabRobot, offset: int = 0) -> list[int]:
    return read_trace(robot, [], None, offset)["step"].tolist()


def test_without_a_file_no_step_was_made(robot: LabRobot) -> None:
    assert steps(robot) == [] and last_traced(robot) == -1


def test_only_lines_that_begin_in_the_run_are_read(robot: LabRobot) -> None:
    lines = [COLUMNS, *(LINE.format(n=n) for n in (8, 9, 10))]
    robot.trace.write_text("".join(lines))
    assert steps(robot) == [8, 9, 10]
    before = len("".join(lines[:2]))
    assert steps(robot, before) == [9, 10]
    assert steps(robot, before - 1) == [9, 10] == steps(robot, before - 20)
    assert steps(robot, before + 1) == [10] and steps(robot, 100_000) == []


@pytest.mark.parametrize("kept", [1, 4, 5, 8, 14, 20, 60, 110])
def test_half_a_line_costs_no_other_one(robot: LabRobot, kept: int) -> None:
    """A full disk took so many bytes of step 9; there was room again before step 12."""
    half = LINE.format(n=9)[:kept]
    robot.trace.write_text(LINE.format(n=8) + half)
    assert steps(robot) == [8] and last_traced(robot) == 8
    robot.trace.write_text(LINE.format(n=8) + half + LINE.format(n=12))
    assert steps(robot) == [8, 12] and last_traced(robot) == 12
    robot.trace.write_text(LINE.format(n=8) + half + COLUMNS + LINE.format(n=12) + COLUMNS)
    assert steps(robot) == [8, 12] and last_traced(robot) == 12


def test_the_last_step_of_a_long_trace_is_found_at_its_end(robot: LabRobot) -> None:
    robot.trace.write_text("".join(LINE.format(n=n) for n in range(400)))
    assert last_traced(robot) == 399


def test_a_broken_line_is_named_by_its_number(robot: LabRobot) -> None:
    robot.trace.write_text(COLUMNS + LINE.format(n=1) + "step 2 timestep three left 1\n")
    with pytest.raises(LabError, match=r"31\.trace:3: not a trace line"):
        read_trace(robot, [], None)
    with pytest.raises(LabError, match=r"31\.trace:3: not a trace line"):
        read_trace(robot, [], None, 12)
