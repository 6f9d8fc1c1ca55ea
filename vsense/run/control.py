"""What a run shall do: people's orders, and the state that follows from them.

Page, terminal and keyboard give their orders to `Control.give`. `TABLE` holds what every order does
in every state. An order that stops anything is obeyed at once, in the caller's thread; the run's
own thread, which alone starts anything, finds out afterwards.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum

from vsense.robots.link.wire import Wanted
from vsense.run.orders import Order, OrderError, OrderKind


class State(str, Enum):
    """The state of a run. READY waits for a START; the robots move in RUNNING, and before that in
    HOMING, where they drive to their starts."""

    WAITING = "waiting"
    READY = "ready"
    RUNNING = "running"
    PAUSED = "paused"
    ENDED = "ended"
    EMERGENCY = "emergency"
    HOMING = "homing"
    HOMING_PAUSED = "homing paused"


BEFORE = (State.WAITING, State.READY)
BETWEEN = (*BEFORE, State.ENDED)
"""In these states a robot can be put in for another."""
DURING = (State.RUNNING, State.PAUSED)
HOMING = (State.HOMING, State.HOMING_PAUSED)


@dataclass(frozen=True, slots=True)
class Move:
    """What an order does. Texts may name {run}, {following} (the next run's number) and {by}.

    Attributes:
        state, following: the new state, and whether the next run is wanted; None: as it is.
        commands: what the robots are sent at once; None: nothing.
        asked: whether a start is wanted from now on.
        waits: the next run waits for a START.
        why: what ended the run; "": it has not ended, or had before.
    """

    says: str
    state: State | None = None
    commands: Wanted | None = None
    asked: bool = False
    following: bool | None = None
    waits: bool = False
    why: str = ""


_HALTED = "EMERGENCY STOP: all robots stand still until a reset"
_RESET = "reset: run {following} waits for a start"

BEGIN = Move("run {run} starts", asked=True)
RESUME = Move("run {run} goes on", asked=True)
FOLLOW = Move("run {following} begins", asked=True, following=True)
PAUSE = Move("run {run} is paused", State.PAUSED, Wanted.PAUSE)
STAY = Move("run {run} stays paused")
DROP = Move("the start is withdrawn", following=False)
STOP = Move("run {run} is stopped", State.ENDED, Wanted.STOP, why="stopped by {by}")
SUSPEND = Move("run {run} is suspended: start resumes it, reset ends it", State.PAUSED, Wanted.STOP)
REST = Move("the robots rest on their way home", State.HOMING_PAUSED, Wanted.PAUSE)
DRIVE = Move("the robots drive on to their starts", asked=True)
ABIDE = Move("the robots go on resting")
LEAVE = Move(
    "run {run} is stopped on the way home", State.ENDED, Wanted.STOP, why="stopped by {by}"
)
BREAK = Move(_RESET, State.ENDED, Wanted.STOP, following=True, waits=True, why="reset by {by}")
RENEW = Move(_RESET, State.ENDED, following=True, waits=True)
AGAIN = Move("reset: run {run} waits for a start", State.WAITING, waits=True)
HALT = Move(_HALTED, State.EMERGENCY, Wanted.STOP, following=False)
CUT = replace(HALT, why="emergency stop by {by}")

ORDERS = (OrderKind.START, OrderKind.PAUSE, OrderKind.STOP, OrderKind.RESET, OrderKind.EMERGENCY)

TABLE: Mapping[tuple[State, bool], tuple[Move | None, ...]] = {
    # state, asked            START   PAUSE  STOP  RESET  EMERGENCY
    (State.WAITING, False):   (BEGIN,  None,  None, None,  CUT),
    (State.WAITING, True):    (None,   None,  DROP, None,  CUT),
    (State.READY, False):     (BEGIN,  None,  None, None,  CUT),
    (State.READY, True):      (None,   None,  DROP, None,  CUT),
    (State.RUNNING, False):   (None,   PAUSE, STOP, BREAK, CUT),
    (State.PAUSED, False):    (RESUME, None,  STOP, BREAK, CUT),
    (State.PAUSED, True):     (None,   STAY,  STOP, BREAK, CUT),
    (State.ENDED, False):     (FOLLOW, None,  None, RENEW, HALT),
    (State.ENDED, True):      (None,   None,  DROP, RENEW, HALT),
    (State.HOMING, False):    (None,   REST,  LEAVE, BREAK, CUT),
    (State.HOMING_PAUSED, False): (DRIVE, None, LEAVE, BREAK, CUT),
    (State.HOMING_PAUSED, True):  (None, ABIDE, LEAVE, BREAK, CUT),
    (State.EMERGENCY, False): (None,   None,  None, RENEW, HALT),
}  # fmt: skip
"""What every order does, by state and whether a start was asked for; None: refused.

Where STOP only suspends a run, SUSPEND stands for STOP. In a run that has not begun AGAIN stands
for RENEW.
"""


class Control:
    """The state of one run after the other. `give` and all attributes are for any thread.

    Args:
        command: sends all robots a command, from any thread.
        tell: takes a line for people, from any thread.
        holds: a run whose robots are all there waits for a START.
        suspends: STOP only suspends the run, which START resumes; RESET ends it.

    Attributes:
        run: its number, from 1.
        by: who gave the last order that was obeyed; None before the first.
        why: what ended the run: "time", or words.
        begun: whether the run is past its wait.
        next_asked: whether the next run is wanted.
        record: switches the recording on or off; None where nothing can be recorded.
        replace: has a robot put in for another, by somebody; None where none can be.
    """

    def __init__(
        self,
        command: Callable[[Wanted], None],
        tell: Callable[[str], None],
        holds: bool = False,
        suspends: bool = False,
    ) -> None:
        self.state = State.WAITING
        self.run = 1
        self.by: str | None = None
        self.why = "interrupted"
        self._holds = holds
        self.record: Callable[[bool], str] | None = None
        self.replace: Callable[[tuple[int, int], str], str] | None = None
        self._command = command
        self._tell = tell
        self._suspends = suspends
        self.begun = self.next_asked = self._asked = self._waits = False
        self._lock = threading.RLock()

    def give(self, order: Order) -> str:
        """Carries an order out; see `vsense.run.orders.Give`.

        Raises:
            OrderError: it makes no sense now.
            VsenseError: the robots cannot be told.
        """
        if order.kind == OrderKind.RECORD:
            # A disk may take its time: that must hold up no emergency stop.
            text = self._record(order)
            self.by = order.by
        else:
            with self._lock:
                is_cast = order.kind == OrderKind.REPLACE
                text = self._replace(order) if is_cast else self._obey(order)
                self.by = order.by
        self._tell(f"{order.by}: {text}")
        return text

    @property
    def can(self) -> tuple[OrderKind, ...]:
        """The orders that make sense now."""
        with self._lock:
            moves, between = TABLE[self.state, self._asked], self.state in BETWEEN
        found = [kind for kind, move in zip(ORDERS, moves) if move is not None]
        found += [OrderKind.RECORD] if self.record is not None else []
        found += [OrderKind.REPLACE] if self.replace is not None and between else []
        return tuple(found)

    @property
    def holds(self) -> bool:
        """Whether the run waits for a START, once its robots are all there."""
        return self._holds or self._waits

    @property
    def asked(self) -> bool:
        """Whether an order wants the run to start, or to go on."""
        return self._asked and self.state in (*BEFORE, State.PAUSED, State.HOMING_PAUSED)

    def ready(self) -> None:
        """All robots are there."""
        with self._lock:
            if self.state == State.WAITING:
                self.state = State.READY

    def wait_again(self) -> None:
        """Somebody else has to come before all are there."""
        with self._lock:
            if self.state == State.READY:
                self.state = State.WAITING

    def begin(self, start: Callable[[], object]) -> bool:
        """Starts or resumes the run, unless an order has stopped it; says whether it did."""
        with self._lock:
            self.begun = True
            if self.state not in (*BEFORE, State.PAUSED, State.HOMING):
                return False
            start()
            self.state, self._asked, self._waits = State.RUNNING, False, False
            return True

    def home(self, drive: Callable[[], object]) -> bool:
        """Has the robots drive home, or on, unless an order forbids it; says whether they do."""
        with self._lock:
            if self.state not in (*BEFORE, State.HOMING_PAUSED):
                return False
            drive()
            self.state, self._asked = State.HOMING, False
            return True

    def arrive(self, stand: Callable[[], object]) -> bool:
        """Has the robots stand at their starts, unless an order was faster; says whether."""
        with self._lock:
            if self.state == State.HOMING:
                stand()
            return self.state == State.HOMING

    def end(self, why: str) -> None:
        """The run has ended by itself."""
        with self._lock:
            if self.state in (*BEFORE, *DURING, *HOMING):
                self.state, self.why, self._asked = State.ENDED, why, False

    def next_run(self) -> None:
        """Goes back to before the start, of the run after this one."""
        with self._lock:
            self.run += 1
            if self.state != State.EMERGENCY:
                self.state = State.WAITING
            self.why, self.next_asked, self.begun = "interrupted", False, False

    def _obey(self, order: Order) -> str:
        """Does what the table says."""
        move = self._move(order.kind)
        if move is None:
            raise OrderError(self._refusal(order.kind))
        if move.commands is not None:
            self._command(move.commands)
        names = {"run": self.run, "following": self.run + 1, "by": order.by}
        self.state = self.state if move.state is None else move.state
        self._asked = move.asked
        self.next_asked = self.next_asked if move.following is None else move.following
        self._waits |= move.waits
        self.why = move.why.format(**names) if move.why else self.why
        return move.says.format(**names)

    def _move(self, kind: OrderKind) -> Move | None:
        if kind not in ORDERS:
            who = "simulation" if kind == OrderKind.STEP else "replay"
            raise OrderError(f"{kind.value}: only a {who} can do that")
        move = TABLE[self.state, self._asked][ORDERS.index(kind)]
        if move is STOP and self._suspends:
            return SUSPEND
        return AGAIN if move is RENEW and not self.begun else move

    def _refusal(self, kind: OrderKind) -> str:
        """Says why an order makes no sense now."""
        if kind == OrderKind.START:
            if self._asked:
                return f"{self.by} has asked for it already"
            if self.state == State.EMERGENCY:
                return "after an emergency stop: reset first"
            return f"run {self.run} is going on already"
        now = "not running" if self.state in BEFORE else self.state.value
        stopped = self.state == State.ENDED and self.why.startswith("stopped by ")
        who = f": {self.why}" if stopped else ""
        return f"cannot {kind.value}: run {self.run} is {now}{who}"

    def _replace(self, order: Order) -> str:
        if self.replace is None:
            raise OrderError("nobody can be put in for a robot here")
        if self.state not in BETWEEN:
            raise OrderError(
                f"run {self.run} is {self.state.value}: robots are put in between runs only"
            )
        return self.replace(order.pair, order.by)

    def _record(self, order: Order) -> str:
        if self.record is None:
            raise OrderError("nothing is recorded here: start vsense with --record")
        return self.record(order.value != 0)
