"""One run after the other: where each leaves its things, and whether another one follows."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vsense.run import directory as run_directory
from vsense.run.control import Control, State
from vsense.run.runner import Runner

PATIENCE_S = 10.0
"""In a series, a run but the first waits so long for robots; then it starts without them."""


class Series:
    """The runs of one process.

    Args:
        directory: of all runs, exists.
        runs: so many follow by themselves.
        holds: after them, or where somebody has stopped one, people may begin another.
        interrupted: set by whoever wants the process to end.

    Attributes:
        several: there may be more than one: each has a directory of its own. Of what was meant to
            be one run, only those after a reset have.
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
        """Gives the directory of a run, from 1; it exists.

        Raises:
            DirectoryError: it cannot be made.
        """
        self.several |= number > 1
        if not self.several:
            return self._directory
        directory = self._directory / f"run-{number}"
        try:
            directory.mkdir()
        except OSError as error:
            raise run_directory.DirectoryError(
                f"cannot make {directory}: {error.strerror}"
            ) from None
        return directory

    def write_summary(
        self, name: str, summaries: Sequence[Mapping[str, Any]], on_stdout: bool
    ) -> None:
        """Writes the figures of all runs where there may be several, and prints them if wanted.

        Raises:
            DirectoryError: the file, or standard output, cannot be written.
        """
        if self.several:
            figures = {"experiment": name, "runs": list(summaries)}
            run_directory.write_summary(self._directory, figures, on_stdout, run_directory.SERIES)

    def patience_s(self, number: int, wanted_s: float | None) -> float | None:
        """How long a run waits for its robots, None: for ever; `wanted_s` is what the user said."""
        return PATIENCE_S if wanted_s is None and number > 1 else wanted_s

    def goes_on(self, runner: Runner) -> bool:
        """Whether another run follows; may live on until somebody wants one.

        Raises:
            VsenseError: something has failed meanwhile.
        """
        control = runner.control
        if self._interrupted.is_set():
            return False
        if control.next_asked or (control.why == "time" and control.run < self._runs):
            return True
        # After an emergency stop somebody has to look first, however the run was started.
        if not self._holds and control.state != State.EMERGENCY:
            return False
        return runner.rest()

    def was_broken(self, control: Control) -> bool:
        """Whether a Ctrl-C has cost anything: part of a run, or runs that were still to come."""
        cut = control.begun and control.why == "interrupted"
        finished = control.run if control.begun and not cut else control.run - 1
        return self._interrupted.is_set() and (cut or finished < self._runs)
