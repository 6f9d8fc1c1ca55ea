"""A campaign's file: no row lost, no row twice, and never two campaigns in one."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import UsageError, VsenseError
from vsense.modes.sim.job import Setup
from vsense.modes.sim.results import CampaignResults

MEASURES = {"in_cone": 3.0, "left": 0.1}
SETTINGS = {"sensor.noise": "0", "light.position": "0,0,1"}
HEAD = (
    "run,series,mode,experiment,condition,block,repetition,start,seed,began,duration_s,robots,tags,"
    "uids,batteries_v,light_level,late,versions,verdict,why,note"
)


def add(results: CampaignResults, seed: int, **measures: float | None) -> None:
    result = {"name": "it", "duration_s": 120.0, "tags": [3, 700]}
    results.append(Setup("it", settings=SETTINGS), seed, result, {**MEASURES, **measures})


def start(path: Path, campaign: str = "cafe0001") -> CampaignResults:
    return CampaignResults(path, campaign)


def test_rows_are_found_again(tmp_path: Path) -> None:
    path = tmp_path / "new" / "r.csv"
    first = start(path)
    assert first.rows == [] and first.measures == []
    add(first, 1)
    add(first, 2, left=1 / 3)
    again = start(path)
    assert again.rows == first.rows
    assert again.measures == ["in_cone", "left"]
    condition = "sensor.noise=0, light.position=0,0,1"
    assert again.keys() == {(condition, 1), (condition, 2)}
    add(again, 3)
    with path.open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert [(line["condition"], line["start"], line["tags"]) for line in lines] == [
        (condition, f"seed{seed}", "3 700") for seed in (1, 2, 3)
    ]
    assert path.read_text().splitlines()[0] == f"{HEAD},in_cone,left"
    assert [line["left"] for line in lines] == ["0.1", "0.333333333333", "0.1"]
    assert {line["verdict"] for line in lines} == {"valid"}


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
    assert found.repaired == (not text[:cut].endswith(b"\n") and cut > 0)
    for seed in range(len(found.rows), 3):
        add(found, seed)
    assert path.read_bytes() == text


def test_a_measure_that_a_run_did_not_have_stays_empty(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    results = start(path)
    add(results, 1, left=None)
    assert results.rows[0].measures["left"] is None
    assert path.read_text().endswith(",\n")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", r"r\.csv:1: is no runs.csv: expected the columns run,series"),
        ("a;b\n", r"separated by commas"),
        ("campaign,experiment,seed\n", "the form before runs.csv: only report"),
        ("run,mode,verdict\n", r"r\.csv:1: lacks the columns series, experiment, condition"),
        (f"{HEAD},x,x\n", "two of the same name"),
        ("\xff", "no text in UTF-8"),
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
    results = start(path)
    add(results, 1)
    add(results, 2)
    one, two, three = path.read_text().splitlines(keepends=True)
    path.write_text(one + two + three.replace("cafe0001", "beef"))
    with pytest.raises(UsageError, match=r"r\.csv:3: a row of campaign beef, this is cafe0001"):
        start(path)
    path.write_text(one + two.replace(",valid,", ",") + three)
    with pytest.raises(UsageError, match=r"r\.csv:2: 22 values, expected 23"):
        start(path)


def test_runs_with_other_measures_do_not_fit(tmp_path: Path) -> None:
    results = start(tmp_path / "r.csv")
    add(results, 1)
    with pytest.raises(VsenseError, match=r"seed 2 gave the measures in_cone, left, more; .* have"):
        add(results, 2, more=1.0)


def test_a_file_that_cannot_be_had_is_one_clear_line(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    results = start(folder / "r.csv")
    folder.write_text("")
    with pytest.raises(VsenseError, match=r"r\.csv: cannot be written: "):
        add(results, 1)
    with pytest.raises(VsenseError, match="cannot be read: Is a directory"):
        start(tmp_path)
