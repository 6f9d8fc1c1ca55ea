"""What is written down while a run goes on."""

from __future__ import annotations

import csv
import errno
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from vsense.run.directory import FLUSH_TIMESTEPS, HEADER, DirectoryError, RunLog, RunTables


def add(tables: RunTables, number: int, counts: tuple[int, int, int], **measures: float) -> None:
    """A timestep of the run, at 1, 2, 3, 4 ns."""
    tables.add((number, 100 + number), (1, 2, 3, 4), counts, measures)


def test_timesteps_are_kept_as_they_happen(tmp_path: Path) -> None:
    tables = RunTables(tmp_path, 0.1)
    for number in range(FLUSH_TIMESTEPS):
        add(tables, number, (3, 2, 1))
    rows = (tmp_path / "timesteps.csv").read_text()
    assert rows.startswith(HEADER + "0,100,1,2,3,4,3,2,1\n"), "in reach before the end"
    assert len(rows.splitlines()) == 1 + FLUSH_TIMESTEPS
    add(tables, 99, (0, 0, 0))
    tables.close()
    assert (tmp_path / "timesteps.csv").read_text().endswith("\n99,199,1,2,3,4,0,0,0\n")


def test_words_are_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with RunLog(tmp_path) as log:
        log.say("all robots start")
    assert log._log.closed
    text = (tmp_path / "log.txt").read_text()
    assert re.fullmatch(r"\d\d:\d\d:\d\d\.\d{3} all robots start\n", text)
    assert capsys.readouterr().err == "all robots start\n"


def test_standard_error_that_is_a_file_is_written_by_a_thread_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (tmp_path / "nohup.out").open("w") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        with RunLog(tmp_path) as log:
            log.write_aside()
            log.say("told")
            log.progress("live")
        assert log._aside is not None
        log._aside.close()
    assert (tmp_path / "nohup.out").read_text().splitlines() == ["told", "live"]
    assert (tmp_path / "log.txt").read_text().endswith(" told\n")


def test_a_full_disk_is_told_once_and_costs_no_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Full:
        def write(self, text: str) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

    with RunLog(tmp_path) as log:
        log._log.close()
        monkeypatch.setattr(log, "_log", Full())
        for _ in range(3):
            log.say("something")
    said = capsys.readouterr().err
    assert said.count("something") == 3
    assert said.count("the run is no longer written down: No space left on device") == 1


def test_a_directory_that_is_gone_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(DirectoryError, match=r"log\.txt: No such file or directory"):
        RunLog(tmp_path / "gone")


def test_a_table_that_cannot_be_made_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(DirectoryError, match=r"timesteps\.csv: No such file or directory"):
        RunTables(tmp_path / "gone", 0.1)


def test_measures_have_a_row_for_every_timestep(tmp_path: Path) -> None:
    """Also those that the experiment begins to measure later: nobody has to know them before."""
    tables = RunTables(tmp_path, 0.25)
    add(tables, 0, (3, 3, 0))
    assert not (tmp_path / "measures.csv").exists(), "there are none yet"
    add(tables, 1, (3, 3, 0), home=1.0)
    add(tables, 2, (3, 3, 0), **{"home": 2.5, "lost, all": 1e-7})
    add(tables, 3, (3, 3, 0), **{"lost, all": 0.1 + 0.2})
    tables.close()
    rows = list(csv.DictReader((tmp_path / "measures.csv").open()))
    assert [list(row.values()) for row in rows] == [
        ["1", "0.25", "1", ""],
        ["2", "0.5", "2.5", "1e-07"],
        ["3", "0.75", "", "0.3"],
    ]
    assert list(rows[0]) == ["run_timestep", "time_s", "home", "lost, all"]


def test_tables_that_cannot_be_written_are_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full() -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    said: list[str] = []
    tables = RunTables(tmp_path, 0.1, said.append)
    monkeypatch.setattr(tables, "_flush", full)
    for number in range(2 * FLUSH_TIMESTEPS):
        add(tables, number, (3, 3, 0))
    tables.close()
    assert said == ["the run's tables are no longer written: No space left on device"]


def test_a_disk_that_fills_while_columns_are_added_keeps_the_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    tables = RunTables(tmp_path, 0.1, said.append)
    tables.add((0, 0), (), (), {"home": 1.0})
    opened = Path.open

    def full(path: Path, mode: str = "r", **how: Any) -> Any:
        file = opened(path, mode, **how)
        if "w" in mode:
            file.close()
            return opened(Path("/dev/full"), mode, **how)
        return file

    monkeypatch.setattr(Path, "open", full)
    tables.add((1, 1), (), (), {"home": 2.0, "lost": 3.0})
    monkeypatch.undo()
    tables.close()
    assert said == ["the run's tables are no longer written: No space left on device"]
    assert (tmp_path / "measures.csv").read_text() == "run_timestep,time_s,home\n0,0,1\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["measures.csv", "timesteps.csv"]
