"""`vsense robot status --roster`: all robots of the roster, with a run and without."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

import pytest

from vsense import cli
from vsense.commands.robot_list import boards_now, run_now, table
from vsense.config import battery_history, roster
from vsense.config.battery_history import BatteryRow, minutes_left
from vsense.monitor.recording.form import ROBOT_COLUMNS
from vsense.robots import boards

ROSTER = """
[[robot]]
tag = 23
host = "root@10.0.0.23"
battery_stop_mv = 3500
[robot.calibration]
wheel_diameter_mm = 40.8
when = "2026-11-23"
[[robot]]
tag = 37
host = "root@10.0.0.37"
spare = true
[[robot]]
tag = 40
out_of_order = "left motor stalls"
"""
HISTORY = [
    BatteryRow("2026-11-24T09:00:00+00:00", 23, "", 4.0, 3.9, 600.0),
    BatteryRow("2026-11-24T09:30:00+00:00", 23, "", 3.9, 3.7, 600.0),
    BatteryRow("2026-11-24T10:00:00+00:00", 23, "", 3.7, 3.6, 600.0),
]


@pytest.fixture
def known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "robots.toml"
    path.write_text(ROSTER)
    battery_history.append(battery_history.history_of(path), HISTORY)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return path


def row(**others: object) -> dict[str, object]:
    """A robot of /robots."""
    usual = {"connected": True, "heard_ms": 12.3, "seen": True, "sessions": 1, "trouble": ""}
    return dict.fromkeys(ROBOT_COLUMNS) | usual | others


def columns(*rows: dict[str, object]) -> dict[str, list[object]]:
    return {name: [one[name] for one in rows] for name in ROBOT_COLUMNS}


def test_a_run_tells_who_plays_what_and_how_long_batteries_last(known: Path) -> None:
    now = run_now(
        columns(
            row(tag=37, name="ant_23", battery_mv=3900, connected=False, trouble="not connected"),
            row(tag=23, name="ant_24", battery_mv=3800, seen=False, trouble="never seen"),
        )
    )
    assert (now[37].part, now[37].text, now[37].trouble) == ("ant_23", "link lost", "")
    assert (now[23].text, now[23].trouble) == ("link 12 ms, not seen", "never seen")
    rows = [line.split() for line in table(roster.read(known), HISTORY, now).splitlines()]
    # From 3.8 V to its 3.5 V by the median fall of 0.1 V in ten minutes.
    assert rows[1][:9] == [*["23", "-", "ant_24", "link", "12", "ms,", "not", "seen", "3.80"]]
    assert rows[1][9:12] == ["V", "30", "min"] and rows[1][-2:] == ["never", "seen"]
    assert "2026-11-23" in rows[1] and rows[2][-1] == "spare" and "lost" in rows[2]
    assert rows[3][:5] == ["40", "-", "-", "-", "-"] and rows[3][-3:] == ["left", "motor", "stalls"]


def test_minutes_are_of_runs_that_tell() -> None:
    short = BatteryRow("", 23, "", 4.0, 3.0, 5.0)
    charged = BatteryRow("", 23, "", 3.6, 4.1, 600.0)
    untold = BatteryRow("", 23, "", 4.0, None, 600.0)
    assert minutes_left([short, charged, untold], 23, 3.8, 3.4) is None
    assert minutes_left([*HISTORY, short, charged, untold], 23, 3.8, 3.4) == pytest.approx(40.0)
    assert minutes_left(HISTORY, 23, 3.3, 3.4) == 0.0
    assert minutes_left(HISTORY, 24, 3.8, 3.4) is None


def test_without_a_run_boards_are_asked(known: Path) -> None:
    def call(command: Sequence[str]) -> tuple[int, str]:
        assert command[0] == "ssh" and "BatchMode=yes" in command
        return (0, "runs\n") if "root@10.0.0.23" in command else (255, "Permission denied (x)")

    now = boards_now(roster.read(known), call)
    assert now.keys() == {23, 37}
    assert now[23].text == "on, vsensed runs" and now[37].text == "no answer"
    assert "ssh-copy-id root@10.0.0.37" in now[37].trouble


def test_the_command_asks_with_ssh_and_tells_programs(
    known: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    programs = known.parent / "bin"
    programs.mkdir()
    (programs / "ssh").write_text("#!/bin/sh\necho stands\n")
    (programs / "ssh").chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    assert cli.main(["robot", "status", "--roster", str(known), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [one["now"]["text"] for one in told] == ["on, no vsensed", "on, no vsensed", "-"]
    assert told[0]["battery"]["end_v"] == 3.6 and told[2]["out_of_order"] == "left motor stalls"
    # Whom nobody answers for costs a line, not the table.
    (programs / "ssh").write_text("#!/bin/sh\nexec sleep 60\n")
    monkeypatch.setattr(boards, "ASK_S", 0.2)
    assert cli.main(["robot", "status", "--roster", str(known)]) == 0
    assert capsys.readouterr().out.count("no answer") == 2
    assert cli.main(["robot", "status", "--roster", str(known), "--process", "1"]) == 2
    assert "process 1 runs no experiment" in capsys.readouterr().err
