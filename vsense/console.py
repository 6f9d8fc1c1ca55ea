"""What a person sees on standard error while an experiment runs."""

from __future__ import annotations

import io
import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Literal, TextIO

Level = Literal["info", "warning", "trouble"]

QUIET_PERIOD_NS = 10_000_000_000
"""Where no terminal is watching, one progress line in this time is enough."""


class Console:
    """One live line that is drawn over itself, and messages that scroll away above it.

    Safe to use from several threads. Where the stream is no terminal the live line becomes a
    plain line every ten seconds.

    Attributes:
        newest: the live line, as long as it is.
        also: is told every message, too; must not wait.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        """Talks to `stream`, by default standard error; one that is closed hears nothing."""
        self._stream = stream or sys.stderr or io.StringIO()
        self._live = self._stream.isatty()
        self._line = ""
        self._printed_ns: int | None = None
        self._lock = threading.Lock()
        self.newest = ""
        self.also: Callable[[str, Level], None] = lambda text, level: None

    def say(self, text: str, level: Level = "info") -> None:
        """Prints a message of its own; `level` says how bad it is."""
        self.also(text, level)
        self.whisper(text)

    def whisper(self, text: str) -> None:
        """Prints a message that nobody else is told and nothing keeps, such as a secret."""
        with self._lock, suppress(OSError):
            # Nobody may be listening any more: no reason to lose an experiment.
            self._erase()
            print(text, file=self._stream)
            self._printed_ns = None
            self._draw()

    def progress(self, line: str) -> None:
        """Replaces the live line."""
        self.newest = line
        with self._lock, suppress(OSError):
            if self._live:
                self._erase()
                self._line = line[: os.get_terminal_size(self._stream.fileno()).columns - 1]
                self._draw()
            elif self._is_due():
                self._printed_ns = time.monotonic_ns()
                print(line, file=self._stream, flush=True)

    def end_progress(self) -> None:
        """Leaves the live line where it is and goes on below it."""
        with self._lock, suppress(OSError):
            if self._live and self._line:
                print(file=self._stream, flush=True)
            self._line = ""

    def _is_due(self) -> bool:
        """Whether a plain line is due: the first after a message, then every ten seconds."""
        printed_ns = self._printed_ns
        return printed_ns is None or time.monotonic_ns() - printed_ns >= QUIET_PERIOD_NS

    def _erase(self) -> None:
        if self._live and self._line:
            self._stream.write("\r\x1b[K")

    def _draw(self) -> None:
        if self._live:
            self._stream.write(self._line)
        self._stream.flush()
