"""The directory of one run, in which an earlier run is never written over: messages, one row per
timestep, and figures."""

from __future__ import annotations

import csv
import io
import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TextIO

from vsense.base.errors import VsenseError, failing_as
from vsense.base.files import replace_text
from vsense.base.terminal import Console, Level, print_data, printable_lines
from vsense.base.writing import BackgroundWriter

SUMMARY = "summary.json"
SERIES = "series.json"
"""Figures of one run, and of several."""


TRAJECTORY, LOGGED = "trajectory.npz", "events.csv"
"""Poses and events of a simulation."""


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
            return make_new(directory).resolve()
        directory.mkdir(parents=True, exist_ok=True)
        if any(directory.iterdir()):
            raise UnusableDirectory(f"{directory} is not empty: choose a new folder for this run")
    return directory.resolve()


def make_new(wanted: Path) -> Path:
    """Makes a directory that nobody has, of this name or with a number after it.

    Those who begin in the same second get one each. OSError if it cannot be made.
    """
    with suppress(FileExistsError):  # a file, or a link that leads nowhere: told below
        wanted.parent.mkdir(parents=True, exist_ok=True)
    directory, copies = wanted, 1
    while True:
        try:
            directory.mkdir()
        except FileExistsError:
            copies += 1
            directory = wanted.with_name(f"{wanted.name}-{copies}")
        else:
            return directory


def write_summary(
    directory: Path, summary: Mapping[str, object], on_stdout: bool, name: str = SUMMARY
) -> None:
    """Writes figures, and prints them if wanted; a full disk leaves those that were there.

    Raises:
        DirectoryError: the file cannot be written.
        VsenseError: standard output cannot be written.
    """
    text = json.dumps(summary, indent=2)
    try:
        with failing_as(DirectoryError, str(directory / name)):
            replace_text(directory / name, f"{text}\n")
    finally:
        if on_stdout:
            print_data(text)


LOG_TXT = "log.txt"
TIMESTEPS_CSV, MEASURES_CSV = "timesteps.csv", "measures.csv"

HEADER = "run_timestep,timestep,capture_ns,ready_ns,arena_ns,sent_ns,connected,seen,stale\n"
"""Times on the host's monotonic clock; robots that are connected, seen, and hold stale readings."""

FLUSH_TIMESTEPS = 10


class RunTables:
    """`timesteps.csv` and `measures.csv` of one run, in its directory: a row for each timestep.

    There is no `measures.csv` before the experiment has measured something. What the disk does not
    take ends the writing, never the run; `say` takes a line about that.

    DirectoryError where a file cannot be made.
    """

    def __init__(
        self, directory: Path, timestep_s: float, say: Callable[[str], None] = lambda text: None
    ) -> None:
        self._measures_path, self._timestep_s, self._say = directory / MEASURES_CSV, timestep_s, say
        self._measures: TextIO | None = None
        self._names: list[str] = []
        self._rows, self._good = 0, True
        with failing_as(DirectoryError, str(directory / TIMESTEPS_CSV)):
            self._timesteps = (directory / TIMESTEPS_CSV).open("w", encoding="utf-8")
            self._timesteps.write(HEADER)

    def add(
        self,
        timesteps: tuple[int, int],
        times_ns: Sequence[int | None],
        counts: Sequence[int | None],
        measures: Mapping[str, float],
    ) -> None:
        """Adds a timestep of the run.

        Args:
            timesteps: of the run, and since the start.
            times_ns: capture, pictures ready, arena state, readings sent; None: there was none.
            counts: robots that are connected, seen, and hold stale readings; None: nobody counts.
            measures: the experiment's, by name.
        """
        if not self._good:
            return
        cells = ["" if cell is None else str(cell) for cell in (*timesteps, *times_ns, *counts)]
        try:
            self._timesteps.write(f"{','.join(cells)}\n")
            if measures or self._names:
                self._add_measures(timesteps[0], measures)
            self._rows += 1
            if self._rows % FLUSH_TIMESTEPS == 0:
                self._flush()
        except OSError as error:
            self._good = False
            self._say(f"the run's tables are no longer written: {error.strerror}")

    def close(self) -> None:
        """There are no more timesteps."""
        for file in (self._timesteps, self._measures):
            with suppress(OSError):
                if file is not None:
                    file.close()

    def _add_measures(self, run_timestep: int, measures: Mapping[str, float]) -> None:
        new = [name for name in measures if name not in self._names]
        if new or self._measures is None:
            self._widen(new)
        assert self._measures is not None
        values = (measures.get(name) for name in self._names)
        cells = ["" if value is None else f"{value:.12g}" for value in values]
        time_s = round(run_timestep * self._timestep_s, 9)
        self._measures.write(f"{run_timestep},{time_s:.12g},{','.join(cells)}\n")

    def _widen(self, new: Sequence[str]) -> None:
        """Adds columns, which are empty in the rows before."""
        body = ""
        if self._measures is not None:
            self._measures.flush()
            text = self._measures_path.read_text(encoding="utf-8")
            body = text[len(self._head()) :].replace("\n", f"{',' * len(new)}\n")
        self._names += new
        # Beside it: the rows so far outlast a disk that is full now.
        part = self._measures_path.with_name(f".{MEASURES_CSV}.part")
        try:
            wider = part.open("w", encoding="utf-8", newline="")
            wider.write(self._head() + body)
            wider.flush()
            part.replace(self._measures_path)
        except OSError:
            with suppress(OSError):
                part.unlink()
            raise
        if self._measures is not None:
            self._measures.close()
        self._measures = wider

    def _head(self) -> str:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow(["run_timestep", "time_s", *self._names])
        return text.getvalue()

    def _flush(self) -> None:
        self._timesteps.flush()
        if self._measures is not None:
            self._measures.flush()


class RunLog(Console):
    """A console that also writes a log into `directory`; a context that closes its files.

    DirectoryError where a file cannot be opened; later failures end the writing, never the run, and
    a disk that hangs keeps nobody waiting.
    """

    def __init__(self, directory: Path) -> None:
        super().__init__()
        try:
            self._log = (directory / LOG_TXT).open("w")
        except OSError as error:
            raise DirectoryError(f"{error.filename}: {error.strerror}") from None
        self._good = True
        tell = partial(self.say, level="trouble")
        self._writer = BackgroundWriter(str(directory / LOG_TXT), tell)

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, *exception: object) -> None:
        self._writer.close(partial(self._write, "", close=True))

    def say(self, text: str, level: Level = "info") -> None:
        """Prints a message of its own, and notes it with the time of day."""
        super().say(text, level)
        now_s = time.time()
        clock = time.strftime("%H:%M:%S", time.localtime(now_s)) + f".{int(now_s * 1000) % 1000:03}"
        self._writer.do(partial(self._write, f"{clock} {printable_lines(text)}\n"))

    def _write(self, line: str, close: bool = False) -> None:
        """Writes to the disk; the writer's thread."""
        if not self._good:
            return
        try:
            self._log.write(line)
            self._log.flush()
            if close:
                self._log.close()
        except OSError as error:
            self._good = False
            super().say(f"vsense: the run is no longer written down: {error.strerror}", "trouble")
