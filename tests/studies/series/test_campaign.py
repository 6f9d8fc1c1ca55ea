"""Campaigns and single runs as a user starts them: files, exit codes, and going on after Ctrl-C."""

from __future__ import annotations

import csv
import json
import re
import signal
import statistics
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.rigs.places import ROOT
from tests.rigs.processes import descendants
from vsense.cli import main
from vsense.run.runs_csv import read_runs
from vsense.world.robot_models import MODELS_FOLDER

SHORT = ("--duration", "6")


def sim(*arguments: str | Path) -> int:
    return main(["sim", *map(str, arguments)])


def test_a_run_leaves_figures_and_trajectories(pollutant, tmp_path: Path, capsys) -> None:
    folder = tmp_path / "run"
    assert sim("pollutant", *SHORT, "--seed", "3", "--robots", "5", "--json", "-o", folder) == 0
    said = capsys.readouterr()
    summary = json.loads(said.out)
    assert summary == json.loads((folder / "summary.json").read_text())
    assert (summary["experiment"], summary["seed"], summary["robots"]) == ("pollutant", 3, 5)
    assert (summary["timesteps"], summary["duration_s"], summary["measures"]) == (60, 6.0, {})
    assert summary["speedup"] > 0
    assert set(summary["swarm"]) == {
        f"{what}_{when}_turn" for what in ("in_cone", "lit") for when in ("before", "after")
    }
    with np.load(folder / "trajectory.npz") as saved:
        assert saved["poses"].shape == (60, 5, 3)
    assert "5 robots in the cone before the wind turned" in said.err


def test_rows_do_not_depend_on_the_number_of_processes(pollutant, tmp_path: Path) -> None:
    one, two = tmp_path / "one.csv", tmp_path / "two.csv"
    for path, jobs in ((one, "1"), (two, "3")):
        arguments = ("--seeds", "3,1-2", "--set", "sensor.noise=0,0.7", "-j", jobs, "-o", path)
        assert sim("pollutant", *SHORT, *arguments) == 0
    assert one.read_bytes() == two.read_bytes()
    rows = read_runs(one)
    assert [(row.condition, row.seed) for row in rows] == [
        (f"sensor.noise={noise}", seed) for noise in ("0", "0.7") for seed in (3, 1, 2)
    ]
    assert {row.mode for row in rows} == {"sim"} and {row.duration_s for row in rows} == {6.0}
    image = cv2.imread(str(tmp_path / "one.png"))
    assert image is not None and image.shape[1] > 600


def test_what_a_run_warns_of_is_said_once_for_each_setting(
    pollutant, tmp_path: Path, capsys
) -> None:
    arguments = ("--runs", "2", "--set", "pollutant.warp=4,8", "-o", tmp_path / "r.csv")
    assert sim("pollutant", "--lenient", "--duration", "2", *arguments) == 0
    said = capsys.readouterr().err.splitlines()
    unread = "controller 'pollutant' does not know the parameter 'warp': ignored"
    for value in ("4", "8"):
        assert said.count(f"vsense: pollutant.warp={value}: {unread}") == 1


def test_the_suffix_of_the_output_says_what_the_picture_is(
    pollutant, tmp_path: Path, monkeypatch, capsys
) -> None:
    """One that says another thing than --format is refused, as is a bad style, before any run."""
    monkeypatch.chdir(tmp_path)
    campaign = ("pollutant", *SHORT, "--runs", "1", "-o")
    assert sim(*campaign, "r.svg", "--format", "pdf") == 2
    assert "--format pdf: --output r.svg says svg" in capsys.readouterr().err
    assert sim(*campaign, "r.svg", "--style", "none.mplstyle") == 2
    assert "--style none.mplstyle: expected" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    assert sim(*campaign, "r.svg") == 0
    assert (tmp_path / "r.csv").read_text().startswith("run,series,mode,experiment")
    assert ">pollutant: 1 run of each setting</text>" in (tmp_path / "r.svg").read_text()


def test_without_matplotlib_a_campaign_lacks_its_picture_only(
    pollutant, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    path = tmp_path / "r.csv"
    assert sim("pollutant", *SHORT, "--runs", "1", "--json", "-o", path) == 0
    said = capsys.readouterr()
    assert said.err.count("pip install 'matplotlib>=3.") == 1
    assert json.loads(said.out)["file"] == str(path)
    assert sorted(tmp_path.iterdir()) == [tmp_path / "r-made.zip", path]


def test_a_campaign_goes_on_where_it_stopped(pollutant, tmp_path: Path, capsys) -> None:
    path = tmp_path / "r.csv"
    arguments = ("pollutant", *SHORT, "--set", "pollutant.stop_probability=0.3,0.1", "-o", path)
    assert sim(*arguments, "--runs", "2") == 0
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:3]) + lines[3][:20])
    capsys.readouterr()
    assert sim(*arguments, "--runs", "2", "--json") == 0
    said = capsys.readouterr()
    assert path.read_bytes() == whole
    assert "its last row was cut short" in said.err
    assert "2 of 4 runs; it goes on from there" in said.err
    figures = json.loads(said.out)["settings"]
    assert [some["settings"] for some in figures] == [
        {"pollutant.stop_probability": value} for value in ("0.3", "0.1")
    ]
    assert all(some["measures"]["lit_after_turn"]["runs"] == 2 for some in figures)
    rows = [row for row in read_runs(path) if row.condition.endswith("0.1")]
    values = [row.measures["in_cone_after_turn"] for row in rows]
    spread = figures[1]["measures"]["in_cone_after_turn"]
    assert spread["median"] == statistics.median(values) and spread["quartiles"][0] >= min(values)
    lines = [re.split("  +", line) for line in said.err.splitlines()]
    assert ["setting", "measure", "runs", "median", "quartiles"] in lines
    (line,) = [line for line in lines if line[0] == "pollutant.stop_probability=0.1"]
    assert line[1].startswith("in cone") and line[2] == "2" and " to " in line[4]
    assert sim(*arguments, "--runs", "3") == 0
    assert path.read_bytes().startswith(whole) and path.read_bytes().count(b"\n") == 7


@pytest.mark.parametrize(
    "change",
    [("--blind",), ("--robots", "7"), ("--duration", "7"), ("--set", "pollutant.walk_s=3")],
)
def test_rows_of_another_campaign_are_never_mixed(
    pollutant, tmp_path: Path, capsys, change: tuple[str, ...]
) -> None:
    path = tmp_path / "r.csv"
    assert sim("pollutant", *SHORT, "--runs", "1", "-o", path) == 0
    before = path.read_bytes()
    capsys.readouterr()
    assert sim("pollutant", *SHORT, "--runs", "1", "-o", path, *change) == 2
    assert f"{path}:" in capsys.readouterr().err
    assert path.read_bytes() == before


def test_an_edited_file_makes_another_campaign(write_experiment, tmp_path: Path, capsys) -> None:
    """The experiment itself, its controller, and whatever else it names."""
    path = tmp_path / "r.csv"
    experiment = write_experiment("edited")
    notes = experiment.with_name("notes.txt")
    arguments = (experiment, "--lenient", "--duration", "1", "--runs", "1", "-o", path)
    plain = experiment.read_text()
    experiment.write_text(plain.replace("<params ", '<params notes="notes.txt" '))
    notes.write_text("one")
    assert sim(*arguments) == 0
    notes.write_text("two")
    assert sim(*arguments) == 2
    assert "a row of campaign" in capsys.readouterr().err
    notes.write_text("one")
    assert sim(*arguments) == 0
    # No attribute names it: it comes before the shipped one.
    model = experiment.with_name("epuck.toml")
    model.write_text((MODELS_FOLDER / "epuck.toml").read_text())
    assert sim(*arguments) == 2
    model.unlink()
    assert sim(*arguments) == 0
    experiment.write_text(experiment.read_text() + "<!-- -->")
    assert sim(*arguments) == 2


def test_a_run_that_fails_ends_the_campaign_and_is_named(
    write_experiment, tmp_path: Path, capsys
) -> None:
    path = tmp_path / "r.csv"
    experiment = write_experiment("plain")
    faults = ("--set", "wanderer.fault=0,1", "--duration", "1", "--runs", "2", "-j", "1")
    assert sim(experiment, *faults, "-o", path) == 1
    said = capsys.readouterr().err
    assert "wanderer.fault=1, seed 1: robot 31" in said
    assert "SIGSEGV" in said
    assert path.read_text().count("\n") == 3
    assert sim(experiment, "--set", "wanderer.fault=1", *faults[2:], "-o", tmp_path / "s.csv") == 1
    blind = ("--blind", "--duration", "1", "--runs", "2", "-o", tmp_path / "b.csv")
    assert sim("pollutant", *blind) == 0
    said = capsys.readouterr().err
    assert "sighted" not in said and re.search(r"^without virtual sensors +in cone", said, re.M)
    (row, _) = csv.DictReader((tmp_path / "b.csv").open(newline=""))
    assert (row["condition"], row["run"]) == ("blind", "blind, seed 1"), "in files they stay"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--set", "nobody.x=1,2"), "there is no 'nobody'"),
        (("--set", "sensor.noise=0,many"), "'many' is not a number"),
        (("--runs", "2", "--seed", "3"), "--seed: a campaign has --seeds"),
        (("--runs", "2", "--seeds", "1-3"), "--runs 2: --seeds names 3"),
        (("--format", "pdf"), "--format, --style: a campaign's chart only"),
    ],
)
def test_what_cannot_be_had_is_refused_before_anything_runs(
    tmp_path: Path, monkeypatch, capsys, arguments, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert sim("pollutant", *arguments) == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_run_without_end_needs_a_length(write_experiment, capsys) -> None:
    endless = write_experiment(
        "endless",
        ('length="120"', 'length="0"'),
        ('rotation_timestep="50%"', 'rotation_timestep="9"'),
    )
    assert sim(endless) == 2
    assert "endless.argos: has no length: give one with --duration" in capsys.readouterr().err


def test_ctrl_c_ends_everything_with_130(pollutant, tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    command = [sys.executable, "-m", "vsense", "sim", "pollutant", "--runs", "10000"]
    process = subprocess.Popen(
        [*command, "-j2", "-o", str(path)], stderr=subprocess.PIPE, text=True, cwd=ROOT
    )
    assert process.stderr is not None
    assert re.search(r"\d of 10000 runs", process.stderr.readline())
    workers = descendants(process.pid)
    assert len(workers) >= 2
    process.send_signal(signal.SIGINT)
    said = process.stderr.read()
    assert process.wait() == 130
    assert "the same command goes on from there" in said and "Traceback" not in said
    assert not any(Path(f"/proc/{pid}").exists() for pid in workers)
