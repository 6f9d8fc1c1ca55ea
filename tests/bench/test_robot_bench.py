"""What the robots' daemon costs: the exact figures stay below their ceilings."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.bench import embedded, robot, robot_calls
from tests.conftest import require_tool, require_zig
from tests.rigs.places import ROOT
from vsense.base.errors import UsageError
from vsense.robots import boards
from vsense.robots.build import SHIPPED_CONTROLLER
from vsense.robots.compiling import BuildError


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
    thoughts = [robot.policy_instructions(tmp_path) for _ in range(2)]
    print(f"instructions of policies: {thoughts[0]}")
    assert thoughts[0] == thoughts[1] and thoughts[0].keys() == robot.POLICIES.keys()
    # 1,184 weights at the least, each a product and a sum in software.
    assert all(1_184 * 40 < n <= robot.POLICIES[name] for name, n in thoughts[0].items())


def test_a_control_step_makes_so_many_system_calls_at_most(tmp_path: Path) -> None:
    qemu = require_tool("qemu-arm", "qemu-user")
    require_zig()
    program = tmp_path / "vsensed"
    size = boards.build(SHIPPED_CONTROLLER, "epuck", program).size
    assert size <= robot.SIZE_MAX
    counts: list[int] = []
    # Bytes that come late, one by one, on a busy machine cost a call each.
    while len(counts) < 10 and min(counts, default=robot.CALLS_MAX + 1) > robot.CALLS_MAX:
        counts.append(robot_calls.per_step(qemu, program, 40))
    print(f"{size} bytes, {counts} system calls of a control step")
    assert 20 < min(counts) <= robot.CALLS_MAX


def test_a_daemon_that_does_not_run_is_told(tmp_path: Path) -> None:
    program = tmp_path / "vsensed"
    program.write_text("no program")
    program.chmod(0o755)
    with pytest.raises(BuildError, match="makes no control step"):
        robot_calls.per_step(require_tool("qemu-arm", "qemu-user"), program, 1)


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
        "shown_byte": None,
        "policies": {},
        "step_calls": None,
        "calls_max": robot.CALLS_MAX,
        "memory_kb": None,
        "missing": ["everything"],
    }
    text = robot.table(report)
    assert text.count("not built") == len(boards.TARGETS)
    assert "not counted" in text and text.endswith("not measured: everything")
    report |= {"sizes": {"epuck": 96_800}, "step_instructions": 11_199, "memory_kb": 204}
    report |= {"step_calls": 40, "shown_byte": 17.5, "policies": {"GRU of 8-16-2 numbers": 200_000}}
    text = robot.table(report)
    assert "epuck    96,800 bytes of 100,000 allowed" in text
    assert "11,199 of 12,000 allowed" in text and "204 kB" in text
    assert "a GRU of 8-16-2 numbers: 200,000 of " in text
    assert "a perceptron of 16-32-32-2 numbers: not counted" in text
    assert "every byte that a controller shows in every step: 17.5 instructions" in text
    assert "system calls of a control step at 10 Hz, all processes: 40 of 42 allowed" in text


def test_a_microcontroller_has_room_for_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    require_tool(embedded.COMPILER, embedded.PACKAGES)
    report = embedded.run(lambda text: None)
    print(embedded.table(report))
    small, *_, large = report["rooms"]
    assert 4_000 < small["flash"] <= embedded.FLASH_MAX
    assert 1_000 < small["ram"] <= embedded.RAM_MAX < large["ram"]
    assert 0 < small["stack"] < large["stack"]
    page = (ROOT / "c_src" / "MICROCONTROLLERS.md").read_text()
    for row in report["rooms"][:-1]:
        words = [row["entries"], row["params"], row["datagram"]]
        figures = [f"{row[name]:,}" for name in ("flash", "ram", "stack")]
        assert f"| {' | '.join([*map(str, words), *figures])} |" in page
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(UsageError, match=embedded.PACKAGES):
        embedded.run(lambda text: None)
