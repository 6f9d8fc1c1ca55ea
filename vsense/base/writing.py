"""Writing that keeps nobody waiting: to a terminal that may be stopped, to a disk that may hang."""

from __future__ import annotations

import atexit
import io
import math
import os
import select
import signal
import stat
import threading
import time
import weakref
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import SimpleQueue
from typing import TextIO
from weakref import WeakKeyDictionary

from vsense.base.interruption import came, left_s

PAUSE_S = 0.05
"""A reader that is only slow is waited for so long, once, until it has read again."""
MOST_PENDING = 1 << 18
"""Bytes that wait for a reader; what comes after them is left out."""
LAST_WORDS_S = 1.0
"""When a signal has ended the process its last words wait so long for a reader."""

MOST_WRITES = 10_000
"""So many writes wait for a disk; what comes after them is left out."""
HUNG_S = 1.0
"""A write that takes longer is told."""
CLOSE_S, POLL_S = 10.0, 0.05
"""In the end the disk is waited for so long; so often it is looked whether a signal has come."""


class Outlet:
    """A terminal, pipe or socket whose reader may be stopped (Ctrl-S, a hung ssh, `| less`).

    It is opened a second time, so as not to wait: what is set on the first descriptor is set for
    other processes, too. For any thread.
    """

    def __init__(self, encoding: str, descriptor: int, write: Callable[[bytearray], int]) -> None:
        """`write` gives how much it has written to `descriptor`; it does not wait."""
        self._encoding, self._descriptor, self._write = encoding, descriptor, write
        self._pending, self._waits = bytearray(), True
        self._left_out = 0
        self._lock = threading.Lock()

    def write(self, text: str, passing: bool = False) -> None:
        """Writes what the reader takes; the rest waits for the next call. As `write`, below."""
        with self._lock:
            self._send()
            if passing and self._pending:
                return
            if self._left_out or len(self._pending) > MOST_PENDING:
                self._left_out += text.count("\n")
                return
            self._pending += text.encode(self._encoding, "backslashreplace")
            self._send()

    def drain(self) -> None:
        """Writes what waits: for ever, but for `LAST_WORDS_S` at the longest after a signal."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if callable(signal.getsignal(number)):
                signal.signal(number, signal.SIG_DFL)
        end_s = time.monotonic() + (
            max(min(LAST_WORDS_S, left_s()), POLL_S) if came() else math.inf
        )
        while self._pending and time.monotonic() < end_s:
            if _is_ready(self._descriptor, POLL_S) and self._lock.acquire(timeout=POLL_S):
                try:
                    self._send()
                finally:
                    self._lock.release()

    def _send(self) -> None:
        while self._pending:
            try:
                del self._pending[: self._write(self._pending)]
            except BlockingIOError:
                if not (self._waits and _is_ready(self._descriptor, PAUSE_S)):
                    self._waits = False
                    return
            except OSError:
                self._pending.clear()
                raise
        self._waits = True
        if self._left_out:
            text = f"vsense: {self._left_out} lines are left out here: nobody read them\n"
            self._left_out = 0
            self._pending += text.encode()
            self._send()


_outlets: WeakKeyDictionary[TextIO, Outlet | None] = WeakKeyDictionary()


def write(stream: TextIO, text: str, passing: bool = False) -> None:
    """Writes to a stream without waiting for its reader, where it is one of the system's.

    A `passing` text is left out where another waits, since a newer one will come. OSError where the
    stream is closed.
    """
    outlet = None
    # Of any other class `fileno` may be where nothing is written to, such as a notebook's.
    if type(stream) is io.TextIOWrapper:
        outlet = _outlets.get(stream) or _outlets.setdefault(stream, _outlet_of(stream))
    if outlet is None:
        stream.write(text)
        stream.flush()
    else:
        outlet.write(text, passing)


def descriptor_of(stream: TextIO | None) -> int | None:
    """None: it is no file of the system's, as under test, or it is closed."""
    try:
        descriptor = stream.fileno() if stream is not None else -1
        os.fstat(descriptor)
    except (AttributeError, OSError, ValueError):
        return None
    return descriptor


def _outlet_of(stream: io.TextIOWrapper) -> Outlet | None:
    """None: its writing does not depend on who reads it."""
    first = descriptor_of(stream)
    if first is None:
        return None
    mode, terminal = os.fstat(first).st_mode, os.isatty(first)
    if not (stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) or terminal):
        return None
    own = ["/dev/tty"] if terminal and _controls(first) else []
    for name in (f"/proc/self/fd/{first}", *own):
        with suppress(OSError):  # it is a socket, or another account's, as under sudo
            flags = os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
            second = os.open(name, flags)
            weakref.finalize(stream, os.close, second).atexit = False  # last words go there
            return Outlet(stream.encoding, second, partial(os.write, second))
    return None if terminal else Outlet(stream.encoding, first, partial(_write_little, first))


def is_on_disk(stream: TextIO) -> bool:
    """Whether a stream is a file, whose disk may hang."""
    descriptor = descriptor_of(stream)
    return descriptor is not None and stat.S_ISREG(os.fstat(descriptor).st_mode)


def _controls(descriptor: int) -> bool:
    """Whether a terminal is this process's own, which /dev/tty opens for every account."""
    try:
        return os.tcgetpgrp(descriptor) >= 0
    except OSError:
        return False


def _is_ready(descriptor: int, wait_s: float) -> bool:
    """Waits until something can be written."""
    poll = select.poll()
    poll.register(descriptor, select.POLLOUT)
    return bool(poll.poll(1000.0 * wait_s))


def _write_little(descriptor: int, data: bytearray) -> int:
    """Writes to a pipe or socket what it takes at once; BlockingIOError: it takes nothing."""
    if not _is_ready(descriptor, 0.0):
        raise BlockingIOError
    return os.write(descriptor, data[: select.PIPE_BUF])


@atexit.register
def _drain() -> None:
    for outlet in [*_outlets.values()]:
        with suppress(OSError, ValueError):  # its reader, or the stream, may be gone
            if outlet is not None:
                outlet.drain()


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

    Its methods may be called by any thread, and a signal in the midst of one costs nothing else.

    Args:
        what: it is, for people.
        say: takes a line about a disk that hangs; any thread.
    """

    def __init__(self, what: str, say: Callable[[str], None]) -> None:
        self._what, self._say = what, say
        self._pending: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._begun_s: float | None = None
        self._told = self._closed = False
        self._left_out = 0
        self._starting = threading.Lock()
        self._thread: threading.Thread | None = None

    def do(self, write: Callable[[], None]) -> None:
        """Has the thread call `write`, after all that was given before.

        Where too much waits it is left out, which is told when the disk takes more.
        """
        if self._closed or self._pending.qsize() >= MOST_WRITES:
            self._left_out += 1
        else:
            self._put(write)
        begun_s = self._begun_s
        hung_s = 0.0 if begun_s is None else time.monotonic() - begun_s
        if hung_s > HUNG_S and not self._told:
            self._told = True
            self._say(f"the disk does not answer for {hung_s:.1f} s: {self._what} waits in memory")

    @property
    def idle(self) -> bool:
        """Whether nothing waits."""
        return self._begun_s is None and self._pending.empty()

    def close(self, last: Callable[[], None] | None = None, wait_s: float = CLOSE_S) -> None:
        """Has `last` called, and waits until all is written, as `has_ended` does."""
        if not self._closed:
            self._closed = True
            if last is not None:
                self._put(last)
            self._pending.put(None)
        if self._thread is not None and not has_ended(self._thread, wait_s):
            text = f"the disk does not answer: the last of {self._what}"
            self._say(f"{text} is lost if this process ends before")

    def _put(self, write: Callable[[], None]) -> None:
        self._pending.put(write)
        if self._thread is None:
            with self._starting:
                if self._thread is None:
                    run = threading.Thread(target=self._run, name="vsense-writer", daemon=True)
                    run.start()
                    self._thread = run

    def _run(self) -> None:
        while (write := self._pending.get()) is not None:
            self._begun_s = time.monotonic()
            try:
                write()
            except Exception as error:
                self._say(f"{self._what}: not all of it is written: {error!r}")
            self._begun_s = None
            if self._pending.empty():
                self._say_lost()
        self._say_lost()

    def _say_lost(self) -> None:
        """Says what was left out, and that a disk answers which did not."""
        left_out, self._left_out = self._left_out, 0
        if left_out:
            self._say(f"{left_out} parts of {self._what} are lost: the disk was too slow for them")
        elif self._told:
            self._say(f"the disk answers again: nothing is lost of {self._what}")
        self._told = False
