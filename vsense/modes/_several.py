"""Several runs of one process: where each leaves its files, and whether another one follows."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError, failing_as
from vsense.base.terminal import Level, print_data
from vsense.run import directory as run_directory
from vsense.run.control import Control, State
from vsense.run.runner import Runner


class Series:
    """The runs of one process.

    Args:
        name: of what is run.
        directory: of all runs, exists.
        runs: so many follow by themselves.
        holds: after them, or after a stop, an order may begin another.
        interrupted: set to end the process.
        say: takes a line for people.

    Attributes:
        several: there may be more than one run, and each has a directory of its own. If one run
            was planned, only those after a reset have.
        summaries: the figures of the runs so far.
    """

    def __init__(
        self,
        name: str,
        directory: Path,
        runs: int,
        holds: bool,
        interrupted: threading.Event,
        say: Callable[[str, Level], None],
    ) -> None:
        self.several = holds or runs > 1
        self.summaries: list[Mapping[str, Any]] = []
        self._name, self._directory = name, directory
        self._runs = runs
        self._holds = holds
        self._interrupted, self._say = interrupted, say
        self._made: tuple[int, Path] | None = None
        self._unwritten: VsenseError | None = None

    def directory(self, number: int) -> Path:
        """Makes the directory of a run, numbered from 1; DirectoryError if it cannot be made."""
        self.several |= number > 1
        if not self.several:
            return self._directory
        if self._made is None or self._made[0] != number:
            directory = self._directory / f"run-{number}"
            with failing_as(run_directory.DirectoryError, f"cannot make {directory}"):
                directory.mkdir()
            self._made = number, directory
        return self._made[1]

    def add(self, summary: Mapping[str, Any]) -> None:
        """Takes the figures of a run; where there may be several, those of all are written."""
        self.summaries.append(summary)
        if self.several:
            try:
                run_directory.write_summary(
                    self._directory, self._figures(), False, run_directory.SERIES
                )
                self._unwritten = None
            except run_directory.DirectoryError as error:
                self._unwritten = error

    def end(self, failure: VsenseError | None, on_stdout: bool) -> None:
        """There are no more runs: prints the figures of all if they are wanted.

        Raises:
            VsenseError: `failure`, what has ended the runs; or the figures cannot be written.
        """
        try:
            if on_stdout and (self.several or self.summaries):
                figures = self._figures() if self.several else self.summaries[0]
                print_data(json.dumps(figures, indent=2))
        except VsenseError as error:
            self._unwritten = self._unwritten or error
        if failure is not None and self._unwritten is not None:
            self._say(f"vsense: {self._unwritten}", "trouble")
        if failure := failure or self._unwritten:
            raise failure

    def _figures(self) -> dict[str, Any]:
        return {"experiment": self._name, "runs": self.summaries}

    def goes_on(self, runner: Runner) -> bool:
        """Whether another run follows, which has its directory; may run on until an order wants
        one.

        DirectoryError if a run that nobody has ordered cannot have one.
        """
        wanted = self._wants_another(runner)
        if wanted and not (self._holds or runner.control.next_asked):
            self.directory(runner.control.run + 1)
            return True
        while wanted and not self.prepares_next(runner.control):
            wanted = runner.rest()
        return wanted

    def prepares_next(self, control: Control) -> bool:
        """Makes the directory of the next run; a run that cannot have one is not wanted any more,
        and people are told."""
        try:
            self.directory(control.run + 1)
        except run_directory.DirectoryError as error:
            control.drop_next()
            text = (
                f"run {control.run + 1} cannot begin: {error}; when there is room, order it again"
            )
            self._say(text, "trouble")
            return False
        return True

    def _wants_another(self, runner: Runner) -> bool:
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
