"""A terminal: messages and a live line on standard error, blocks of lines that are drawn over
themselves, and columns."""

from __future__ import annotations

import atexit
import io
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Literal, TextIO

from vsense.base.clock import host_ns
from vsense.base.errors import VsenseError, failing_as

# vsense 0.1 had the first two here: who takes them from here may until 0.3.
from vsense.base.interruption import Interruption as Interruption
from vsense.base.interruption import interruption as interruption
from vsense.base.interruption import open_call
from vsense.base.writing import BackgroundWriter, is_on_disk, write

Level = Literal["info", "warning", "trouble"]

QUIET_PERIOD_NS = 10_000_000_000
"""Time between progress lines where the stream is no terminal."""


_CONTROLS = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Control characters, line separators, what changes the direction of writing, and halves of
characters: the same as the wire's (`c_src/PROTOCOL.md`)."""


def printable(text: str) -> str:
    """Words of others, on one line, with an escape such as \\x1b for what would control a terminal.

    Every text from a network passes through here before somebody sees it; that of robots is checked
    where packets are read. So does every text that is printed, which may be of somebody's file:
    nothing is printed but with `Console`, `print_data`, `paged` and `LiveBlock`.
    """
    return _CONTROLS.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def printable_lines(text: str) -> str:
    """As `printable`, of each line."""
    return "\n".join(map(printable, text.split("\n")))


_JSON_ESCAPES = re.compile(r"\\(?:u(?=061c|200[ef]|202[89a-e]|206[6-9]|00[89])|[^u])")


def printable_json(text: str) -> str:
    """JSON in ASCII for a page, in whose texts what changes the direction is shown as an escape."""
    if "\\u" not in text:
        return text
    return _JSON_ESCAPES.sub(lambda match: r"\\u" if match[0] == r"\u" else match[0], text)


LONG_S = 2.0
"""What takes longer is told while it goes on."""


class Console:
    """One live line that is drawn over itself, and messages that scroll away above it.

    For any thread. The stream is by default standard error; where it is no terminal the live line
    becomes a plain line every ten seconds, where it is closed nothing is printed, and where nobody
    reads it nobody waits: see `vsense.base.writing`.

    Attributes:
        newest: the live line in its full length.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stderr or io.StringIO()
        self._live = self._stream.isatty()
        self._line = ""
        self._printed_ns: int | None = None
        self._lock = threading.Lock()
        self.newest = ""
        self._repeat: Callable[[str, Level], None] = lambda text, level: None
        self._aside: BackgroundWriter | None = None

    def write_aside(self) -> None:
        """Has a thread write from now on where the stream is a file: its disk may hang."""
        if self._aside is None and is_on_disk(self._stream):
            self._aside = BackgroundWriter("standard error", lambda text: None)
            atexit.register(self._aside.close)

    def repeat_to(self, take: Callable[[str, Level], None]) -> None:
        """Gives every later message to `take`, too, which must not wait."""
        self._repeat = take

    def say(self, text: str, level: Level = "info") -> None:
        """Prints a message of its own; `level` says how bad it is."""
        text = printable_lines(text)
        self._repeat(text, level)
        self.print_only(text)

    def print_only(self, text: str) -> None:
        """Prints a message on the stream only, for secrets: no log and no `repeat_to` gets it."""
        # A stream that was closed must not end an experiment.
        with self._lock, suppress(OSError):
            line = self._line if self._live else ""
            self._print(f"{self._erasing()}{printable_lines(text)}\n{line}")
            self._printed_ns = None

    def progress(self, line: str) -> None:
        """Replaces the live line."""
        self.newest = line = printable(line)
        with self._lock, suppress(OSError):
            if self._live:
                erasing = self._erasing()
                self._line = line[: os.get_terminal_size(self._stream.fileno()).columns - 1]
                self._print(f"{erasing}{self._line}", passing=True)
            else:
                due = self._is_due()
                self._printed_ns = host_ns() if due else self._printed_ns
                self._print(f"{line}\n" if due else "", passing=True)

    def end_progress(self) -> None:
        """Leaves the live line where it is and goes on below it."""
        with self._lock, suppress(OSError):
            if self._live and self._line:
                self._print("\n")
            self._line = ""

    def _print(self, text: str, passing: bool = False) -> None:
        if self._aside is None:
            write(self._stream, text, passing)
        else:
            self._aside.do(partial(write, self._stream, text, passing))

    def _is_due(self) -> bool:
        """Whether a plain line is due: the first after a message, then every ten seconds."""
        printed_ns = self._printed_ns
        return printed_ns is None or host_ns() - printed_ns >= QUIET_PERIOD_NS

    def _erasing(self) -> str:
        """What removes the live line."""
        return "\r\x1b[K" if self._live and self._line else ""

    @contextmanager
    def patience(self, text: str) -> Iterator[None]:
        """Says what is waited for, and for how long, where that is longer than `LONG_S`."""
        over, begun_s = threading.Event(), time.monotonic()

        def report() -> None:
            wait_s = LONG_S
            while not over.wait(wait_s):
                self.progress(f"{text}: {time.monotonic() - begun_s:.0f} s")
                wait_s = 1.0

        thread = threading.Thread(target=report, name="vsense-patience", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()
            self.end_progress()


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
            lines = [printable(line)[: columns - 1] for line in lines]
            if self._drawn:
                self._stream.write(f"\x1b[{self._drawn}A\r\x1b[J")
        self._stream.write("".join(f"{printable(line)}\n" for line in lines))
        self._stream.flush()
        self._drawn = len(lines)


def aligned(rows: Sequence[Sequence[str]], left: int | None = None) -> list[str]:
    """Aligns cells in columns, two blanks apart: `left` of them flush left, None: all."""
    rows = [[printable(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows)]
    lines = []
    for row in rows:
        cells = [
            cell.ljust(width) if left is None or number < left else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(row, widths))
        ]
        lines.append("  ".join(cells).rstrip())
    return lines


_UNITS = ("m", "s", "rad", "deg")
"""In which names of measures end."""
_RENAMED = {"lit_in_cone": "LEDs on in cone"}
"""Measures that have the names of older recordings."""


MAX_LISTED_NAMES = 6
"""So many names are listed, then only how many more there are."""


def shorten(names: Iterable[str]) -> str:
    """Names in one line, the first few of many."""
    listed = list(names)
    more = len(listed) - MAX_LISTED_NAMES
    return ", ".join(listed[:MAX_LISTED_NAMES]) + (f" and {more} more" if more > 0 else "")


def counted(number: int, noun: str) -> str:
    """So many of something: 1 run, 2 runs."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def spoken(name: str) -> str:
    """A measure's name for people; names end in their unit."""
    name = _RENAMED.get(name, name)
    words, _, unit = name.rpartition("_")
    if words and unit in _UNITS:
        return f"{words.replace('_', ' ')} [{unit}]"
    return name.replace("_", " ")


def figure(value: float | None, unit: str = "", digits: int = 1, scale: float = 1.0) -> str:
    """A number for people, which may be unknown."""
    return "-" if value is None else f"{scale * value:.{digits}f}{unit}"


def measure_rows(measures: Mapping[str, float]) -> list[tuple[str, str]]:
    """Measures as the rows of a run's table, in one spelling for all modes."""
    return [("measure", f"{spoken(name)}: {value:g}") for name, value in measures.items()]


def paged(text: str) -> None:
    """Prints on standard output; on a terminal, with `$PAGER` or less where it is longer than that.

    Who reads only its begin ends nothing. VsenseError if it cannot be written.
    """
    stream, text = sys.stdout or io.StringIO(), printable_lines(text)
    words = (os.environ.get("PAGER") or "less").split()
    fits = text.count("\n") < shutil.get_terminal_size().lines
    if not stream.isatty() or fits or not words or shutil.which(words[0]) is None:
        try:
            print(text, end="", flush=True, file=stream)
        except BrokenPipeError:
            drop_output()
        except OSError as error:
            drop_output()
            raise VsenseError(f"standard output: {error.strerror}") from None
        return
    # Ctrl-C is the pager's, which goes on: who would restore the terminal if it were left alone?
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        options = {"LESS": "FRX", **os.environ}
        subprocess.run(words, input=text, encoding="utf-8", env=options, check=False)
    finally:
        signal.signal(signal.SIGINT, before)


UNREAD_S = 0.25
"""Data that nobody has read for so long is dropped where a signal ends the process."""


def drop_output() -> None:
    """Discards what is printed from now on: the program that read it has ended."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_data(text: str) -> None:
    """Prints lines on standard output, at once; VsenseError if it is closed.

    A reader that has gone, such as `head`, ends nothing.
    """
    with failing_as(VsenseError, "standard output"):
        try:
            with open_call("standard output", __file__, UNREAD_S):
                print(printable_lines(text), flush=True)
        except BrokenPipeError:
            drop_output()
        except (KeyboardInterrupt, SystemExit):  # nobody reads it, and the process shall end
            drop_output()
            raise
