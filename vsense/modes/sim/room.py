"""The page of a simulation: takes its orders, and publishes what the simulation tells.

Nothing here moves a robot: there is no emergency stop. `vsense stop --emergency` does not find a
simulation, which would only stand between somebody and the robots that move.
"""

from __future__ import annotations

import itertools
import select
import shutil
import socket
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from vsense.base.clock import host_ns
from vsense.base.message_bus import Message, MessageBus
from vsense.base.terminal import Console
from vsense.config.specs import Experiment
from vsense.modes.sim.paced import ANSWER, TOLD
from vsense.modes.sim.pacing import FASTEST, SLOWEST
from vsense.monitor import recording
from vsense.monitor.recording.form import Data, RunMessage
from vsense.monitor.ui.access import FoxgloveAddress
from vsense.monitor.ui.foxglove_server import serve_foxglove
from vsense.monitor.ui.recorders import OFF
from vsense.monitor.ui.room import PageAccess, open_web
from vsense.run.changes import MOST_WAITING, Answer
from vsense.run.changing import Change
from vsense.run.control import State
from vsense.run.orders import Order, OrderError, OrderKind

_PERIOD_S = 0.5
"""`/run` is published this often, and when something changes."""

_PASSING = ("/event", TOLD)

ORDERS = {
    State.WAITING: (OrderKind.SPEED,),
    State.RUNNING: (
        *(OrderKind.PAUSE, OrderKind.STEP, OrderKind.SPEED, OrderKind.STOP),
        *(OrderKind.RESET, OrderKind.RECORD),
    ),
    State.PAUSED: (
        *(OrderKind.START, OrderKind.STEP, OrderKind.SPEED, OrderKind.STOP),
        *(OrderKind.RESET, OrderKind.RECORD),
    ),
    State.ENDED: (OrderKind.RESET, OrderKind.SPEED),
}
"""What makes sense in every state; there is no other state."""


class SimControl:
    """The orders of a simulation's page, whose state follows from them; all is for any thread.

    Args:
        send: sends an order to the simulation, see `vsense.modes.sim.paced`, and does not wait;
            OrderError where it does not listen.
        tell: takes a line for people.
        speed: at the beginning, times real time.
        holds: every run begins paused; those after a reset do anyway.
        locked: nobody may change the world.

    Attributes:
        run: its number, from 1.
        seed: of the run.
        by: who gave the last order.
        file: of the recording.
        next_asked: whether another run is wanted after this one.
    """

    def __init__(
        self,
        send: Callable[[int, str, Any], None],
        tell: Callable[[str], None],
        seed: int,
        speed: float = 1.0,
        holds: bool = False,
        locked: bool = False,
    ) -> None:
        self.state, self.run, self.seed, self.speed = State.WAITING, 1, seed, speed
        self.by: str | None = None
        self.file = Path()
        self.next_asked = False
        self._send, self._tell, self._holds, self._locked = send, tell, holds, locked
        self._lock = threading.RLock()

    @property
    def can(self) -> tuple[OrderKind, ...]:
        """The orders that make sense now."""
        return ORDERS[self.state]

    def give(self, order: Order) -> str:
        """Carries an order out; OrderError where it makes no sense; see `vsense.run.orders.Give`.

        UsageError for a recording without the library for it.
        """
        with self._lock:
            if order.kind == OrderKind.EMERGENCY:
                raise OrderError("no robot moves here: this is a simulation; pause or stop it")
            if order.kind not in self.can:
                raise OrderError(self._refusal(order.kind))
            text = self._obey(order)
            self.by = order.by
        self._tell(f"{order.by}: {text}")
        return text

    def begin(self) -> None:
        """A run begins: the simulation is told how."""
        with self._lock:
            self.state = State.PAUSED if self._holds else State.RUNNING
            self.next_asked = False
            self._send(self.run, "begin", (self.speed, not self._holds, self._locked))

    def end(self) -> None:
        """The run is over."""
        with self._lock:
            self.state = State.ENDED

    def next_run(self, seed: int) -> None:
        """Goes on to the run after this one, which a reset has asked for: it begins paused."""
        with self._lock:
            self.run, self.seed, self._holds, self.state = self.run + 1, seed, True, State.WAITING

    def stop(self) -> None:
        """Has the run end where it is; OrderError where it does not listen now."""
        self._send(self.run, "stop", 0)

    def _obey(self, order: Order) -> str:
        kind, value = order.kind, order.value
        if kind == OrderKind.SPEED:
            return self._set_speed(value)
        # The state follows once the order is sent: it may not be.
        if kind == OrderKind.START:
            self._send(self.run, "play", 1)
            self.state = State.RUNNING
            return f"run {self.run} goes on"
        if kind == OrderKind.PAUSE:
            self._send(self.run, "play", 0)
            self.state = State.PAUSED
            return f"run {self.run} is paused"
        if kind == OrderKind.STEP:
            self._send(self.run, "step", 1)
            self.state = State.PAUSED
            return "one timestep"
        if kind == OrderKind.RECORD:
            recording.require()
            self._send(self.run, "record", int(value != 0.0))
            return f"recording to {self.file}" if value else f"recording is off: {self.file}"
        return self._end(kind)

    def _end(self, kind: OrderKind) -> str:
        if self.state != State.ENDED:
            self.stop()
        if kind == OrderKind.STOP:
            return f"run {self.run} is stopped"
        self.next_asked = True
        return f"reset: run {self.run + 1} waits for a start"

    def _set_speed(self, value: float) -> str:
        speed = FASTEST if value == 0.0 else value
        if not speed >= SLOWEST:
            raise OrderError(f"speed: {value:g}, expected {SLOWEST:g} or more, or 0: no limit")
        if self.state in (State.RUNNING, State.PAUSED):
            self._send(self.run, "speed", speed)
        self.speed = speed
        return "as fast as it goes" if speed == FASTEST else f"{speed:g} times real time"

    def _refusal(self, kind: OrderKind) -> str:
        if kind in (OrderKind.PLAY, OrderKind.SEEK):
            return f"{kind.value}: only a replay can do that"
        return f"cannot {kind.value}: run {self.run} is {self.state.value}"


class SimRoom:
    """Serves the page of one process's simulations; a context that leaves no thread and no socket.

    Attributes:
        control: takes the orders.
        descriptor: the simulation's end of the socket.
    """

    def __init__(
        self,
        access: PageAccess,
        experiment: Experiment,
        control: dict[str, Any],
        console: Console,
        foxglove: FoxgloveAddress | None = None,
    ) -> None:
        """`control` has what begins a run, of `SimControl`; nothing is opened yet."""
        self.control = SimControl(self._send, console.say, **control)
        self.bus = MessageBus()
        self._access, self._experiment, self._console = access, experiment, console
        self._foxglove = foxglove
        self._stack, self._sending = ExitStack(), threading.Lock()
        self._asked: dict[int, Answer] = {}
        self._asking = threading.Lock()
        self._numbers = itertools.count()
        self._current: dict[str, Message] = {}
        self._told: dict[str, Any] = {}
        self._directory = Path()
        self._joined, self._due_s = -1, 0.0
        self._key: tuple[object, ...] = ()
        self._closing = False

    def __enter__(self) -> SimRoom:
        """Opens the page; VsenseError if it cannot be served."""
        server, lines = open_web(
            *(self._access, self.bus, self.control.give),
            *(lambda text: self._console.say(text, "warning"), self._ask),
        )
        self._stack.callback(server.close)
        for line in lines:
            self._console.whisper(line)
        serve_foxglove(self._stack, self.bus, self._foxglove, self._console)
        self._console.also = self._say
        ours, self._theirs = socket.socketpair()
        self._stack.callback(self._theirs.close)
        self._page, self.descriptor = Connection(ours.detach()), self._theirs.fileno()
        self._stack.callback(self._page.close)
        thread = threading.Thread(target=self._run, name="vsense-sim-page", daemon=True)
        self._stack.callback(thread.join)
        thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._closing = True
        self._console.also = lambda text, level: None
        self._stack.close()

    def begin_run(self, directory: Path) -> None:
        """A run begins, whose files go to `directory`."""
        self._directory, self._told, self._current = directory, {}, {}
        self.control.file = directory / f"{self._experiment.name}{recording.SUFFIX}"
        self._forget_asked()
        self._forget_sent()
        self.control.begin()

    def end_run(self) -> None:
        """The run is over: nothing is changed any more."""
        self.control.end()
        self._forget_asked()

    def _ask(self, change: Change, by: str, answer: Answer) -> None:
        """Has the simulation change its world, see `vsense.run.changes.Ask`."""
        with self._asking:
            if self.control.state not in (State.RUNNING, State.PAUSED):
                run, state = self.control.run, self.control.state.value
                raise OrderError(f"nothing can be changed: run {run} is {state}")
            if len(self._asked) >= MOST_WAITING:
                raise OrderError("too many changes wait for the next timestep: try again")
            number = next(self._numbers)
            # The answer may be there before `_send` returns.
            self._asked[number] = answer
            try:
                self._send(self.control.run, "change", (number, change, by))
            except OrderError:
                del self._asked[number]
                raise

    def _forget_asked(self) -> None:
        """Answers what a run that is over did not answer any more."""
        with self._asking:
            for number in list(self._asked):
                if answer := self._asked.pop(number, None):
                    answer("the run ended before it", False)

    def _forget_sent(self) -> None:
        """Takes back what a run before did not read: one that failed before its first order.

        Between two runs no process reads there, which may have ended in the middle of an order.
        """
        with suppress(BlockingIOError):
            while self._theirs.recv(1 << 16, socket.MSG_DONTWAIT):
                pass

    def _say(self, text: str, level: str) -> None:
        """Has pages see a line of the terminal, at the run's time."""
        time_s = self._told["time_s"] if self._told.get("timestep", -1) >= 0 else None
        self.bus.event(text, level, host_ns(), time_s)

    def _send(self, run: int, name: str, value: Any) -> None:
        """Sends an order and never waits: pages' thread and the run's end must go on."""
        with self._sending, suppress(OSError):
            # Writable: three quarters of the socket's buffer are free, and an order is far smaller.
            writable = select.poll()
            writable.register(self._page.fileno(), select.POLLOUT)
            if not writable.poll(0):
                raise OrderError("the simulation does not listen: try again")
            self._page.send((run, name, value))

    def _run(self) -> None:
        """The thread."""
        while not self._closing:
            try:
                if self._page.poll(0.1):
                    self._take(*self._page.recv())
            except (EOFError, OSError):
                return
            self._publish()

    def _take(self, run: int, topic: str, time_ns: int, data: Data) -> None:
        """Publishes a message of the present run."""
        if run != self.control.run:
            return
        # Pages have one clock, that of everything else they are told.
        message = Message(topic, host_ns(), data)
        if topic == TOLD:
            self._told = data
        elif topic == ANSWER:
            if answer := self._asked.pop(data["number"], None):
                answer(data["text"], data["ok"])
        elif topic == "/event" and not time_ns:
            self._console.say(data["text"], data["level"])
        else:
            if topic not in _PASSING:
                self._current[topic] = message
            self._tell(message)

    def _tell(self, message: Message) -> None:
        self.bus.publish(message)
        if message.topic == "/readings":
            self._tell_readings(message)

    def _tell_readings(self, message: Message) -> None:
        """Publishes the readings of those robots that somebody looks at."""
        for row, tag in enumerate(message.data["tag"]):
            topic = f"/readings/{tag}"
            if self.bus.wants(topic):
                one = {
                    name: column[row : row + 1] if isinstance(column, list) else column
                    for name, column in message.data.items()
                }
                self.bus.publish(Message(topic, message.time_ns, one))

    def _publish(self) -> None:
        """Publishes `/run`, and to newcomers everything that lasts."""
        control, now_s = self.control, time.monotonic()
        still = control.state != State.RUNNING and self._told.get("timestep")
        key = control.state, control.run, control.by, control.speed, self.bus.joined, still
        if self._joined != self.bus.joined:
            self._joined = self.bus.joined
            for message in list(self._current.values()):
                self._tell(message)
        if key != self._key or now_s >= self._due_s:
            self._key, self._due_s = key, now_s + _PERIOD_S
            self.bus.notify("/run", host_ns(), self._run_data)

    def _run_data(self) -> Data:
        """Gives /run, with what a simulation has beside it: "sim"."""
        control, told, experiment = self.control, self._told, self._experiment
        running = control.state == State.RUNNING
        rate_hz = told.get("rate_hz", 0.0) if running else 0.0
        try:
            free = shutil.disk_usage(self._directory).free
        except OSError:
            free = None
        data = RunMessage(
            state=control.state.value,
            run=control.run,
            by=control.by,
            can=[kind.value for kind in control.can],
            timestep=told.get("timestep", -1),
            time_s=told.get("time_s", 0.0),
            length_s=experiment.length_s or None,
            rate_hz=rate_hz,
            silent_s=0.0,
            text=self._console.newest,
            recording=told.get("recording") or dict(OFF),
            disk_free_bytes=free,
        ).data()
        speed = None if control.speed == FASTEST else control.speed
        sim = {"speed": speed, "reached": round(rate_hz * experiment.timestep_s, 2)}
        return {**data, "sim": sim}
