"""The directory of one run, in which an earlier run is never written over: messages, one row per
timestep, and figures."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TextIO

from vsense.errors import VsenseError, failing_as
from vsense.run.runtime import Step
from vsense.terminal import Console, Level, print_data

SUMMARY = "summary.json"
SERIES = "series.json"
"""Figures of one run, and of several."""


class DirectoryError(VsenseError):
    """A file or directory of a run cannot be written."""


class UnusableDirectory(DirectoryError):
    """A directory that the user has named cannot hold a run."""

    exit_code = 2


def make(wanted: Path | None, name: str, seed: int | None) -> Path:
    """Makes `wanted`, or a directory in `runs/` named after time, experiment and, if any, seed.

    UnusableDirectory if it cannot be made, or is not empty.
    """
    stem = f"{time.strftime('%Y-%m-%d-%H%M%S')}-{name}"
    stem += "" if seed is None else f"-seed{seed}"
    directory = wanted or Path("runs") / stem
    with failing_as(UnusableDirectory, f"cannot write to {directory}"):
        if wanted is None:
            return _make_new(directory).resolve()
        directory.mkdir(parents=True, exist_ok=True)
        if any(directory.iterdir()):
            raise UnusableDirectory(f"{directory} is not empty: choose a new folder for this run")
    return directory.resolve()


def _make_new(wanted: Path) -> Path:
    """Makes a directory that nobody has, of this name or with a number after it.

    Commands that start in the same second get one each.
    """
    directory, copies = wanted, 1
    while True:
        try:
            directory.mkdir(parents=True)
        except FileExistsError:
            copies += 1
            directory = wanted.with_name(f"{wanted.name}-{copies}")
        else:
            return directory


def write_summary(
    directory: Path, summary: Mapping[str, object], on_stdout: bool, name: str = SUMMARY
) -> None:
    """Writes figures, and prints them if wanted.

    Raises:
        DirectoryError: the file cannot be written.
        VsenseError: standard output cannot be written.
    """
    text = json.dumps(summary, indent=2)
    if on_stdout:
        print_data(text)
    with failing_as(DirectoryError, str(directory / name)):
        (directory / name).write_text(f"{text}\n")


LOG = "log.txt"
TIMESTEPS = "timesteps.csv"

HEADER = "run_timestep,timestep,capture_ns,ready_ns,arena_ns,sent_ns,connected,seen,stale\n"
"""Times on the host's monotonic clock; robots that are connected, seen, and hold stale readings."""

FLUSH_TIMESTEPS = 10


class RunLog(Console):
    """A console that also writes a log into `directory`; a context that closes its files.

    DirectoryError where a file cannot be opened; later failures end the writing, never the run.
    """

    def __init__(self, directory: Path) -> None:
        super().__init__()
        self._writing = threading.Lock()
        self._rows = 0
        self._table: TextIO | None = None
        try:
            self._log = (directory / LOG).open("w")
        except OSError as error:
            raise DirectoryError(f"{error.filename}: {error.strerror}") from None
        self._good = True

    def begin_run(self, directory: Path) -> None:
        """Starts the table of a run's timesteps in its directory, and completes the one before."""
        with self._writing:
            try:
                table, self._table = self._table, None
                if table is not None:
                    table.close()
                self._table = (directory / TIMESTEPS).open("w")
                self._table.write(HEADER)
            except OSError as error:
                place = error.filename or directory / TIMESTEPS
                raise DirectoryError(f"{place}: {error.strerror}") from None

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, *exception: object) -> None:
        self._write("", "", close=True)

    def say(self, text: str, level: Level = "info") -> None:
        """Prints a message of its own, and notes it with the time of day."""
        super().say(text, level)
        now_s = time.time()
        clock = time.strftime("%H:%M:%S", time.localtime(now_s)) + f".{int(now_s * 1000) % 1000:03}"
        self._write(f"{clock} {text}\n", "")

    def timestep(self, step: Step, connected: int, seen: int, stale: int) -> None:
        """Writes a row of the table, see `HEADER`."""
        times = f"{step.capture_ns},{step.ready_ns},{step.arena_ns},{step.sent_ns}"
        counts = f"{connected},{seen},{stale}"
        self._write("", f"{step.run_timestep},{step.timestep},{times},{counts}\n")

    def _write(self, line: str, row: str, close: bool = False) -> None:
        with self._writing:
            if not self._good:
                return
            try:
                self._log.write(line)
                if self._table is not None:
                    self._table.write(row)
                self._rows += bool(row)
                for file in (self._log, self._table):
                    if file is not None and (line or self._rows % FLUSH_TIMESTEPS == 0):
                        file.flush()
                    if file is not None and close:
                        file.close()
                return
            except OSError as error:
                self._good = False
                reason = error.strerror
        super().say(f"vsense: the run is no longer written down: {reason}", "trouble")
