"""runs.csv: what is written is read again, and what people write wrongly is named."""

from __future__ import annotations

import csv
import errno
from pathlib import Path
from typing import Any

import pytest

from tests.run.stage import experiment
from vsense.base.errors import UsageError, VsenseError
from vsense.run import runs_csv
from vsense.run.runs_csv import (
    COLUMNS,
    OPTIONAL,
    RUNS,
    RunRow,
    RunRows,
    RunsFile,
    condition_of,
    read_runs,
)
from vsense.run.verdict import RunRecord, VoidCriteria, judged

FULL = RunRow(
    run="3", series="plan", mode="run", experiment="foraging", condition='a, "b"', block="1",
    repetition="2", start="s1", seed=7, began="2026-11-24T10:00:00Z", duration_s=120.5, robots=2,
    tags=(3, 700), uids=("ab", "cd"), batteries_v=(3.9, 4.05), light_level=81.5, late=0.25,
    versions=("vsense=1", "numpy=2"), verdict="void", why="touched by hand", note="line\nof two",
    measures={"items_home": 12.0, "gone": None},
)  # fmt: skip


def test_a_row_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "new" / RUNS
    bare = RunRow(run="1", mode="sim", experiment="x", condition="c", measures={"other": 1 / 3})
    for row in (FULL, bare):
        RunsFile(path).append(row)
    assert path.read_text().startswith("run,series,mode,experiment,condition,block,repetition,")
    first, second = read_runs(path)
    assert first == FULL or first.measures == {"items_home": 12.0, "gone": None, "other": None}
    assert second.measures == {"items_home": None, "gone": None, "other": 0.333333333333}
    assert (second.seed, second.tags, second.valid, first.valid) == (None, (), True, False)
    with path.open(newline="") as file:
        cells = next(csv.DictReader(file))
    assert (cells["tags"], cells["batteries_v"], cells["late"]) == ("3 700", "3.9 4.05", "0.25")


def test_the_columns_are_those_that_were_agreed(tmp_path: Path) -> None:
    assert " ".join(COLUMNS) == (
        "run series mode experiment condition block repetition start seed began duration_s robots"
        " tags uids batteries_v light_level late versions verdict why note"
    )


def test_what_links_did_has_columns_where_there_were_links(tmp_path: Path) -> None:
    path = tmp_path / RUNS
    RunsFile(path).append(plain("1", measures={"x": 4.0}))
    before = path.read_text()
    assert not any(name in before for name in OPTIONAL)
    RunsFile(path).append(plain("2", longest_silence_s=0.31, signal_dbm=-84, power_saving=[3, 70]))
    RunsFile(path).append(plain("3", measures={"signal_dbm": 5.0}))
    assert path.read_text().startswith(f"{','.join([*COLUMNS, 'x', *OPTIONAL])},measure_signal_dbm")
    first, second, third = read_runs(path)
    assert (first.measures["x"], first.signal_dbm, first.power_saving) == (4.0, None, ())
    assert (second.longest_silence_s, second.signal_dbm) == (0.31, -84)
    assert second.power_saving == (3, 70)
    assert (third.signal_dbm, third.measures["measure_signal_dbm"]) == (None, 5.0)


def test_a_spreadsheets_order_and_marks_do_not_matter(tmp_path: Path) -> None:
    """Other columns first, a byte order mark, carriage returns, spaces."""
    path = tmp_path / RUNS
    names = ["score", *reversed(COLUMNS)]
    cells = {"score": " 4 ", "run": "1", "mode": "lab", "verdict": "valid", "condition": " a "}
    lines = [",".join(names), ",".join(cells.get(name, "") for name in names)]
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join([*lines, ""]).encode())
    (row,) = read_runs(path)
    assert (row.measures, row.condition, row.seed) == ({"score": 4.0}, "a", None)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"verdict": "ok"}, "2: verdict is 'ok', expected valid or void"),
        ({"mode": "real"}, "2: mode is 'real', expected sim, lab, run"),
        ({"seed": "1.5"}, "2: seed is '1.5', expected a whole number"),
        ({"late": "1 %"}, "2: late is '1 %', expected a number"),
        ({"tags": "3 x"}, "2: tags is 'x', expected a whole number"),
        ({"score": "many"}, "2: score is 'many', expected a number"),
    ],
)
def test_a_wrong_value_is_named_with_its_line(
    tmp_path: Path, change: dict[str, str], words: str
) -> None:
    cells = {"score": "4", "mode": "lab", "verdict": "valid", **change}
    names = [*COLUMNS, "score"]
    path = tmp_path / RUNS
    path.write_text(f"{','.join(names)}\n{','.join(cells.get(name, '') for name in names)}\n")
    with pytest.raises(UsageError, match=f"runs.csv:{words}"):
        read_runs(path)


def test_a_full_disk_costs_no_row_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A new measure makes the file anew: it takes the place of the old one when it is whole."""
    path = tmp_path / RUNS
    table = RunsFile(path)
    table.append(FULL)
    before = path.read_bytes()

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(runs_csv.os, "fsync", full)
    row = RunRow(run="4", mode="lab", experiment="x", condition="c", measures={"new": 1.0})
    with pytest.raises(VsenseError, match="No space left"):
        table.append(row)
    assert path.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == [RUNS]
    assert table.rows == [FULL]


def plain(run: str, **others: Any) -> RunRow:
    return RunRow(run=run, mode="lab", experiment="x", condition="c", **others)


def test_measures_that_are_called_like_columns_get_their_own(tmp_path: Path) -> None:
    table = RunsFile(tmp_path / RUNS)
    measures = {"late": 4.0, "measure_late": 5.0, "": 6.0, "items": 7.0}
    table.append(plain("1", late=0.5, measures=measures))
    table.append(plain("2", late=0.5, measures=measures))
    first, second = read_runs(tmp_path / RUNS)
    assert first.late == 0.5 and first.measures == second.measures
    assert first.measures == {
        "measure_measure_late": 4.0, "measure_late": 5.0, "measure_": 6.0, "items": 7.0
    }  # fmt: skip


def test_what_people_change_between_two_runs_stays(tmp_path: Path) -> None:
    """A column moved, a run made void, a note: the next row finds its columns nevertheless."""
    path = tmp_path / RUNS
    table = RunsFile(path)
    table.append(plain("1", measures={"items": 1.0}))
    with open(path, newline="") as file:
        (cells,) = csv.DictReader(file)
    cells = {**dict(reversed(list(cells.items()))), "verdict": "void", "note": "it fell"}
    path.write_text(f"{','.join(cells)}\n{','.join(cells.values())}\n")
    table.append(plain("2", measures={"items": 2.0}))
    told = [(row.run, row.verdict, row.note, row.measures["items"]) for row in read_runs(path)]
    assert told == [("1", "void", "it fell", 1.0), ("2", "valid", "", 2.0)]
    path.unlink()
    table.append(plain("3", measures={"items": 3.0}))
    assert [row.run for row in read_runs(path)] == ["1", "2", "3"]


def test_half_a_row_is_no_run_and_what_is_no_table_is_not_cut(tmp_path: Path) -> None:
    path = tmp_path / RUNS
    RunsFile(path).append(plain("1", measures={"items": 1.0}))
    whole = path.read_text()
    path.write_text(f"{whole}2,series,la")
    assert [row.run for row in read_runs(path)] == ["1"]
    assert path.read_text() == f"{whole}2,series,la", "who only reads changes nothing"
    table = RunsFile(path)
    assert table.repaired and path.read_text() == whole
    path.write_text(f"{whole}2,series,la\n")
    with pytest.raises(UsageError, match=r"runs\.csv:3: 3 values.*22"):
        read_runs(path)
    for text in ("somebody's notes", "a,b\n1,2"):
        path.write_text(text)
        with pytest.raises(UsageError, match=r"is no runs\.csv"):
            RunsFile(path)
        assert path.read_text() == text


def test_an_argument_that_is_no_text_costs_no_row(tmp_path: Path) -> None:
    RunsFile(tmp_path / RUNS).append(plain("1", note="a\udcffb"))
    assert read_runs(tmp_path / RUNS)[0].note == "a\\udcffb"


def summary(run: int, **others: Any) -> dict[str, Any]:
    return {
        "experiment": "foraging", "run": run, "seed": 4 + run, "blind": False, "robots": 2,
        "timesteps": 95, "left_out_timesteps": 5, "late_timesteps": 8, "duration_s": 10.0,
        "results": {"items_home": 3.0}, **others,
    }  # fmt: skip


def test_runs_of_lab_and_run_become_rows(tmp_path: Path) -> None:
    rows = RunRows(tmp_path, "run", {"sensor.noise": "0.2"})
    names = [robot.id for robot in experiment().robots]
    parts = [{"name": name, "uid": f"uid{n}"} for n, name in enumerate(names)]
    rests = {"resting": names[:1], "parts": parts}
    for number, (ended, more) in enumerate(
        [
            ("time", {"per_robot": [{"battery_mv": 3900}, {"battery_mv": None}]}),
            ("stopped by keyboard", {"blind": True, "parts": [{"uid": None}, {"uid": "ab12"}]}),
            ("", {"swarm": {"in_cone_before_turn": 4, "lit_after_turn": None}, **rests}),
        ],
        start=1,
    ):
        rows.begin(number)
        known = judged(summary(number, **more), RunRecord(ended=ended), VoidCriteria())
        assert rows.add(known, experiment()) == ""
    first, second, third = read_runs(tmp_path / RUNS)
    assert (first.run, first.series, first.mode) == ("run-1", tmp_path.name, "run")
    assert (first.condition, first.batteries_v, first.late) == ("sensor.noise=0.2", (3.9,), 0.08)
    assert (second.condition, second.verdict) == ("blind, sensor.noise=0.2", "void")
    assert second.why == "stopped by keyboard before its end"
    tags = tuple(robot.tag for robot in experiment().robots)
    assert (first.robots, first.tags, third.robots, third.tags) == (2, tags, 1, tags[1:])
    assert third.uids == ("uid1",), "who rests is none of the run's"
    # In the order of tags, also where one was never there; and nothing where nobody is known.
    assert (first.uids, second.uids) == ((), ("-", "ab12"))
    assert third.measures == {"in_cone_before_turn": 4.0, "items_home": 3.0}
    assert third.why == "failed before its end"
    endless = RunRows(tmp_path / "b", "lab", {})
    endless.begin(1)
    stopped = RunRecord(ended="stopped by keyboard", endless=True, changes=1)
    known = judged(summary(1), stopped, VoidCriteria())
    assert endless.add(known, experiment(timesteps=0)) == ""
    (row,) = read_runs(tmp_path / "b" / RUNS)
    assert row.valid and row.note == "its world was changed once by hand"
    (tmp_path / "b" / RUNS).unlink()
    (tmp_path / "b").rmdir()
    (tmp_path / "b").write_text("")
    assert "the table of runs lacks run 1: " in endless.add(known, experiment())


def test_conditions_have_the_words_of_reports() -> None:
    assert condition_of(False, {}) == "sighted" and condition_of(True, {}) == "blind"
