"""What people press, whether on the page, in a terminal or on the keyboard: one door for all.

What a run shall do: people's orders, and the state that follows from them.

An order that stops anything is obeyed at once, in the thread of whoever gave it; the thread that
lives the run finds out afterwards. Only that thread starts anything.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from vsense.errors import VsenseError
from vsense.link.robots.wire import Wanted


class OrderError(VsenseError):
    """An order that cannot be carried out now; one line that says why."""


class OrderKind(str, Enum):
    """What can be ordered. Of the last four a replay knows PLAY, SPEED and SEEK, a run RECORD."""

    START = "start"
    PAUSE = "pause"
    STOP = "stop"
    RESET = "reset"
    EMERGENCY = "emergency"
    RECORD = "record"
    PLAY = "play"
    SPEED = "speed"
    SEEK = "seek"


@dataclass(frozen=True, slots=True)
class Order:
    """One press of a button.

    Attributes:
        kind: which.
        by: who, for people: "viewer 2 (10.0.0.7)", "terminal", "keyboard".
        value: RECORD, PLAY: 1 on, 0 off; SPEED: times real time; SEEK: [s] since the beginning.
    """

    kind: OrderKind
    by: str
    value: float = 0.0


Give = Callable[[Order], str]
"""Carries an order out, from any thread and without waiting; gives one line that says what happens
now. Raises OrderError where it cannot be."""


class State(str, Enum):
    """How it stands with a run. READY waits for a START; the robots stand still in all but one."""

    WAITING = "waiting"
    READY = "ready"
    RUNNING = "running"
    PAUSED = "paused"
    ENDED = "ended"
    EMERGENCY = "emergency"


BEFORE = (State.WAITING, State.READY)
DURING = (State.RUNNING, State.PAUSED)


class Control:
    """The state of one run after the other. `give` and all attributes are for any thread.

    Attributes:
        state: of the present run.
        run: its number, from 1.
        by: who gave the last order that was obeyed; None before the first.
        why: what ended the run: "time", or words.
        record: has the recording switched on or off; None where nothing can be recorded.
    """

    def __init__(
        self,
        command: Callable[[Wanted], None],
        tell: Callable[[str], None],
        holds: bool = False,
        suspends: bool = False,
    ) -> None:
        """Begins before the first run.

        Args:
            command: tells all robots, from any thread.
            tell: takes a line for people, from any thread.
            holds: a run whose robots are all there waits for a START.
            suspends: STOP only suspends the run, which START resumes; RESET ends it.
        """
        self.state = State.WAITING
        self.run = 1
        self.by: str | None = None
        self.why = "interrupted"
        self._holds = holds
        self.record: Callable[[bool], str] | None = None
        self._command = command
        self._tell = tell
        self._suspends = suspends
        self._asked = self._next = self._begun = self._waits = False
        self._lock = threading.RLock()
        self._orders: dict[OrderKind, Callable[[Order], str]] = {
            OrderKind.START: self._start,
            OrderKind.PAUSE: self._pause,
            OrderKind.STOP: self._stop,
            OrderKind.RESET: self._reset,
            OrderKind.EMERGENCY: self._emergency,
            OrderKind.RECORD: self._record,
        }

    def give(self, order: Order) -> str:
        """Carries an order out; see `vsense.run.control.Give`.

        Raises:
            OrderError: it makes no sense now.
            VsenseError: the robots cannot be told.
        """
        obey = self._orders.get(order.kind)
        if obey is None:
            raise OrderError(f"{order.kind.value}: only a replay can do that")
        if order.kind == OrderKind.RECORD:
            # A disk may take its time: that must hold up no emergency stop.
            text = obey(order)
            self.by = order.by
        else:
            with self._lock:
                text = obey(order)
                self.by = order.by
        self._tell(f"{order.by}: {text}")
        return text

    @property
    def can(self) -> tuple[OrderKind, ...]:
        """The orders that make sense now."""
        found = {
            State.WAITING: (OrderKind.START,),
            State.READY: (OrderKind.START,),
            State.RUNNING: (OrderKind.PAUSE, OrderKind.STOP, OrderKind.RESET),
            State.PAUSED: (OrderKind.START, OrderKind.STOP, OrderKind.RESET),
            State.ENDED: (OrderKind.START, OrderKind.RESET),
            State.EMERGENCY: (OrderKind.RESET,),
        }[self.state]
        recording = () if self.record is None else (OrderKind.RECORD,)
        return (*found, OrderKind.EMERGENCY, *recording)

    @property
    def holds(self) -> bool:
        """Whether the run waits for a START, once its robots are all there."""
        return self._holds or self._waits

    @property
    def begun(self) -> bool:
        """Whether the run is past its wait."""
        return self._begun

    @property
    def asked(self) -> bool:
        """Whether somebody wants the run to start, or to go on."""
        return self._asked and self.state in (*BEFORE, State.PAUSED)

    @property
    def next_asked(self) -> bool:
        """Whether somebody wants the next run."""
        return self._next

    def ready(self) -> None:
        """All robots are there."""
        with self._lock:
            if self.state == State.WAITING:
                self.state = State.READY

    def begin(self, start: Callable[[], object]) -> bool:
        """Has the run started or resumed, unless somebody has stopped it meanwhile.

        Returns:
            Whether it was.
        """
        with self._lock:
            self._begun = True
            if self.state not in (*BEFORE, State.PAUSED):
                return False
            start()
            self.state, self._asked, self._waits = State.RUNNING, False, False
            return True

    def end(self, why: str) -> None:
        """The run has ended by itself."""
        with self._lock:
            if self.state in (*BEFORE, *DURING):
                self.state, self.why, self._asked = State.ENDED, why, False

    def next_run(self) -> None:
        """Goes back to before the start, of the run after this one."""
        with self._lock:
            self.run += 1
            if self.state != State.EMERGENCY:
                self.state = State.WAITING
            self.why, self._next, self._begun = "interrupted", False, False

    def _start(self, order: Order) -> str:
        if self.state == State.EMERGENCY:
            raise OrderError("after an emergency stop: reset first")
        if self.state == State.RUNNING:
            raise OrderError(f"run {self.run} is going on already")
        if self._asked:
            raise OrderError(f"{self.by} has asked for it already")
        self._asked = True
        if self.state == State.ENDED:
            self._next = True
            return f"run {self.run + 1} begins"
        return f"run {self.run} {'goes on' if self.state == State.PAUSED else 'starts'}"

    def _pause(self, order: Order) -> str:
        if self._asked and self.state == State.PAUSED:
            self._asked = False
            return f"run {self.run} stays paused"
        self._require(OrderKind.PAUSE, State.RUNNING)
        self._command(Wanted.PAUSE)
        self.state = State.PAUSED
        return f"run {self.run} is paused"

    def _stop(self, order: Order) -> str:
        if self._asked and self.state not in DURING:
            self._asked = self._next = False
            return "the start is withdrawn"
        self._require(OrderKind.STOP, *DURING)
        self._command(Wanted.STOP)
        if self._suspends:
            self.state, self._asked = State.PAUSED, False
            return f"run {self.run} is suspended: start resumes it, reset ends it"
        self.end(f"stopped by {order.by}")
        return f"run {self.run} is stopped"

    def _reset(self, order: Order) -> str:
        self._require(OrderKind.RESET, *DURING, State.ENDED, State.EMERGENCY)
        self._waits, self._asked = True, False
        if not self._begun:
            self.state = State.WAITING
            return f"reset: run {self.run} waits for a start"
        if self.state in DURING:
            self._command(Wanted.STOP)
            self.end(f"reset by {order.by}")
        self.state, self._next = State.ENDED, True
        return f"reset: run {self.run + 1} waits for a start"

    def _emergency(self, order: Order) -> str:
        self._command(Wanted.STOP)
        if self.state not in (State.ENDED, State.EMERGENCY):
            self.why = f"emergency stop by {order.by}"
        self.state, self._asked, self._next = State.EMERGENCY, False, False
        return "EMERGENCY STOP: all robots stand still until a reset"

    def _record(self, order: Order) -> str:
        if self.record is None:
            raise OrderError("nothing is recorded here: start vsense with --record")
        return self.record(order.value != 0)

    def _require(self, kind: OrderKind, *states: State) -> None:
        if self.state not in states:
            now = "not running" if self.state in BEFORE else self.state.value
            raise OrderError(f"cannot {kind.value}: run {self.run} is {now}")
