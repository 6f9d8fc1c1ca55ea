"""What a run shall do: people's orders, and the state that follows from them.

Page, terminal and keyboard give their orders to `Control.give`. `ORDER_TABLE` holds what every
order does in every state of a run with robots, `SIMULATION_TABLE` in those of a simulation. An
order that stops robots is obeyed at once, in the caller's thread; the run's own thread, which alone
starts them, learns of it afterwards.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

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


BEFORE_RUN = (State.WAITING, State.READY)
BETWEEN = (*BEFORE_RUN, State.ENDED)
"""In these states a robot can be put in for another."""
DURING = (State.RUNNING, State.PAUSED)
HOMING = (State.HOMING, State.HOMING_PAUSED)


@dataclass(frozen=True, slots=True)
class Move:
    """What an order does. Texts may name {run}, {following} (the next run's number) and {by}.

    Attributes:
        state, following: the new state, and whether the next run is wanted; None: as it is.
        commands: what the robots are sent at once; None: nothing.
        steps: a simulation does one timestep.
        asked: whether a start is wanted from now on.
        waits: the next run waits for a START.
        why: what ended the run; "": it has not ended, or had before.
    """

    says: str
    state: State | None = None
    commands: Wanted | None = None
    steps: bool = False
    asked: bool = False
    following: bool | None = None
    waits: bool = False
    why: str = ""


_HALTED = "EMERGENCY STOP: all robots must stand until a reset"
_RESET = "reset: run {following} waits for a start"

BEGIN = Move("run {run} starts", asked=True)
RESUME = Move("run {run} goes on", asked=True)
BEGIN_NEXT = Move("run {following} begins", asked=True, following=True)
PAUSE = Move("run {run} is paused", State.PAUSED, Wanted.PAUSE)
STAY_PAUSED = Move("run {run} stays paused")
WITHDRAW = Move("the start is withdrawn", following=False)
STOP = Move("run {run} is stopped", State.ENDED, Wanted.STOP, why="stopped by {by}")
SUSPEND = Move("run {run} is suspended: start resumes it, reset ends it", State.PAUSED, Wanted.STOP)
PAUSE_HOMING = Move("the robots rest on their way home", State.HOMING_PAUSED, Wanted.PAUSE)
RESUME_HOMING = Move("the robots drive on to their starts", asked=True)
STAY_RESTING = Move("the robots go on resting")
STOP_HOMING = Move(
    "run {run} is stopped on the way home", State.ENDED, Wanted.STOP, why="stopped by {by}"
)
RESET_RUN = Move(_RESET, State.ENDED, Wanted.STOP, following=True, waits=True, why="reset by {by}")
RESET_ENDED = Move(_RESET, State.ENDED, following=True, waits=True)
RESET_WAITING = Move("reset: run {run} waits for a start", State.WAITING, waits=True)
HALT = Move(_HALTED, State.EMERGENCY, Wanted.STOP, following=False)
HALT_RUN = replace(HALT, why="emergency stop by {by}")

ORDERABLE = (OrderKind.START, OrderKind.PAUSE, OrderKind.STOP, OrderKind.RESET, OrderKind.EMERGENCY)

OrderTable = Mapping[tuple[State, bool], tuple[Move | None, ...]]
"""What every order does, by state and whether a start was asked for; None: refused."""

ORDER_TABLE: OrderTable = {
    # state, asked            START       PAUSE         STOP      RESET        EMERGENCY
    (State.WAITING, False):   (BEGIN,      None,         None,     None,        HALT_RUN),
    (State.WAITING, True):    (None,       None,         WITHDRAW, None,        HALT_RUN),
    (State.READY, False):     (BEGIN,      None,         None,     None,        HALT_RUN),
    (State.READY, True):      (None,       None,         WITHDRAW, None,        HALT_RUN),
    (State.RUNNING, False):   (None,       PAUSE,        STOP,     RESET_RUN,   HALT_RUN),
    (State.PAUSED, False):    (RESUME,     None,         STOP,     RESET_RUN,   HALT_RUN),
    (State.PAUSED, True):     (None,       STAY_PAUSED,  STOP,     RESET_RUN,   HALT_RUN),
    (State.ENDED, False):     (BEGIN_NEXT, None,         None,     RESET_ENDED, HALT),
    (State.ENDED, True):      (None,       None,         WITHDRAW, RESET_ENDED, HALT),
    (State.HOMING, False):    (None,       PAUSE_HOMING, STOP_HOMING, RESET_RUN, HALT_RUN),
    (State.HOMING_PAUSED, False): (RESUME_HOMING, None,  STOP_HOMING, RESET_RUN, HALT_RUN),
    (State.HOMING_PAUSED, True):  (None,   STAY_RESTING, STOP_HOMING, RESET_RUN, HALT_RUN),
    (State.EMERGENCY, False): (None,       None,         None,     RESET_ENDED, HALT),
}  # fmt: skip
"""Where STOP only suspends a run, SUSPEND stands for STOP. In a run that has not begun
RESET_WAITING stands for RESET_ENDED."""

GO_ON = Move("run {run} goes on", State.RUNNING, Wanted.RUN)
STEP = Move("one timestep", State.PAUSED, steps=True)
CUT_SHORT = Move("run {run} is stopped", commands=Wanted.STOP)
CUT_FOR_NEXT = Move(_RESET, commands=Wanted.STOP, following=True, waits=True)

SIMULATION_TABLE: OrderTable = {
    # state, asked            START  PAUSE  STOP       RESET         EMERGENCY STEP
    (State.WAITING, False):   (None,  None,  None,      None,         None,     None),
    (State.RUNNING, False):   (None,  PAUSE, CUT_SHORT, CUT_FOR_NEXT, None,     STEP),
    (State.PAUSED, False):    (GO_ON, None,  CUT_SHORT, CUT_FOR_NEXT, None,     STEP),
    (State.ENDED, False):     (None,  None,  None,      RESET_ENDED,  None,     None),
}  # fmt: skip
"""Of a process that simulates, which says itself when a run has ended."""


class OrderRules(NamedTuple):
    """Which orders one kind of process knows.

    Attributes:
        refused: orders that never make sense, and why.
        kinds: whose moves stand in the columns of the table.
        valued: orders with a value, and in which states they make sense.
        slow: orders for which a disk may take its time: they must hold up no emergency stop.
    """

    refused: Mapping[OrderKind, str]
    kinds: tuple[OrderKind, ...] = ORDERABLE
    table: OrderTable = ORDER_TABLE
    valued: Mapping[OrderKind, Collection[State]] = {
        OrderKind.RECORD: tuple(State),
        OrderKind.REPLACE: BETWEEN,
    }
    slow: Collection[OrderKind] = (OrderKind.RECORD,)


def _only(who: str, *kinds: OrderKind) -> dict[OrderKind, str]:
    return {kind: f"{kind.value}: only a {who} can do that" for kind in kinds}


_NOT_HERE = {
    OrderKind.RECORD: "nothing is recorded here: start vsense with --record",
    OrderKind.REPLACE: "no robot can be replaced here",
}
_REPLAYED = _only("replay", OrderKind.PLAY, OrderKind.SEEK)
_SIMULATED = _only("replay", OrderKind.SPEED) | _only("simulation", OrderKind.STEP)

ROBOT_RULES = OrderRules(_REPLAYED | _SIMULATED)
TRACKING_RULES = OrderRules(
    {
        **ROBOT_RULES.refused,
        OrderKind.EMERGENCY: "vsense camera track moves no robot and can stop none: stop them where"
        " they are driven",
    }
)
SIMULATION_RULES = OrderRules(
    {
        **_REPLAYED,
        OrderKind.EMERGENCY: "no robot moves here: this is a simulation; pause or stop it",
        OrderKind.REPLACE: _NOT_HERE[OrderKind.REPLACE],
    },
    (*ORDERABLE, OrderKind.STEP),
    SIMULATION_TABLE,
    {OrderKind.RECORD: DURING, OrderKind.SPEED: (State.WAITING, *DURING, State.ENDED)},
    slow=(),
)


class Control:
    """The state of one run after the other. `give` and all attributes are for any thread.

    Args:
        command: sends all robots a command, from any thread.
        say: takes a line for people, from any thread.
        holds: a run whose robots are all there waits for a START.
        suspends: STOP only suspends the run, which START resumes; RESET ends it.
        record: switches the recording on or off; None: nothing can be recorded.
        replace: has a robot put in for another, by somebody; None: none can be.
        speed: has a simulation go so many times as fast as real time, 0: as fast as it goes.
        step: has a simulation do one timestep.
        rules: which orders there are.

    Attributes:
        run: its number, from 1.
        by: who gave the last order that was obeyed; None before the first.
        why: what ended the run: "time", or words.
        begun: whether the run is past its wait.
        next_asked: whether the next run is wanted.
    """

    def __init__(
        self,
        command: Callable[[Wanted], None],
        say: Callable[[str], None],
        holds: bool = False,
        suspends: bool = False,
        *,
        record: Callable[[bool], str] | None = None,
        replace: Callable[[tuple[int, int], str], str] | None = None,
        speed: Callable[[float], str] | None = None,
        step: Callable[[], None] = lambda: None,
        rules: OrderRules = ROBOT_RULES,
    ) -> None:
        self.state = State.WAITING
        self.run = 1
        self.by: str | None = None
        self.why = "interrupted"
        self._holds = holds
        self._step = step
        self._valued: dict[OrderKind, Callable[[Order], str]] = {}
        if record is not None:
            self._valued[OrderKind.RECORD] = lambda order: record(order.value != 0)
        if replace is not None:
            self._valued[OrderKind.REPLACE] = lambda order: replace(order.pair, order.by)
        if speed is not None:
            self._valued[OrderKind.SPEED] = lambda order: speed(order.value)
        self._command = command
        self._say = say
        self._suspends, self._rules = suspends, rules
        self.begun = self.next_asked = self._asked = self._waits = False
        self._lock = threading.RLock()

    def give(self, order: Order) -> str:
        """Carries an order out; see `vsense.run.orders.Give`.

        Raises:
            OrderError: it makes no sense now.
            VsenseError: the robots cannot be told.
        """
        kind = order.kind
        if kind in self._rules.refused:
            raise OrderError(self._rules.refused[kind])
        if kind in self._rules.slow:
            text = self._carry_out(order)
            self.by = order.by
        else:
            with self._lock:
                has_value = kind in self._rules.valued
                text = self._carry_out(order) if has_value else self._obey(order)
                self.by = order.by
        self._say(f"{order.by}: {text}")
        return text

    @property
    def can(self) -> tuple[OrderKind, ...]:
        """The orders that make sense now."""
        rules = self._rules
        with self._lock:
            state, moves = self.state, rules.table[self.state, self._asked]
        kinds = [kind for kind, move in zip(rules.kinds, moves) if move is not None]
        kinds += [k for k, states in rules.valued.items() if state in states and k in self._valued]
        return tuple(kind for kind in kinds if kind not in rules.refused)

    @property
    def holds(self) -> bool:
        """Whether the run waits for a START, once its robots are all there."""
        return self._holds or self._waits

    @property
    def asked(self) -> bool:
        """Whether an order wants the run to start, or to go on."""
        return self._asked and self.state in (*BEFORE_RUN, State.PAUSED, State.HOMING_PAUSED)

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

    def begin(self, start: Callable[[], object], paused: bool = False) -> bool:
        """Starts or resumes the run, unless an order has stopped it; says whether it did.

        `paused`: a simulation that begins stands still until a START.
        """
        with self._lock:
            self.begun = True
            if self.state not in (*BEFORE_RUN, State.PAUSED, State.HOMING):
                return False
            start()
            self.state = State.PAUSED if paused else State.RUNNING
            self._asked = self._waits = False
            return True

    def home(self, drive: Callable[[], object]) -> bool:
        """Has the robots drive home, or on, unless an order forbids it; says whether they do."""
        with self._lock:
            if self.state not in (*BEFORE_RUN, State.HOMING_PAUSED):
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
            if self.state in (*BEFORE_RUN, *DURING, *HOMING):
                self.state, self.why, self._asked = State.ENDED, why, False

    def drop_next(self) -> None:
        """The next run cannot begin: it has to be ordered again."""
        with self._lock:
            self.next_asked = self._asked = False

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
        if move.steps:
            self._step()
        names = {"run": self.run, "following": self.run + 1, "by": order.by}
        self.state = self.state if move.state is None else move.state
        self._asked = move.asked
        self.next_asked = self.next_asked if move.following is None else move.following
        self._waits |= move.waits
        self.why = move.why.format(**names) if move.why else self.why
        return move.says.format(**names)

    def _move(self, kind: OrderKind) -> Move | None:
        rules = self._rules
        move = rules.table[self.state, self._asked][rules.kinds.index(kind)]
        if move is STOP and self._suspends:
            return SUSPEND
        return RESET_WAITING if move is RESET_ENDED and not self.begun else move

    def _refusal(self, kind: OrderKind) -> str:
        """Says why an order makes no sense now."""
        if kind == OrderKind.START:
            if self._asked:
                return f"{self.by} has asked for it already"
            if self.state == State.EMERGENCY:
                return "after an emergency stop: reset first"
            if self.state in (*DURING, *HOMING):
                return f"run {self.run} is going on already"
        now = "not running" if self.state in BEFORE_RUN else self.state.value
        stopped = self.state == State.ENDED and self.why.startswith("stopped by ")
        who = f": {self.why}" if stopped else ""
        return f"cannot {kind.value}: run {self.run} is {now}{who}"

    def _carry_out(self, order: Order) -> str:
        """Carries out an order with a value."""
        kind = order.kind
        if kind not in self._valued:
            raise OrderError(_NOT_HERE[kind])
        if self.state in self._rules.valued[kind]:
            return self._valued[kind](order)
        if kind != OrderKind.REPLACE:
            raise OrderError(self._refusal(kind))
        raise OrderError(
            f"run {self.run} is {self.state.value}: robots are put in between runs only"
        )
