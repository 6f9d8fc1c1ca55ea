"""A campaign's file: no row lost, no row twice, and never two campaigns in one."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import UsageError, VsenseError
from vsense.config.placement import StartPlaces
from vsense.modes.sim.job import Job, Setup
from vsense.modes.sim.outcome import Task
from vsense.run.runs_csv import COLUMNS, RunRow, RunsFile
from vsense.run.verdict import VoidCriteria
from vsense.studies.series import campaign
from vsense.studies.series._folder import CampaignTable
from vsense.studies.series._order import CAMPAIGN, PlannedRun, cells, pending
from vsense.studies.series._plan import Condition, PlannedStart, SeriesPlan
from vsense.studies.series._simulated import outcome

HEAD = ",".join(COLUMNS)
MEASURES = {"in_cone": 3.0, "left": 0.1}
CONDITION = "sensor.noise=0, light.position=0,0,1"
SETTINGS = {"sensor.noise": "0", "light.position": "0,0,1"}
PLAN = SeriesPlan(
    path=Path("it.argos"),
    name="cafe0001",
    mode="sim",
    conditions=(Condition("blind", "it", blind=True), Condition(CONDITION, "it", "", SETTINGS)),
    starts=tuple(PlannedStart(f"seed{n}", StartPlaces(n)) for n in (3, 1)),
    seed=CAMPAIGN,
)


def add(table: CampaignTable, seed: int, **measures: float | None) -> None:
    row = RunRow(
        run=f"{CONDITION}, seed {seed}",
        series=PLAN.name,
        mode="sim",
        experiment="it",
        condition=CONDITION,
        start=f"seed{seed}",
        seed=seed,
        versions=("faulty=1",),
        measures={**MEASURES, **measures},
    )
    table.append(row)


def start(path: Path) -> CampaignTable:
    return CampaignTable(RunsFile(path), PLAN)


def test_its_plan_has_every_condition_at_every_seed_in_order() -> None:
    found = [(cell.condition, cell.start, cell.seed) for cell in cells(PLAN)]
    assert found == [(c, f"seed{n}", n) for c in ("blind", CONDITION) for n in (3, 1)]
    assert [run.name for run in pending(PLAN, [])][:2] == ["blind, seed 3", "blind, seed 1"]


def test_rows_of_other_settings_and_seeds_stay_and_void_ones_are_made_again(
    tmp_path: Path,
) -> None:
    table = start(tmp_path / "r.csv")
    for seed in (1, 2):
        add(table, seed)
    missing = [run.name for run in pending(PLAN, table.rows)]
    assert missing == ["blind, seed 3", "blind, seed 1", f"{CONDITION}, seed 3"]
    void = [replace(table.rows[0], verdict="void", why="the light was off")]
    assert pending(PLAN, void)[-1].name == f"{CONDITION}, seed 1, attempt 2"


def test_recordings_lie_beside_the_table(tmp_path: Path) -> None:
    table = start(tmp_path / "r.csv")
    folder, runs = tmp_path / "r-recordings", pending(PLAN, [])
    assert table.recording(runs[0], "it") == folder / "seed3.mcap"
    settings = "sensor.noise=0,light.position=0,0,1"
    assert table.recording(runs[2], "it") == folder / f"02-{settings}-seed3.mcap"
    again = PlannedRun(runs[0].cell, 2)
    assert table.recording(again, "it") == folder / "attempt2-seed3.mcap"


def test_rows_are_found_again(tmp_path: Path) -> None:
    path = tmp_path / "new" / "r.csv"
    first = start(path)
    assert first.rows == []
    add(first, 1)
    add(first, 2, left=0.333333333333)
    again = start(path)
    assert again.rows == first.rows
    add(again, 3)
    with path.open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert [(line["condition"], line["start"]) for line in lines] == [
        (CONDITION, f"seed{seed}") for seed in (1, 2, 3)
    ]
    assert not any("faulty" in line["versions"] for line in lines), "its name tells programs"
    assert path.read_text().splitlines()[0] == f"{HEAD},in_cone,left"
    assert [line["left"] for line in lines] == ["0.1", "0.333333333333", "0.1"]
    assert {line["verdict"] for line in lines} == {"valid"}


def test_measures_of_a_run_are_those_that_are_read_again() -> None:
    experiment = SimpleNamespace(sources=(), robots=())
    task = Task(Job(Setup("it"), 1, {}), experiment)  # type: ignore[arg-type]
    result = {"name": "it", "timesteps": 3, "timestep_s": 0.1, "swarm": {"lit": 1.0}}
    result |= {"complete": True, "changes": 0, "complaints": ["mine asks for x"], "failed": []}
    result |= {"measures": {"left": 1 / 3, "gone": None}}
    row = outcome(task, result, VoidCriteria()).row
    assert (row.valid, row.note) == (True, "mine asks for x")
    assert row.measures == {"left": 0.333333333333, "gone": None}


@given(st.data())
def test_a_file_cut_anywhere_keeps_its_whole_rows(tmp_path_factory, data) -> None:
    path = tmp_path_factory.mktemp("cut") / "r.csv"
    whole = start(path)
    for seed in range(3):
        add(whole, seed)
    text = path.read_bytes()
    cut = data.draw(st.integers(0, len(text)))
    path.write_bytes(text[:cut])
    found = start(path)
    lines = text[:cut].count(b"\n")
    assert len(found.rows) == max(lines - 1, 0)
    assert found.table.repaired == (not text[:cut].endswith(b"\n") and cut > 0)
    for seed in range(len(found.rows), 3):
        add(found, seed)
    assert path.read_bytes() == text


def test_a_measure_that_a_run_did_not_have_stays_empty(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    table = start(path)
    add(table, 1, left=None)
    assert table.rows[0].measures["left"] is None
    assert path.read_text().endswith(",\n")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", r"r\.csv:1:.*runs.csv:.*columns"),
        ("a;b\n", "commas"),
        ("campaign,experiment,seed\n", "before runs.csv"),
        ("run,mode,verdict\n", r"r\.csv:1:.*series, experiment, condition"),
        (f"{HEAD},x,x\n", "two of the same name"),
        ("\xff", "UTF-8"),
    ],
)
def test_another_file_is_left_alone(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "r.csv"
    path.write_bytes(text.encode("latin-1") + (b"\n" if text == "\xff" else b""))
    before = path.read_bytes()
    with pytest.raises(UsageError, match=words):
        start(path)
    assert path.read_bytes() == before


def test_another_campaigns_rows_are_refused_with_their_line(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    table = start(path)
    add(table, 1)
    add(table, 2)
    one, two, three = path.read_text().splitlines(keepends=True)
    path.write_text(one + two + three.replace("cafe0001", "beef"))
    with pytest.raises(UsageError, match=r"r\.csv:3:.*cafe0001"):
        start(path)
    path.write_text(one + two.replace(",valid,", ",") + three)
    with pytest.raises(UsageError, match=r"r\.csv:2: 22 values.*23"):
        start(path)


def test_rows_of_vsense_0_1_beside_which_nothing_is_kept_are_no_campaigns(tmp_path: Path) -> None:
    rows = [SimpleNamespace(series="0123456789abcdef")]
    table: Any = SimpleNamespace(path=tmp_path / "r.csv", rows=rows)
    nothing: Any = None
    assert campaign._name_before(nothing, {}, table) == ""


def test_runs_with_other_measures_do_not_fit(tmp_path: Path) -> None:
    table = start(tmp_path / "r.csv")
    add(table, 1)
    with pytest.raises(VsenseError, match=r"seed 2 .*in_cone, left, more"):
        add(table, 2, more=1.0)


def test_a_file_that_cannot_be_had_is_one_clear_line(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    table = start(folder / "r.csv")
    folder.write_text("")
    with pytest.raises(VsenseError, match=r"r\.csv: cannot be written: "):
        add(table, 1)
    with pytest.raises(VsenseError, match="Is a directory"):
        start(tmp_path)
