"""The batteries' history: begun at a run's first voltage, a row per robot, and only ever longer."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.robots import rosters
from vsense import cli
from vsense.base.errors import VsenseError
from vsense.config import battery_history
from vsense.run.robots import RunBatteries


def robots(**millivolts: int) -> Any:
    """Robots 23, 24, ...: what each tells, -1: it is not connected."""
    return {
        int(name[1:]): SimpleNamespace(
            connected=mv >= 0, telemetry=SimpleNamespace(battery_mv=mv), uid=bytes(15) + b"\x01"
        )
        for name, mv in millivolts.items()
    }


def test_a_run_leaves_a_row_for_each_robot_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = rosters.write(tmp_path, "a tag=23\nb tag=24\nc tag=25\n")
    batteries = RunBatteries(str(path), 0.1)
    batteries.update(0, robots(t23=0, t24=0, t25=-1))
    batteries.update(1, robots(t23=4100, t24=0, t25=-1))
    batteries.update(599, robots(t23=3925, t24=0, t25=-1))
    history = tmp_path / "robots.battery.csv"
    assert batteries.end() == history and batteries.end() is None
    rows = battery_history.read(history)
    assert [(row.tag, row.begin_v, row.end_v, row.duration_s) for row in rows] == [
        (23, 4.1, 3.925, 60.0),
        (24, None, None, 60.0),
    ]
    assert rows[0].uid == "0" * 30 + "01"
    before = history.read_text()
    batteries.update(0, robots(t23=3900))
    batteries.end()
    assert history.read_text().startswith(before)
    assert battery_history.last(battery_history.read(history))[23].end_v == 3.9
    monkeypatch.chdir(tmp_path)
    assert cli.main(["robot", "list"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert "3.90 V" in said[1] and said[-1] == "3 of 3 robots can be taken"


def test_rows_that_a_full_disk_has_cut_cost_no_others(tmp_path: Path) -> None:
    history = tmp_path / "robots.battery.csv"
    history.write_text("time,tag,uid,begin_v,end_v,duration_s\n2026-11-24T00:00:00+00:00,23,,4.1")
    batteries = RunBatteries(str(tmp_path / "robots.toml"), 0.1)
    batteries.update(0, robots(t24=4000))
    batteries.end()
    assert [row.tag for row in battery_history.read(history)] == [24]


def test_no_roster_and_a_history_that_cannot_be_written(tmp_path: Path) -> None:
    batteries = RunBatteries("", 0.1)
    batteries.update(0, robots(t23=4000))
    assert batteries.end() is None
    (tmp_path / "robots.battery.csv").mkdir()
    batteries = RunBatteries(str(tmp_path / "robots.toml"), 0.1)
    batteries.update(0, robots(t23=4000))
    with pytest.raises(VsenseError, match=r"robots.battery.csv: cannot be written: Is a directory"):
        batteries.end()
