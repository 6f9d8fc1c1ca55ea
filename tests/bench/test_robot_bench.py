"""What the robots' daemon costs: the exact figures stay below their ceilings."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import require_tool, require_zig
from vsense.bench import robot
from vsense.robot import boards


def test_a_control_step_takes_so_many_instructions_at_most(tmp_path: Path) -> None:
    require_tool("qemu-arm", "qemu-user")
    require_tool("cc", "build-essential")
    require_zig()
    missing: list[str] = []
    counts = [robot.step_instructions(tmp_path, lambda text: None, missing) for _ in range(2)]
    print(f"instructions of a control step: {counts[0]}")
    assert missing == []
    assert counts[0] is not None and 10_000 < counts[0] <= robot.STEP_MAX
    assert counts[0] == counts[1], "the count is exact"


def test_what_is_missing_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    missing: list[str] = []
    assert robot.step_instructions(tmp_path, lambda text: None, missing) is None
    assert missing == ["instructions: no qemu-arm; sudo apt install qemu-user"]


def test_table_of_a_machine_that_can_measure_nothing() -> None:
    report = {
        "controller": "pollutant",
        "sizes": dict.fromkeys(boards.TARGETS),
        "size_max": robot.SIZE_MAX,
        "step_instructions": None,
        "step_max": robot.STEP_MAX,
        "step_calls": None,
        "calls_max": robot.CALLS_MAX,
        "memory_kb": None,
        "missing": ["everything"],
    }
    text = robot.table(report)
    assert text.count("not built") == len(boards.TARGETS)
    assert "not counted" in text and text.endswith("not measured: everything")
    report |= {"sizes": {"epuck": 108_900}, "step_instructions": 24_423, "memory_kb": 204}
    report |= {"step_calls": 39}
    text = robot.table(report)
    assert "epuck    108,900 bytes of 120,000 allowed" in text
    assert "24,423 of 25,000 allowed" in text and "204 kB" in text
    assert "system calls of a control step at 10 Hz, all processes: 39 of 40 allowed" in text
