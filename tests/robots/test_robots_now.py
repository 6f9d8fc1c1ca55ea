"""`vsense robot status --roster`: all robots of the roster, with a run and without."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.conftest import require_tool
from vsense import cli
from vsense.commands.orders import robot_table
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


def test_numbers_of_a_boards_system_become_words() -> None:
    words = "Permission denied; No such file or directory; errnos 5"
    assert boards.in_words("errno 13; errno 2; errnos 5") == words


def test_without_a_run_boards_are_asked(known: Path) -> None:
    def call(command: Sequence[str]) -> tuple[int, str]:
        assert command[0] == "ssh" and "BatchMode=yes" in command
        said = "vsensed 0.1.0, controller foraging a1b2c3d4\nruns\n"
        return (0, said) if "root@10.0.0.23" in command else (255, "Permission denied (x)")

    now = boards_now(roster.read(known), call)
    assert now.keys() == {23, 37}
    assert now[23].text == "on, vsensed runs" and now[37].text == "no answer"
    assert "ssh-copy-id root@10.0.0.37" in now[37].trouble
    assert now[23].data == {"version": "0.1.0", "controller": "foraging", "hash": "a1b2c3d4"}
    assert "mixed" not in table(roster.read(known), HISTORY, now)


def test_a_board_is_asked_what_its_daemon_says_of_itself(known: Path, tmp_path: Path) -> None:
    """The words that ssh takes, by a shell: beside a process that is called vsensed."""
    daemon = tmp_path / "vsensed"
    source = tmp_path / "daemon.c"
    source.write_text(
        "#include <stdio.h>\n#include <unistd.h>\n"
        'int main(int n, char **a) { (void)a; if (n > 1) puts("vsensed 9, controller c ff");'
        " else pause(); return 0; }\n"
    )
    require_tool("cc", "build-essential")
    subprocess.run(["cc", "-o", str(daemon), str(source)], check=True)
    process = subprocess.Popen([str(daemon)])
    (tmp_path / "pidof").write_text(f"#!/bin/sh\necho {process.pid} 1\n")
    (tmp_path / "pidof").chmod(0o755)
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}

    def call(command: Sequence[str]) -> tuple[int, str]:
        done = subprocess.run(
            ["sh", "-c", command[-1]], capture_output=True, text=True, env=environment, check=False
        )
        return done.returncode, done.stdout

    try:
        now = boards_now(roster.read(known), call)
    finally:
        process.kill()
        process.wait()
    assert now[23].text == "on, vsensed runs"
    assert now[23].data == {"version": "9", "controller": "c", "hash": "ff"}


def test_mixed_daemons_are_named(known: Path) -> None:
    usual = {"version": "0.1.0", "controller": "foraging", "hash": "a1"}
    robots = (
        row(tag=37, name="ant_37", **usual), row(tag=23, name="ant_23", **usual | {"hash": "b2"}),
        row(tag=40, name="ant_40", **usual | {"version": "0.2.0", "controller": "prey"}),
    )  # fmt: skip
    said = table(roster.read(known), HISTORY, run_now(columns(*robots))).splitlines()[-2:]
    assert [line.partition(":")[0] for line in said] == ["mixed daemons", "mixed daemons"]
    assert "vsensed 0.1.0 on " in said[0] and "; 0.2.0 on " in said[0]
    assert "foraging a1 on " in said[1] or "foraging b2 on " in said[1]
    assert "vsense robot deploy" in said[0]
    rows = columns(*robots) | {"expected": ["foraging"] * 3, "authenticated": [True] * 3}
    (versions, sources) = robot_table(rows).splitlines()[-2:]
    assert versions.startswith("mixed daemons: vsensed 0.1.0 on ant_37, ant_23; 0.2.0 on ant_40:")
    assert sources.startswith("mixed daemons: foraging a1 on ant_37; b2 on ant_23:")
    same = columns(*(row(tag=n, name=f"r{n}", **usual) for n in (1, 2)))
    same |= {"expected": ["foraging"] * 2, "authenticated": [True] * 2}
    assert "mixed" not in robot_table(same)


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
