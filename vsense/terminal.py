"""A terminal: messages and a live line on standard error, blocks of lines that are drawn over
themselves, columns, and Ctrl-C, SIGTERM and a closed terminal as an event."""

from __future__ import annotations

import io
import os
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Literal, TextIO

from vsense.clock import host_ns
from vsense.errors import VsenseError, failing_as

Level = Literal["info", "warning", "trouble"]

QUIET_PERIOD_NS = 10_000_000_000
"""Time between progress lines where the stream is no terminal."""


class Console:
    """One live line that is drawn over itself, and messages that scroll away above it.

    For any thread. The stream is by default standard error; where it is no terminal the live line
    becomes a plain line every ten seconds, where it is closed nothing is printed.

    Attributes:
        newest: the live line in its full length.
        also: takes every message, too; must not wait.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
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
        """Prints a message on the stream only, for secrets: neither `also` nor a log gets it."""
        # A stream that was closed must not end an experiment.
        with self._lock, suppress(OSError):
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
                self._printed_ns = host_ns()
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
        return printed_ns is None or host_ns() - printed_ns >= QUIET_PERIOD_NS

    def _erase(self) -> None:
        if self._live and self._line:
            self._stream.write("\r\x1b[K")

    def _draw(self) -> None:
        if self._live:
            self._stream.write(self._line)
        self._stream.flush()


INTERRUPTED = 130
"""Exit code of a command that was interrupted."""


@contextmanager
def interruption() -> Iterator[threading.Event]:
    """Gives an event that SIGINT, SIGTERM and SIGHUP set, instead of what they did before."""
    interrupted = threading.Event()

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupted.set()

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, interrupt) for number in numbers}
    try:
        yield interrupted
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class LiveBlock:
    """A block of lines at the foot of a terminal; where there is none, it is printed once more.

    `has_blocks`: whether the stream takes Unicode's block characters.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._live = stream.isatty()
        self._drawn = 0
        self.has_blocks = (stream.encoding or "").lower().replace("-", "") == "utf8"

    def draw(self, lines: Sequence[str]) -> None:
        """Draws lines in the place of those before."""
        if self._live:
            columns = shutil.get_terminal_size().columns
            # A line that the terminal breaks is two, and the next block would begin too low.
            lines = [line[: columns - 1] for line in lines]
            if self._drawn:
                self._stream.write(f"\x1b[{self._drawn}A\r\x1b[J")
        self._stream.write("".join(f"{line}\n" for line in lines))
        self._stream.flush()
        self._drawn = len(lines)


def aligned(rows: Sequence[Sequence[str]], left: int | None = None) -> list[str]:
    """Aligns cells in columns, two blanks apart: `left` of them flush left, None: all."""
    widths = [max(map(len, column)) for column in zip(*rows)]
    lines = []
    for row in rows:
        cells = [
            cell.ljust(width) if left is None or number < left else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(row, widths))
        ]
        lines.append("  ".join(cells).rstrip())
    return lines


def drop_output() -> None:
    """Discards what is printed from now on: the program that read it has ended."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_data(text: str) -> None:
    """Prints on standard output, at once; VsenseError if it is closed."""
    with failing_as(VsenseError, "standard output"):
        print(text, flush=True)
