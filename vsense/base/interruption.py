"""Ctrl-C, SIGTERM and a closed terminal as an event, also where users' code does not return."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from types import FrameType
from typing import NoReturn

from vsense.base.errors import CutShort

LAST_S = 1.7
"""After SIGTERM a command takes no longer than this, but for the moment of leaving."""

LEAST_WAIT_S = 0.1

SIGNAL_S = 0.5
"""A signal that comes in the moment before a wait begins does not end it: Python's handler runs
when the wait is over. So no wait lasts longer than this."""


STUCK_S = 1.0
"""Users' code that has not returned for so long is ended by a signal, and told without one."""

ALARM_S = 0.25
"""After a signal it is looked so often whether it has ..."""

MOST_ALARMS = 4
"""... and where it has not after so many CutShort, which it must have caught, the process ends."""


@dataclass(slots=True, eq=False)
class UsersCall:
    """A call of users' code that has not returned, in this process.

    Attributes:
        file: its file, as the user has named it.
        thread: in which it is.
        begun_s: when it was called, in time.monotonic() [s].
        alarms: so often it was to end.
    """

    file: str
    thread: int
    begun_s: float
    alarms: int = 0

    @property
    def duration_s(self) -> float:
        """Since it was called."""
        return time.monotonic() - self.begun_s

    def alarm(self) -> int:
        """Counts that it is to end."""
        self.alarms += 1
        return self.alarms


calls: list[UsersCall] = []
"""Those of this moment; a call in another one of the same thread is not among them."""

last_acts: list[Callable[[], None]] = []
"""What is done before a process ends that does not tidy up."""


class Interruption(threading.Event):
    """Set by the first of SIGINT, SIGTERM and SIGHUP that comes.

    Attributes:
        code: the command's exit code by then, 128 and the signal's number as in a shell: 130 after
            Ctrl-C, which is also what it is before any signal, and 143 after SIGTERM.
    """

    code = 128 + signal.SIGINT
    _came = _raises = _leaves_time = False
    _last_s: float | None = None

    def __init__(self) -> None:
        super().__init__()
        # What `threading.Event` holds while it waits and sets is not for a signal's handler, which
        # may come in the middle of it: it would wait for itself. This is.
        self._wakes: SimpleQueue[None] = SimpleQueue()

    @property
    def left_s(self) -> float:
        """How long all may take that is done yet, from now on."""
        return math.inf if self._last_s is None else max(self._last_s - time.monotonic(), 0.0)

    def is_set(self) -> bool:
        """Whether a signal has come."""
        return self._came

    def set(self) -> None:
        """Wakes all that wait; for handlers of signals, too."""
        self._came = True
        self._wakes.put(None)

    def wait(self, timeout: float | None = None) -> bool:
        """Waits for a signal, for `timeout` s at the longest; gives whether one has come."""
        end_s = None if timeout is None else time.monotonic() + timeout
        while not self._came:
            left_s = SIGNAL_S if end_s is None else min(SIGNAL_S, end_s - time.monotonic())
            if left_s <= 0.0:
                break
            with suppress(Empty):
                self._wakes.get(timeout=left_s)
                self._wakes.put(None)  # for whoever else waits
        return self._came

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """The signals' handler."""
        again = self.is_set()
        if not again:
            self.code = 128 + number
        if number != signal.SIGINT and self._last_s is None:
            self._last_s = time.monotonic() + LAST_S
        self.set()
        if self._raises or (self._leaves_time and again):
            self._raises = self._leaves_time = False
            raise CutShort(self.code)
        if self._leaves_time:
            self._set_alarm()
        else:
            self._set_looks()

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Has a signal raise CutShort where the main thread is, which looks at nothing there."""
        self._raises = True
        try:
            if self.is_set():
                raise CutShort(self.code)
            yield
        finally:
            self._raises = False

    @contextmanager
    def in_time(self) -> Iterator[None]:
        """What is worth some seconds after Ctrl-C: CutShort where it is not over `LAST_S` after a
        SIGTERM, or at the next signal."""
        if threading.current_thread() is not threading.main_thread():
            yield  # signals are the main thread's
            return
        self._leaves_time = True
        try:
            self._set_alarm()
            yield
        finally:
            self._leaves_time = False
            self._set_looks()

    def _set_looks(self) -> None:
        interval_s = ALARM_S if self._came else 0.0
        signal.setitimer(signal.ITIMER_REAL, interval_s, interval_s)

    def _set_alarm(self) -> None:
        if self._last_s is not None:
            left_s = max(self.left_s, LEAST_WAIT_S)
            # What then tidies up may wait, too.
            signal.setitimer(signal.ITIMER_REAL, left_s, ALARM_S)

    def ring(self, number: int, frame: FrameType | None) -> None:
        """The alarm's handler; CutShort where time is over, or users' code does not return."""
        if self._leaves_time and self.left_s == 0.0:
            raise CutShort(self.code)
        ours = [call for call in calls if call.thread == threading.main_thread().ident]
        if not ours or ours[0].duration_s < STUCK_S:
            return
        if ours[0].alarm() > MOST_ALARMS:
            _end_now(ours[0], self.code)
        raise CutShort(self.code)


def _end_now(call: UsersCall, code: int) -> NoReturn:
    """Ends the process; takes no lock, which may be held by what is interrupted here."""
    for act in last_acts:
        act()
    text = f"vsense: {call.file} catches what shall end it: the process ends\n"
    with suppress(OSError):
        os.write(2, text.encode("ascii", "backslashreplace"))
    os._exit(code)


_newest: Interruption | None = None


def left_s() -> float:
    """How long this process may go on: for ever, but after SIGTERM or SIGHUP; any thread."""
    return math.inf if _newest is None else _newest.left_s


@contextmanager
def interruption() -> Iterator[Interruption]:
    """Gives an event that SIGINT, SIGTERM and SIGHUP set, instead of what they did before.

    SIGHUP is left alone where it is ignored: `nohup` did that.
    """
    global _newest
    interrupted = _newest = Interruption()
    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, interrupted.interrupt) for number in numbers}
    before[signal.SIGALRM] = signal.signal(signal.SIGALRM, interrupted.ring)
    try:
        yield interrupted
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)
