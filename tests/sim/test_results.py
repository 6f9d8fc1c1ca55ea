"""A campaign's file: no row lost, no row twice, and never two campaigns in one."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.errors import UsageError, VsenseError
from vsense.sim.results import CampaignResults

KEYS = ("sensor.noise", "light.position")
MEASURES = {"in_cone": 3.0, "left": 0.1}


def add(results: CampaignResults, seed: int, noise: str = "0", **measures: float | None) -> None:
    fixed = {
        "experiment": "it",
        "sensor.noise": noise,
        "light.position": "0,0,1",
        "seed": seed,
        "robots": 15,
        "duration_s": "120",
    }
    results.append(fixed, {**MEASURES, **measures})


def start(path: Path, campaign: str = "cafe0001") -> CampaignResults:
    return CampaignResults(path, campaign, KEYS)


def test_rows_are_found_again(tmp_path: Path) -> None:
    path = tmp_path / "new" / "r.csv"
    first = start(path)
    assert first.rows == [] and first.measures == []
    add(first, 1)
    add(first, 2, left=1 / 3)
    again = start(path)
    assert again.rows == first.rows
    assert again.measures == ["in_cone", "left"]
    assert again.keys() == {("0", "0,0,1", "1"), ("0", "0,0,1", "2")}
    add(again, 3)
    assert path.read_text().splitlines() == [
        "campaign,experiment,sensor.noise,light.position,seed,robots,duration_s,in_cone,left",
        'cafe0001,it,0,"0,0,1",1,15,120,3,0.1',
        'cafe0001,it,0,"0,0,1",2,15,120,3,0.333333333333',
        'cafe0001,it,0,"0,0,1",3,15,120,3,0.1',
    ]


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
    results = start(tmp_path / "r.csv")
    add(results, 1, left=None)
    assert results.rows[0]["left"] == ""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", r"r\.csv:1: the columns a,b are another campaign's"),
        ("\xff", "no CSV file"),
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
    path.write_text(path.read_text().replace('cafe0001,it,0,"0,0,1",2', 'beef,it,0,"0,0,1",2'))
    with pytest.raises(UsageError, match=r"r\.csv:3: a row of campaign beef, this is cafe0001"):
        start(path)
    path.write_text(path.read_text().replace("beef", "cafe0001").replace(",15,120", ",15", 1))
    with pytest.raises(UsageError, match=r"r\.csv:2: 8 values, expected 9"):
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
