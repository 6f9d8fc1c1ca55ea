"""Writing that keeps nobody waiting: to a terminal that may be stopped, to a disk that may hang."""

from __future__ import annotations

import atexit
import os
import select
import socket
import stat
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TextIO
from weakref import WeakKeyDictionary

from vsense.base.interruption import left_s

PAUSE_S = 0.05
"""A reader that is only slow is waited for so long, once, until it has read again."""
MOST_PENDING = 1 << 18
"""Bytes that wait for a reader; what comes after them is left out."""
LAST_S = 0.5
"""When the process ends, its last words wait so long for a reader."""

MOST_WRITES = 10_000
"""So many writes wait for a disk; what comes after them is left out."""
HUNG_S = 1.0
"""A write that takes longer is told."""
CLOSE_S, POLL_S = 10.0, 0.05
"""In the end the disk is waited for so long; so often it is looked whether a signal has come."""


class Outlet:
    """A stream of text whose reader may be stopped (Ctrl-S, a hung ssh, `| less`).

    A terminal, pipe or socket is opened a second time, so as not to wait: what is set on the first
    descriptor is set for other processes, too. Any other stream is written as it is. Its methods
    are called by one thread at a time.

    Attributes:
        left_out: texts that were not written since the reader has last read all.
    """

    def __init__(self, stream: TextIO) -> None:
        self.left_out = 0
        self._stream = stream
        self._pending = bytearray()
        self._waits = True
        self._write = _second_descriptor(stream)

    def write(self, text: str, passing: bool = False) -> None:
        """Writes what the reader takes; the rest waits for the next call.

        A `passing` text is left out where another waits, since a newer one will come. OSError where
        the stream is closed.
        """
        if self._write is None:
            self._stream.write(text)
            self._stream.flush()
            return
        self._send()
        if passing and self._pending:
            return
        if self.left_out or len(self._pending) + len(text) > MOST_PENDING:
            self.left_out += 1
            return
        self._pending += text.encode(self._stream.encoding or "utf-8", "backslashreplace")
        self._send()

    def drain(self, wait_s: float) -> None:
        """Writes what waits, for `wait_s` s at the longest; OSError where the stream is closed."""
        end_s = time.monotonic() + wait_s
        while self._pending and self._ready(end_s - time.monotonic()):
            self._send()

    def _send(self) -> None:
        assert self._write is not None
        while self._pending:
            try:
                del self._pending[: self._write(self._pending)]
            except BlockingIOError:
                if not (self._waits and self._ready(PAUSE_S)):
                    self._waits = False
                    return
            except OSError:
                self._pending.clear()
                raise
        self._waits = True
        if self.left_out:
            text = f"vsense: {self.left_out} lines are left out here: nobody read them\n"
            self.left_out = 0
            self._pending += text.encode()
            self._send()

    def _ready(self, wait_s: float) -> bool:
        """Waits until something can be written."""
        poll = select.poll()
        poll.register(self._stream.fileno(), select.POLLOUT)
        return wait_s > 0.0 and bool(poll.poll(1000.0 * wait_s))


def _second_descriptor(stream: TextIO) -> Callable[[bytearray], int] | None:
    """Gives what writes to a stream and does not wait; None: its writing does not depend on who
    reads it."""
    try:
        first = stream.fileno()
        mode = os.fstat(first).st_mode
    except (AttributeError, OSError, ValueError):  # it is no file of the system's, or closed
        return None
    if stat.S_ISSOCK(mode):
        opened = socket.socket(fileno=os.dup(first))
        return lambda data: opened.send(data, socket.MSG_DONTWAIT)
    terminal = os.isatty(first)
    if not stat.S_ISFIFO(mode) and not terminal:
        return None
    own = ["/dev/tty"] if terminal and _controls(first) else []
    for name in (f"/proc/self/fd/{first}", *own):
        with suppress(OSError):  # it is another account's, as under sudo
            flags = os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
            return partial(os.write, os.open(name, flags))
    return None if terminal else partial(_write_little, first)


def _controls(descriptor: int) -> bool:
    """Whether a terminal is this process's own, which /dev/tty opens for every account."""
    try:
        return os.tcgetpgrp(descriptor) >= 0
    except OSError:
        return False


def _write_little(descriptor: int, data: bytearray) -> int:
    """Writes to a pipe what it takes at once where it takes any; BlockingIOError: it takes none."""
    poll = select.poll()
    poll.register(descriptor, select.POLLOUT)
    if not poll.poll(0):
        raise BlockingIOError
    return os.write(descriptor, data[: select.PIPE_BUF])


_outlets: WeakKeyDictionary[TextIO, Outlet] = WeakKeyDictionary()


def outlet_of(stream: TextIO) -> Outlet:
    """The one outlet of a stream, however many write there."""
    outlet = _outlets.get(stream)
    if outlet is None:
        outlet = _outlets[stream] = Outlet(stream)
    return outlet


@atexit.register
def _drain() -> None:
    for outlet in [*_outlets.values()]:
        with suppress(OSError, ValueError):  # its stream may be closed
            outlet.drain(max(min(LAST_S, left_s()), POLL_S))


# What waits is the parent's, and a fork closes what it does not know.
os.register_at_fork(after_in_child=_outlets.clear)


def has_ended(thread: threading.Thread, wait_s: float) -> bool:
    """Waits for a thread that is to end: for `wait_s` s at the longest, and no longer than a signal
    leaves time."""
    end_s = time.monotonic() + wait_s
    while thread.is_alive() and (wait_s := min(end_s - time.monotonic(), left_s())) > 0.0:
        thread.join(min(wait_s, POLL_S))
    return not thread.is_alive()


class BackgroundWriter:
    """A thread that brings something to a disk, in order, so that nobody waits for the disk.

    Args:
        what: it is, for people.
        say: takes a line about a disk that hangs; any thread.
    """

    def __init__(self, what: str, say: Callable[[str], None]) -> None:
        self._what, self._say = what, say
        self._pending: deque[Callable[[], None]] = deque()
        self._begun_s: float | None = None
        self._told = self._closed = False
        self._left_out = 0
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None

    def do(self, write: Callable[[], None]) -> None:
        """Has the thread call `write`, after all that was given before.

        Where too much waits it is left out, which is told when the disk takes more.
        """
        with self._changed:
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="vsense-writer", daemon=True)
                self._thread.start()
            if len(self._pending) < MOST_WRITES and not self._closed:
                self._pending.append(write)
                self._changed.notify()
            else:
                self._left_out += 1
            hung_s = 0.0 if self._begun_s is None else time.monotonic() - self._begun_s
            tell = hung_s > HUNG_S and not self._told
            self._told |= tell
        if tell:
            self._say(f"the disk does not answer for {hung_s:.1f} s: {self._what} waits in memory")

    @property
    def idle(self) -> bool:
        """Whether nothing waits."""
        return self._begun_s is None and not self._pending

    def close(self, wait_s: float = CLOSE_S) -> None:
        """Waits until all is written, as `has_ended` does."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread is not None and not has_ended(self._thread, wait_s):
            text = f"the disk does not answer: the last of {self._what}"
            self._say(f"{text} is lost if this process ends before")

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._pending or self._closed)
                if not self._pending:
                    return
                self._begun_s = time.monotonic()
                write = self._pending.popleft()
            try:
                write()
            except Exception as error:
                self._say(f"{self._what}: not all of it is written: {error!r}")
            with self._changed:
                self._begun_s = None
                over = self._told and not self._pending
                left_out = self._left_out if over else 0
                if over:
                    self._told, self._left_out = False, 0
            if over:
                lost = f"{left_out} parts are" if left_out else "nothing is"
                self._say(f"the disk answers again: {lost} lost of {self._what}")
