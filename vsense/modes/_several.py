"""Several runs of one process: where each leaves its files, and whether another one follows."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vsense.base.errors import failing_as
from vsense.run import directory as run_directory
from vsense.run.control import Control, State
from vsense.run.runner import Runner


class Series:
    """The runs of one process.

    Args:
        directory: of all runs, exists.
        runs: so many follow by themselves.
        holds: after them, or after a stop, an order may begin another.
        interrupted: set to end the process.

    Attributes:
        several: there may be more than one run, and each has a directory of its own. If one run
            was planned, only those after a reset have.
    """

    def __init__(
        self, directory: Path, runs: int, holds: bool, interrupted: threading.Event
    ) -> None:
        self.several = holds or runs > 1
        self._directory = directory
        self._runs = runs
        self._holds = holds
        self._interrupted = interrupted

    def directory(self, number: int) -> Path:
        """Makes the directory of a run, numbered from 1; DirectoryError if it cannot be made."""
        self.several |= number > 1
        if not self.several:
            return self._directory
        directory = self._directory / f"run-{number}"
        with failing_as(run_directory.DirectoryError, f"cannot make {directory}"):
            directory.mkdir()
        return directory

    def write_summary(
        self, name: str, summaries: Sequence[Mapping[str, Any]], on_stdout: bool
    ) -> None:
        """Writes the figures of all runs where there may be several, and prints them if wanted."""
        if self.several:
            figures = {"experiment": name, "runs": list(summaries)}
            run_directory.write_summary(self._directory, figures, on_stdout, run_directory.SERIES)

    def goes_on(self, runner: Runner) -> bool:
        """Whether another run follows; may run on until an order wants one."""
        control = runner.control
        if self._interrupted.is_set():
            return False
        if control.next_asked or (control.why == "time" and control.run < self._runs):
            return True
        # After an emergency stop a person has to look first, however the run was started.
        if not self._holds and control.state != State.EMERGENCY:
            return False
        return runner.rest()

    def was_broken(self, control: Control) -> bool:
        """Whether a Ctrl-C has cost anything: part of a run, or runs that were still to come."""
        cut = control.begun and control.why == "interrupted"
        finished = control.run if control.begun and not cut else control.run - 1
        return self._interrupted.is_set() and (cut or finished < self._runs)
