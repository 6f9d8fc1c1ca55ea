"""The runs of one process: each has a folder, or does not begin; the first failure is told."""

from __future__ import annotations

import io
import json
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from vsense.base.errors import VsenseError
from vsense.base.terminal import Console
from vsense.modes._several import Series
from vsense.modes.sim.experiment import _SingleRun
from vsense.modes.sim.outcome import SimulatedRunError
from vsense.run.control import Control, State
from vsense.run.directory import DirectoryError
from vsense.run.orders import Order, OrderKind
from vsense.run.runner import Runner

START = Order(OrderKind.START, "ann")


class Runs:
    """A runner after a run, at whose page somebody does something in each of its rests."""

    def __init__(self, *acts: Callable[[Control], object]) -> None:
        self.control = Control(lambda wanted: None, lambda text: None, holds=True)
        self.control.state, self.control.why, self.control.begun = State.ENDED, "time", True
        self._acts = list(acts)

    def rest(self) -> bool:
        while not self.control.next_asked:
            if not self._acts:
                return False
            self._acts.pop(0)(self.control)
        return True


def series(folder: Path, runs: int = 1, holds: bool = True) -> tuple[Series, list[str]]:
    said = list[str]()
    say = lambda text, level: said.append(f"{level}: {text}")  # noqa: E731
    return Series("walk", folder, runs, holds, threading.Event(), say), said


def give(control: Control) -> None:
    control.give(START)


def test_a_run_that_can_have_no_folder_does_not_begin_and_may_be_ordered_again(
    tmp_path: Path,
) -> None:
    (tmp_path / "run-2").write_text("in its way, as a disk that is full")
    clear = lambda control: (tmp_path / "run-2").unlink()  # noqa: E731
    runs = Runs(give, clear, give)
    made, said = series(tmp_path)
    assert made.goes_on(cast(Runner, runs))
    assert made.directory(2) == tmp_path / "run-2" and (tmp_path / "run-2").is_dir()
    assert len(said) == 1 and "run 2 cannot begin: cannot make" in said[0]
    assert "File exists" in said[0] and said[0].startswith("trouble")


def test_nobody_waits_for_an_order_where_nobody_gives_one(tmp_path: Path) -> None:
    (tmp_path / "run-2").write_text("")
    made, _ = series(tmp_path, runs=2, holds=False)
    with pytest.raises(DirectoryError, match="run-2: File exists"):
        made.goes_on(cast(Runner, Runs()))


def test_the_figures_of_all_runs_are_there_after_each(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, _ = series(tmp_path)
    for number in (1, 2):
        made.directory(number)
        made.add({"run": number})
        written = json.loads((tmp_path / "series.json").read_text())
        assert written == {"experiment": "walk", "runs": [{"run": n + 1} for n in range(number)]}
    made.end(None, True)
    assert json.loads(capsys.readouterr().out) == written


def test_the_first_failure_is_the_one_that_is_raised(tmp_path: Path) -> None:
    made, said = series(tmp_path / "gone")
    made.add({"run": 1})
    with pytest.raises(VsenseError, match="no room"):
        made.end(VsenseError("no room"), False)
    assert len(said) == 1 and "series.json: No such file" in said[0]
    with pytest.raises(DirectoryError, match=r"series\.json"):
        made.end(None, False)


def test_a_simulation_that_fails_on_a_full_disk_tells_what_has_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = io.StringIO()
    nothing = cast(Any, None)
    job = cast(Any, SimpleNamespace(directory=str(tmp_path / "gone")))
    runs = _SingleRun(nothing, nothing, nothing, Console(said))
    monkeypatch.setattr(_SingleRun, "_summary", lambda self, job, result: {"run": 1})
    error = SimulatedRunError("mine.c fails", 1, nothing, {})
    assert runs._report_failure(job, error) == [{"run": 1}], "and raises nothing in its place"
    assert "summary.json: No such file" in said.getvalue()
