"""The figures of a run, on a played stage."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from tests.run.stage import Stage, experiment
from vsense.base.arena import Frame
from vsense.base.terminal import Console
from vsense.robots.link.wire import StopCause, Telemetry
from vsense.run.figures import Figures, light_of, link_row, table, worst_links
from vsense.run.verdict import VoidCriteria, judged
from vsense.world.world import World


def played(stage: Stage) -> dict:
    """Plays a run and gives its summary."""
    figures = Figures(stage.experiment)
    readiness = stage.runner.wait(0.0)
    for step in stage.runner.timesteps():
        figures.observe(step, stage.robots())
    stage.runner.stop()
    summary = figures.summary(stage.runner, readiness, {"cleaned": 12.5})
    record = figures.record(stage.runner, (), {}, 0)
    summary = {"robots": len(stage.experiment.robots), **summary}
    return judged(summary, record, VoidCriteria())


def test_everything_is_counted() -> None:
    stage = Stage(experiment(robots=3, timesteps=10))
    first, second, _ = (robot.tag for robot in stage.experiment.robots)
    stage.connected, stage.seen = {first, second}, stage.tags
    stale = Telemetry(received=10, stop_cause=StopCause.STALE, battery_mv=3900)
    stage.statuses = {second: {"telemetry": stale}}
    stage.acts = {10: lambda: stage.seen.discard(first)}
    summary = played(stage)
    assert json.loads(json.dumps(summary)) == summary
    assert (summary["ended"], summary["timesteps"], summary["late_timesteps"]) == ("time", 10, 0)
    absent = stage.experiment.robots[2].id
    assert summary["missing_at_start"] == [absent]
    assert (summary["verdict"], summary["note"]) == ("void", "")
    words = f"robot {stage.experiment.robots[2].tag} never came; robot {second} never had fresh"
    assert summary["why"] == f"{words} readings"
    shares = [
        [robot[f"{key}_share"] for key in ("seen", "connected", "stale")]
        for robot in summary["per_robot"]
    ]
    assert shares == [[0.6, 1.0, 0.0], [1.0, 1.0, 1.0], [1.0, 0.0, 0.0]]
    assert [robot["battery_mv"] for robot in summary["per_robot"]] == [None, 3900, None]
    assert [robot["power_saving"] for robot in summary["per_robot"]] == [None, None, None]
    assert summary["arena"]["seen_mean"] == 2.6
    assert summary["latency_ms"]["capture_to_arena"] == {"p50": 15.0, "p99": 15.0, "max": 15.0}
    assert summary["latency_ms"]["capture_to_sent"]["max"] == 20.0
    assert summary["latency_ms"]["picture_to_arena"]["p50"] is None, "there are no pictures"
    assert summary["light_level"] is None
    no_faults = {"dropped": 0, "reconnects": 0, "defects": 0}
    assert summary["link"] == {"sent": 30, "received": 30, **no_faults}
    assert summary["results"] == {"cleaned": 12.5}


@pytest.mark.parametrize("there", [True, False])
def test_a_run_has_its_tables_or_goes_on_without(tmp_path: Path, there: bool) -> None:
    stage, folder, said = Stage(experiment(timesteps=10)), tmp_path / "run", io.StringIO()
    if there:
        folder.mkdir()
    figures, world = Figures(stage.experiment), SimpleNamespace(results={"home": 1.0})
    stage.runner.wait(0.0)
    counted = figures.carry_out(stage.runner, cast(World, world), folder, Console(said))
    connected = [sample.connected for _, sample in counted]
    assert len(connected) == len(figures.steps) == 10
    assert ("timesteps.csv" in said.getvalue()) == (not there)
    if there:
        rows = list(csv.DictReader((folder / "timesteps.csv").open()))
        names = ("run_timestep", "timestep", "capture_ns", "ready_ns", "arena_ns", "sent_ns")
        columns = figures.steps.columns()
        noted = dict(zip(figures.steps.NAMES, columns.tolist()))
        assert [[int(row[name]) for row in rows] for name in names] == [noted[n] for n in names]
        assert [int(row["connected"]) for row in rows] == connected
        assert len((folder / "measures.csv").read_text().splitlines()) == 11


def test_sessions_that_a_bug_has_ended_are_said() -> None:
    link = {"sent": 30, "received": 30, "dropped": 0, "reconnects": 1}
    assert link_row(link | {"defects": 2})[1].endswith(", 2 sessions ended by a defect in vsense")
    assert link_row(link)[1] == link_row(link | {"defects": 0})[1], "older summaries have none"


def test_the_room_is_as_light_as_its_pictures() -> None:
    dark, half = np.full((48, 64), 51, np.uint8), np.full((32, 32), 51, np.uint8)
    half[:, 16:] = 255
    frames = [Frame(name, image, 0, 0, 0) for name, image in (("a", dark), ("b", half))]
    assert light_of(frames[:1]) == 0.2
    assert light_of(frames) == 0.4, "cameras count alike, whatever their size"


def test_what_a_silence_leaves_out_is_late() -> None:
    stage = Stage(experiment(timesteps=40))
    stage.connected = stage.seen = stage.tags
    stage.acts = {
        10: lambda: setattr(stage, "silent", True),
        14: lambda: setattr(stage, "silent", False),
    }
    summary = played(stage)
    assert summary["timesteps"] + summary["late_timesteps"] == 40
    assert summary["late_timesteps"] == 10, "of a second without states"
    (silence,) = summary["arena"]["silences"]
    assert silence == {"run_timestep": 5, "duration_s": 1.105}


def test_late_and_left_out_timesteps_are_shares_of_those_that_were_due(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stage = Stage(experiment(timesteps=5))
    stage.connected = stage.seen = stage.tags
    played(stage)
    figures = Figures(stage.experiment)
    monkeypatch.setattr(figures, "_counts", lambda ended: (40, 10, 4))
    record = figures.record(stage.runner, (), {}, 0)
    assert (record.late, record.left_out) == (0.25, 0.1)


def test_an_interrupted_run_is_measured_up_to_there() -> None:
    stage = Stage(experiment(timesteps=40))
    stage.connected = stage.seen = stage.tags
    stage.acts = {12: stage.interrupted.set}
    summary = played(stage)
    assert (summary["ended"], summary["timesteps"], summary["duration_s"]) == (
        "interrupted",
        9,
        0.9,
    )
    assert summary["late_timesteps"] == 0


def test_the_worst_links_are_named() -> None:
    good = {"longest_silence_s": 0.075, "signal_dbm": None, "power_saving": None}
    robots = [
        {"name": "a", **good},
        {"name": "b", **good, "signal_dbm": -82},
        {"name": "c", **good, "longest_silence_s": 0.61, "power_saving": True},
        {"name": "d", **good, "signal_dbm": -60, "power_saving": False},
    ]
    assert worst_links(robots) == ["c (silent for 0.61 s, power saving is on)", "b (-82 dBm)"]


def test_the_table_says_it_all() -> None:
    stage = Stage(experiment(robots=2, timesteps=10))
    stage.connected = stage.seen = stage.tags
    lines = table(played(stage)).splitlines()
    assert lines[0].startswith("run       10 timesteps in 1 s, 0 late, 0 left out; ended by: time")
    assert lines[1] == "verdict   valid"
    assert any("2.00 of 2 robots seen" in line and "never" in line for line in lines)
    assert any("20 of 20 datagrams received" in line for line in lines)
    assert any(line.split() == ["measure", "cleaned:", "12.5"] for line in lines)
    name = str(stage.experiment.robots[0].tag)
    cells = ["100.0", "%", "100.0", "%", "0.0", "%", "-"]
    assert any(line.split() == [name, *cells] for line in lines)
