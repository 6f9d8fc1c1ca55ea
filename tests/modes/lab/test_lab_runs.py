"""Runs of a lab: each is reported when it is over, whatever becomes of the others."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tests.run.stage import experiment, status
from vsense.base.errors import VsenseError
from vsense.base.shared import LabError
from vsense.modes._several import Series
from vsense.modes.lab import _report
from vsense.modes.lab import experiment as lab
from vsense.modes.lab._run_logs import RunLogs
from vsense.modes.lab._swarm import LabRobot
from vsense.modes.lab.experiment import _LabRuns
from vsense.modes.lab.session import Session
from vsense.modes.lab.truth import TruthLog, truth_dtype
from vsense.run.control import Control, State
from vsense.run.runs_csv import RunRows
from vsense.run.verdict import RunRecord


class Interrupted(threading.Event):
    """By nobody."""

    code = 130
    in_time = staticmethod(nullcontext)


class Lab:
    """A session whose runs are over at once; `fails` has what fails in them, by their numbers."""

    def __init__(self, folder: Path, fails: dict[int, VsenseError]) -> None:
        self.said, self.reported_when = list[str](), list[int]()
        self._fails = fails
        self.experiment = experiment()
        self.control = Control(lambda wanted: None, lambda text: None)
        self.runner, self.server = SimpleNamespace(control=self.control), None
        self.environment = SimpleNamespace(seed=1)
        self.cameras = [SimpleNamespace()] * 4
        recorders = SimpleNamespace(end_run=lambda: None)
        room = SimpleNamespace(
            begin_run=lambda *words: None, fail=lambda error: None, recorders=recorders
        )
        console = SimpleNamespace(
            say=lambda text, level="info": self.said.append(text), end_progress=lambda: None
        )
        self.setup = SimpleNamespace(console=console, room=room, interrupted=Interrupted())
        self.directory, self.notes = folder, cast(Any, None)
        self.wait_until_ready = self.home = lambda: None
        self.doubts = list

    def __enter__(self) -> None: ...

    def __exit__(self, *exception: object) -> None: ...

    def run(self, directory: Path, observe: Callable[..., None]) -> None:
        figures = SimpleNamespace(steps=[1])
        record = RunRecord()
        self.notes = SimpleNamespace(directory=directory, figures=figures, record=record)
        self.control.state, self.control.begun, self.control.why = State.ENDED, True, "time"
        if error := self._fails.get(self.control.run):
            raise error

    def next_run(self) -> None:
        self.control.next_run()


@pytest.fixture
def carry_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., tuple[Lab, _LabRuns]]:
    """Three runs; of one `unread` the logs cannot be read, of one `undrawn` no picture is made."""

    def make(unread: int = 0, undrawn: int = 0, **fails: VsenseError) -> tuple[Lab, _LabRuns]:
        made = Lab(tmp_path, {int(name[3:]): error for name, error in fails.items()})

        def gather(session: Lab, notes: object) -> None:
            made.reported_when.append(session.control.run)
            if session.control.run == unread:
                raise LabError("truth log: it lacks the run from its first timestep")

        def draw(session: Lab, *words: object) -> None:
            if session.control.run == undrawn:
                raise VsenseError("no picture")

        def summarise(session: Lab, *words: object) -> dict[str, Any]:
            return {
                "run": session.control.run, "experiment": "pollutant", "blind": False, "seed": 1,
                "duration_s": 2.0, "robots": 2, "timesteps": 20, "left_out_timesteps": 0,
                "late_timesteps": 0, "unlogged_timesteps": 0, "ended": "time", "verdict": "valid",
                "why": "", "note": "",
            }  # fmt: skip

        monkeypatch.setattr(_report, "gather", gather)
        monkeypatch.setattr(_report, "summarise", summarise)
        monkeypatch.setattr(_report, "table", lambda summary: "table")
        monkeypatch.setattr(_report, "draw", draw)
        for name in ("say_link", "_announce"):
            monkeypatch.setattr(lab, name, lambda *words: None)
        setup, session = made.setup, cast(Session, made)
        say = setup.console.say
        series = Series("pollutant", tmp_path, 3, False, setup.interrupted, say)
        return made, _LabRuns(session, series, RunRows(tmp_path, "lab", {}))

    return make


def rows(folder: Path) -> list[str]:
    return [line.split(",")[0] for line in (folder / "runs.csv").read_text().splitlines()[1:]]


def test_each_run_is_reported_before_the_next_begins(
    tmp_path: Path, carry_out: Callable[..., tuple[Lab, _LabRuns]]
) -> None:
    made, runs = carry_out(run3=VsenseError("the cameras are gone"))
    with pytest.raises(VsenseError, match="the cameras are gone"):
        runs.run(False)
    assert made.reported_when == [1, 2, 3], "and the third when it had failed"
    assert rows(tmp_path) == ["run-1", "run-2", "run-3"]


def test_what_cannot_be_read_of_one_run_costs_no_other(
    tmp_path: Path,
    carry_out: Callable[..., tuple[Lab, _LabRuns]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    made, runs = carry_out(unread=2)
    assert runs.run(True) == 1
    assert rows(tmp_path) == ["run-1", "run-3"]
    figures = json.loads(capsys.readouterr().out)
    assert [run["run"] for run in figures["runs"]] == [1, 3]
    (told,) = [text for text in made.said if "truth log" in text]
    assert told.startswith("vsense: run 2 is not reported as a whole: ")


def test_a_run_without_a_picture_has_its_row(
    tmp_path: Path, carry_out: Callable[..., tuple[Lab, _LabRuns]]
) -> None:
    _, runs = carry_out(undrawn=1)
    assert runs.run(False) == 1
    assert rows(tmp_path) == ["run-1", "run-2", "run-3"]
    assert {path.parent.name for path in tmp_path.glob("run-*/summary.json")} == set(rows(tmp_path))


def test_all_is_well_where_nothing_fails(carry_out: Callable[..., tuple[Lab, _LabRuns]]) -> None:
    assert carry_out()[1].run(False) == 0


def unlogged(
    tmp_path: Path,
    traced: int,
    stood_s: float = 0.0,
    logged: int = 30,
    early: int = 0,
    **known: object,
) -> list[str]:
    """What a lab says of the logs of 30 timesteps, with the trace of its robot up to one.

    Of the first `early` the pictures were taken before the run began.
    """
    made = object.__new__(Session)
    robot = LabRobot(Path("daemon"), 31, "red", "argos:x", 0, 0.0, tmp_path / "31.trace")
    robot.trace.write_text(f"step 7 timestep {traced} run 1 values -\n")
    log = TruthLog(tmp_path / "truth.bin", 1)
    for timestep in range(1 + early):
        log.append(timestep, 0, 0, 0, np.zeros((1, 3)), np.zeros(1, np.uint16))
    while (tmp_path / "truth.bin").stat().st_size < 16 + (1 + early) * truth_dtype(1).itemsize:
        time.sleep(0.001)  # a thread writes it
    logs = RunLogs(tmp_path / "truth.bin", tmp_path / "actuations.bin", [robot])
    for timestep in range(1 + early, 1 + logged):
        log.append(timestep, 0, 0, 0, np.zeros((1, 3)), np.zeros(1, np.uint16))
    log.close()
    made.dt_ns, made.resting = 100_000_000, ()
    standing = SimpleNamespace(stood_s=lambda tag: (stood_s, 0.0))
    robots = {31: status(31, "red", **known)}
    made.runner = cast(Any, SimpleNamespace(robots=robots, standing=standing))
    columns = np.arange(1, 31)[np.newaxis]
    figures = SimpleNamespace(steps=SimpleNamespace(columns=lambda: columns))
    notes = SimpleNamespace(figures=figures, robots=[robot], logs=logs)
    return made._unlogged(cast(Any, notes))


def test_a_run_says_what_its_logs_lack(tmp_path: Path) -> None:
    assert unlogged(tmp_path, 30) == [] == unlogged(tmp_path, 20)
    assert unlogged(tmp_path, 30, early=3) == []
    assert unlogged(tmp_path, 30, logged=28) == ["2 timesteps of truth.bin"]
    assert unlogged(tmp_path, 19) == ["the last steps of 31.trace"]
    assert unlogged(tmp_path, 19, stood_s=0.1) == [] == unlogged(tmp_path, 19, connected=False)


def test_a_run_of_which_the_truth_log_has_nothing_has_no_figures(tmp_path: Path) -> None:
    logs = RunLogs(tmp_path / "none.bin", tmp_path / "actuations.bin", [])
    (words,) = logs.end(np.arange(3), [], 10)
    assert "none.bin: No such file" in words
    with pytest.raises(LabError, match=r"none\.bin: it lacks the run from its first timestep"):
        logs.known_truth()
