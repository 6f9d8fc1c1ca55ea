"""Searches: they find what is best, go on where they were, and say what is wrong."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

import vsense
from tests.rigs.places import ROOT
from vsense.base.arena import Floats
from vsense.cli import main
from vsense.run.runs_csv import read_runs
from vsense.studies.report import _plot
from vsense.studies.series._trials import Objective
from vsense.studies.series._varied import Trial, Varied, proposals
from vsense.studies.series.optimize import Optimum, _draw

LOOPS = """
class LoopFunctions:
    def post_step(self, world):
        x, y = float(world.params["x"]), int(world.params["y"])
        world.results["near"] = 5.0 - (x - 0.7) ** 2 - 0.1 * abs(y - 3)
        world.results["cost"] = x
"""
ARGOS = """<?xml version="1.0" ?>
<argos-configuration xmlns:vs="urn:vsense:1">
  <framework><experiment length="1" ticks_per_second="10" random_seed="1"
    vss_host="127.0.0.1" vss_port="4050" /></framework>
  <controllers><c_controller id="c" library="stand_still">
    <sensors><virtual_light_sensor implementation="default" /></sensors><params />
  </c_controller></controllers>
  <loop_functions library="loops.py" x="0" y="1" />
  <arena size="2,2,1" center="0,0,0.5">
    <e-puck id="a" tag_id="31"><body position="0,0,0" orientation="0,0,0" />
      <controller config="c" /></e-puck>
  </arena>
</argos-configuration>
"""
NEAR = ("mine.argos", "--vary", "loop_functions.x=0..1", "--vary", "loop_functions.y=1..5:1")


def optimize(*words: str | Path) -> int:
    return main(["optimize", *map(str, words)])


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """`mine.argos`, whose measures depend on two settings; the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loops.py").write_text(LOOPS)
    (tmp_path / "mine.argos").write_text(ARGOS)
    return tmp_path


def test_the_best_is_found_and_all_of_it_kept(capsys) -> None:
    words = (*NEAR, "--maximize", "near", "--runs", "2", "-o", "o.png", "--json")
    assert optimize(*words, "--trials", "30", "--batch", "10") == 0
    facts = json.loads(capsys.readouterr().out)
    (best,) = facts["best"]
    assert best["settings"]["loop_functions.y"] == "3"
    assert float(best["settings"]["loop_functions.x"]) == pytest.approx(0.7, abs=0.2)
    assert best["means"]["near"] == max(trial["means"]["near"] for trial in facts["trials"])
    assert len(facts["trials"]) == 30
    rows = read_runs(Path("o.csv"))
    assert len(rows) == 60 and {row.seed for row in rows} == {1, 2}
    assert len({row.condition for row in rows}) == 30
    assert cv2.imread("o.png").shape[1] > 1000


def test_it_goes_on_as_if_nobody_had_interrupted_it(capsys) -> None:
    how = ("--maximize", "near", "--runs", "2", "--batch", "7")
    assert optimize(*NEAR, *how, "--trials", "14", "-o", "whole.csv") == 0
    lines = Path("whole.csv").read_text().splitlines(keepends=True)
    Path("parts.csv").write_text("".join(lines[:-5]))  # in the middle of a batch and a trial
    capsys.readouterr()
    assert optimize(*NEAR, *how, "--trials", "14", "-o", "parts.csv") == 0
    assert Path("parts.csv").read_text() == Path("whole.csv").read_text()
    assert "best of 14 trials" in capsys.readouterr().err
    assert optimize(*NEAR, *how, "--trials", "14", "-o", "parts.csv", "--duration", "2") == 2
    assert (
        optimize(*NEAR, "--maximize", "near", "--runs", "3", "--trials", "1", "-o", "parts.csv")
        == 0
    )
    assert len(read_runs(Path("parts.csv"))) == 14 * 3  # every trial has a run more


def test_several_goals_have_a_front() -> None:
    found = vsense.optimize(
        "mine.argos",
        {"loop_functions.x": "0..1:0.1", "loop_functions.y": [3, 4]},
        maximize="near",
        minimize=["cost"],
        runs=1,
        trials=22,
        batch=22,
        output="o.csv",
    )
    assert len(found.trials) == 22  # all that there are
    front = [(t.settings["loop_functions.x"], t.settings["loop_functions.y"]) for t in found.front]
    assert front == [(f"{n / 10:g}", "3") for n in range(7, -1, -1)]
    assert found.best.values == pytest.approx([5.0, 0.7])
    assert found.picture is not None and cv2.imread(str(found.picture)).shape[0] > 1000


def test_one_asks_for_whole_numbers_where_others_are_refused(capsys) -> None:
    words = ("foraging", "--vary", "entity.quantity=2..4", "--maximize", "robots_carrying")
    assert optimize(*words, "--duration", "2", "--runs", "1", "--trials", "9", "-o", "o.csv") == 0
    names = {row.condition for row in read_runs(Path("o.csv"))}
    assert names == {f"entity.quantity={n}" for n in (2, 3, 4)}


@pytest.mark.parametrize(
    ("vary", "more", "said"),
    [
        ("loop_functions.x=1..0", "near", "=1..0: expected LOW..HIGH"),
        ("loop_functions.x=0..b", "near", "=0..b: expected LOW..HIGH"),
        ("loop_functions.x=0..1:0", "near", "=0..1:0: expected LOW..HIGH"),
        ("loop_functions.x=0..1:7", "near", "=0..1:7: expected LOW..HIGH"),
        ("loop_functions.x=0..1:log", "near", "with :log both ends are above 0"),
        ("loop_functions.x=0.5", "near", "expected LOW..HIGH, or several values"),
        ("loop_functions.x=1,1", "near", "expected every value once"),
        ("loop_function.x=0..1", "near", "is 'loop_functions' meant?"),
        ("loop_functions.x=0..1", "neat", "is 'near' meant?"),
    ],
)
def test_what_is_wrong_is_said(vary: str, more: str, said: str, capsys) -> None:
    assert optimize("mine.argos", "--vary", vary, "--maximize", more, "-o", "o.csv") == 2
    assert said in capsys.readouterr().err


def test_a_number_is_no_choice() -> None:
    with pytest.raises(
        vsense.VsenseError, match=r"vary loop_functions.x=0.5: expected '0..1', or a list"
    ):
        vsense.optimize("mine.argos", {"loop_functions.x": 0.5}, maximize="near")  # type: ignore


def test_what_does_not_go_together_is_said(capsys) -> None:
    twice, goal = ("--vary", "loop_functions.x=0..2"), ("--maximize", "items_home")
    for words, said in (
        ((*NEAR, *twice, "--maximize", "near"), "loop_functions.x: given twice"),
        ((*NEAR, "--set", "loop_functions.x=1", "--maximize", "near"), "x: given twice"),
        ((*NEAR, "--maximize", "near", "--minimize", "near"), "measure near: given twice"),
        (NEAR, "a measure to maximize or minimize"),
        (("foraging", "--vary", "foraging.relase=0..1", *goal), "is 'release' meant?"),
    ):
        assert optimize(*words) == 2
        assert said in capsys.readouterr().err


def test_sigterm_keeps_the_runs(folder: Path) -> None:
    words = ("--vary", "foraging.release=0..1", "--maximize", "items_home", "-j", "1")
    command = [sys.executable, "-m", "vsense", "optimize", "foraging", *words, "-o", "o.csv"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        while not Path("o.csv").exists():
            assert process.poll() is None
            time.sleep(0.02)  # or it takes a processor from the one that it waits for
        process.send_signal(signal.SIGTERM)
        said = process.communicate(timeout=60)[1]
    assert process.returncode == 143 and "the same command goes on from there" in said
    assert len(read_runs(Path("o.csv"))) >= 1


def test_a_sampler_learns_from_what_is_in_the_table() -> None:
    varied = [Varied.of("a.x", "0.001..1000:log")]
    trials: list[Trial] = []
    while len(trials) < 40:
        for settings in proposals(varied, [Objective("near")], trials, 4, seed=1):
            trials.append(Trial(settings, [-abs(np.log10(float(settings["a.x"])) - 1.0)], 1))
    found = Optimum(trials, [Objective("near")], varied, Path())
    assert float(found.best.settings["a.x"]) == pytest.approx(10.0, rel=0.2)
    logs = np.log10([float(trial.settings["a.x"]) for trial in trials])
    # Uniform draws lie 2.1 away on average.
    assert np.abs(logs[:10] - 1.0).mean() > 1.2 > 0.8 > np.abs(logs[-10:] - 1.0).mean()
    with _plot.styled(None):
        figure = _draw(found)
        assert len(figure.axes) == 2, "in their order, and by the one setting"
        drawn = _plot.encode(figure, "svg").decode()
    assert ">0.001<" in drawn and "math" not in drawn  # a power of ten has no formula


@pytest.mark.campaign
def test_foragings_best_release_is_found_again() -> None:
    foraging, seeds = vsense.load("foraging"), range(101, 201)

    def items_home(releases: Sequence[float], file: str) -> list[Floats]:
        table = foraging.simulate_many(seeds, {"foraging.release": releases}, file).columns()
        return [table["items_home"][table["foraging.release"] == release] for release in releases]

    sweep = items_home([0, 0.1, 0.2, 0.3, 0.5, 0.8, 1], "sweep.csv")
    vary = {"foraging.release": "0..1"}
    search = vsense.optimize("foraging", vary, maximize="items_home", runs=5, trials=30)
    release = float(search.best.settings["foraging.release"])
    (again,) = items_home([release], "again.csv")  # with seeds that the search has not seen
    best = max(sweep, key=np.mean)
    print(release, again.mean(), [values.mean() for values in sweep])
    # Two standard errors of a difference are 0.9 items; without pheromone there are 8 less.
    error = np.sqrt((again.var(ddof=1) + best.var(ddof=1)) / len(seeds))
    assert again.mean() > best.mean() - 2.0 * error
