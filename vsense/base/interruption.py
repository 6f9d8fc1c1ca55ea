"""Ctrl-C, SIGTERM and a closed terminal as an event, also where something does not return."""

from __future__ import annotations

import _thread
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
from typing import Any, NoReturn

from vsense.base.errors import CutShort

LAST_S = 1.7
"""After SIGTERM a command takes no longer than this, but for the moment of leaving."""

END_S = 3.0
"""What is not over so long after that is not waited for: the process ends where it is."""

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
class OpenCall:
    """A call in this process that may not return: of users' code, or of what waits for a reader.

    Attributes:
        name: its file, as the user has named it, or what it is.
        file: in which a frame of it is.
        limit_s: it is ended by a signal when it has not returned for so long.
        thread: in which it is.
        begun_s: when it was called, in time.monotonic() [s].
        alarms: so often it was to end.
    """

    name: str
    file: str
    limit_s: float
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

    def found_in(self, frame: FrameType | None) -> FrameType | None:
        """The innermost frame of its file in a thread that is there; None: it has been left."""
        while frame is not None and frame.f_code.co_filename != self.file:
            frame = frame.f_back
        return frame


calls: list[OpenCall] = []
"""Those of this moment; a call in another one of the same thread is not among them."""


@contextmanager
def open_call(name: str, file: str, limit_s: float) -> Iterator[OpenCall]:
    """Notes a call while it lasts, or gives the one that it is in; see `OpenCall`."""
    thread = threading.get_ident()
    outer = next((call for call in calls if call.thread == thread), None)
    if outer is not None:
        yield outer
        return
    call = OpenCall(name, file, limit_s, thread, time.monotonic())
    calls.append(call)
    try:
        yield call
    finally:
        if call in calls:
            calls.remove(call)


last_acts: list[Callable[[], None]] = []
"""What is done before a process ends that does not tidy up."""


class Interruption(threading.Event):
    """Set by the first of SIGINT, SIGTERM and SIGHUP that comes.

    Attributes:
        code: the command's exit code by then, 128 and the signal's number as in a shell: 130 after
            Ctrl-C, which is also what it is before any signal, and 143 after SIGTERM.
        alarmed_before: who has had the alarm before.
    """

    code = 128 + signal.SIGINT
    _came = _raises = _leaves_time = False
    _came_s, _last_s = 0.0, math.inf
    alarmed_before: Any = None

    def __init__(self) -> None:
        super().__init__()
        # What `threading.Event` holds while it waits and sets is not for a signal's handler, which
        # may come in the middle of it: it would wait for itself. This is.
        self._wakes: SimpleQueue[None] = SimpleQueue()

    @property
    def left_s(self) -> float:
        """How long all may take that is done yet: for ever, but after SIGTERM and SIGHUP.

        Whoever goes on after both, such as a notebook, has all the time again.
        """
        left_s = self._last_s - time.monotonic()
        return max(left_s, 0.0) if left_s > -END_S else math.inf

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
        self._came_s = time.monotonic()
        if number != signal.SIGINT and self._last_s == math.inf:
            self._last_s = self._came_s + LAST_S
        self.set()
        self.look()
        if self._raises or (self._leaves_time and again):
            self._raises = self._leaves_time = False
            raise CutShort(self.code)

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
        """What is worth some seconds after Ctrl-C: CutShort, once, where it is not over `LAST_S`
        after a SIGTERM, or at the next signal."""
        if threading.current_thread() is not threading.main_thread():
            yield  # signals are the main thread's
            return
        self._leaves_time = True
        try:
            self.look()
            yield
        finally:
            self._leaves_time = False

    def look(self) -> None:
        """Has the alarm ring after a signal; the main thread.

        While somebody else has it, nobody looks: whoever that is gives it back with this.
        """
        if self._came and signal.getsignal(signal.SIGALRM) == self.ring:
            first_s = ALARM_S
            if self._leaves_time and self._last_s < math.inf:
                first_s = max(min(self.left_s, ALARM_S), LEAST_WAIT_S)
            signal.setitimer(signal.ITIMER_REAL, first_s, ALARM_S)

    def ring(self, number: int, frame: FrameType | None) -> None:
        """The alarm's handler: ends what takes too long after a signal.

        CutShort where time is over, or a call does not return.
        """
        if not self._came:
            if callable(self.alarmed_before):
                self.alarmed_before(number, frame)
            return
        if time.monotonic() > self._last_s + END_S:
            _end_now("what should end takes too long", self.code)
        if self._leaves_time and self.left_s == 0.0:
            self._leaves_time = False
            raise CutShort(self.code)
        if self._leaves_time:
            self.look()  # just when time is over, and not a moment later
        for call in [call for call in calls if call.thread == threading.main_thread().ident]:
            if call.found_in(frame) is None:
                calls.remove(call)  # this alarm came when it was just over, or the one before did
            elif call.duration_s >= call.limit_s and self._may_end(call):
                if call.alarm() > MOST_ALARMS:
                    _end_now(f"{call.name} catches what shall end it", self.code)
                raise CutShort(self.code)

    def _may_end(self, call: OpenCall) -> bool:
        """Whether a signal has come in a call; after SIGTERM there is no time for others."""
        return call.begun_s <= self._came_s or self._last_s < math.inf


def _end_now(why: str, code: int) -> NoReturn:
    """Ends the process; takes no lock, which may be held by what is interrupted here."""
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    text = b"vsense: %s: the process ends\n" % why.encode("unicode_escape")
    for act in last_acts:
        act()
    # It may wait for ever for who should read it.
    _thread.start_new_thread(os.write, (2, text))
    time.sleep(LEAST_WAIT_S)
    os._exit(code)


_newest = Interruption()


def left_s() -> float:
    """How long this process may go on: for ever, but after SIGTERM or SIGHUP; any thread."""
    return _newest.left_s


def came() -> bool:
    """Whether a signal ends this process; any thread."""
    return _newest.is_set()


def look() -> None:
    """Gives the alarm back to the present `interruption`, if there is one; see there."""
    _newest.look()


def code() -> int:
    """The exit code of a command that a signal has ended; see `Interruption`."""
    return _newest.code


@contextmanager
def interruption() -> Iterator[Interruption]:
    """Gives an event that SIGINT, SIGTERM and SIGHUP set, instead of what they did before.

    SIGHUP is left alone where it is ignored: `nohup` did that. After a signal SIGALRM and its timer
    are this event's.
    """
    global _newest
    interrupted = _newest = Interruption()
    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    timer = signal.getitimer(signal.ITIMER_REAL)
    interrupted.alarmed_before = signal.signal(signal.SIGALRM, interrupted.ring)
    before = {number: signal.signal(number, interrupted.interrupt) for number in numbers}
    try:
        yield interrupted
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        # No signal sets it any more.
        if interrupted.is_set():
            signal.setitimer(signal.ITIMER_REAL, *timer)
        signal.signal(signal.SIGALRM, interrupted.alarmed_before)
