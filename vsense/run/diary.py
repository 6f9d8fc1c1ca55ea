"""What happened in a run, for people to read later: what was said, and one row per timestep."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from types import TracebackType

from vsense.console import Console
from vsense.run.directory import DirectoryError
from vsense.runtime import Step

LOG = "log.txt"
TIMESTEPS = "timesteps.csv"

HEADER = "run_timestep,timestep,capture_ns,ready_ns,arena_ns,sent_ns,connected,seen,stale\n"
"""Times on the host's monotonic clock; robots that are connected, seen, and hold stale readings."""

FLUSH_TIMESTEPS = 10


class Diary(Console):
    """A console that also writes down what it says; a context that closes its files.

    A disk that fails ends the writing, never the run.
    """

    def __init__(self, directory: Path) -> None:
        """Starts the files of a run.

        Args:
            directory: the run directory, exists.

        Raises:
            DirectoryError: they cannot be written.
        """
        super().__init__()
        self._writing = threading.Lock()
        self._rows = 0
        try:
            self._log = (directory / LOG).open("w")
            self._table = (directory / TIMESTEPS).open("w")
            self._table.write(HEADER)
        except OSError as error:
            raise DirectoryError(f"{error.filename}: {error.strerror}") from None
        self._good = True

    def __enter__(self) -> Diary:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._write("", "", close=True)

    def say(self, text: str) -> None:
        """Prints a message of its own, and notes it with the time of day."""
        super().say(text)
        now_s = time.time()
        clock = time.strftime("%H:%M:%S", time.localtime(now_s)) + f".{int(now_s * 1000) % 1000:03}"
        self._write(f"{clock} {text}\n", "")

    def timestep(self, step: Step, connected: int, seen: int, stale: int) -> None:
        """Notes a timestep of the run.

        Args:
            step: the timestep.
            connected: robots that are connected.
            seen: robots that are seen.
            stale: robots that hold readings too old to move on.
        """
        times = f"{step.capture_ns},{step.ready_ns},{step.arena_ns},{step.sent_ns}"
        counts = f"{connected},{seen},{stale}"
        self._write("", f"{step.run_timestep},{step.timestep},{times},{counts}\n")

    def _write(self, line: str, row: str, close: bool = False) -> None:
        with self._writing:
            if not self._good:
                return
            try:
                self._log.write(line)
                self._table.write(row)
                self._rows += bool(row)
                if line or self._rows % FLUSH_TIMESTEPS == 0:
                    self._log.flush()
                    self._table.flush()
                if close:
                    self._log.close()
                    self._table.close()
                return
            except OSError as error:
                self._good = False
                reason = error.strerror
        super().say(f"vsense: the run is no longer written down: {reason}")
