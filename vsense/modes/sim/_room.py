"""The page of a simulation: takes orders, publishes what the simulation tells, and does its runs.

Nothing here moves a robot: there is no emergency stop. `vsense control stop --emergency` does not
find a simulation, which would only stand between somebody and the robots that move.
"""

from __future__ import annotations

import itertools
import select
import socket
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from vsense.base.clock import host_ns
from vsense.base.errors import Interrupted, VsenseError
from vsense.base.interruption import left_s
from vsense.base.message_bus import Message
from vsense.config.specs import Experiment
from vsense.modes.sim._paced import ANSWER, SLOWEST, TOLD, UNLIMITED_SPEED
from vsense.modes.sim.outcome import Task
from vsense.modes.sim.watch import CHECK_PERIOD_S, Show, WorkerProcess, watch
from vsense.monitor import recording
from vsense.monitor.recording.form import Data, RunMessage
from vsense.monitor.ui.recorders import OFF
from vsense.monitor.ui.room import ControlRoom, RoomCallbacks
from vsense.robots.link.wire import Wanted
from vsense.run.changes import MOST_WAITING, ResultCallback
from vsense.run.changing import Change
from vsense.run.control import DURING, SIMULATION_RULES, Control, State
from vsense.run.orders import OrderError

_PERIOD_S = 0.5
"""`/run` is published this often, and when something changes."""

_PASSING = ("/event", TOLD)

_SENT = {Wanted.RUN: ("play", 1), Wanted.PAUSE: ("play", 0), Wanted.STOP: ("stop", 0)}
"""What the simulation is sent where robots would be commanded."""


class SimRoom:
    """Steers one process's simulations; a context that leaves no thread and no socket.

    Args:
        room: where they are shown; opens with this.
        seed: of the first run.
        speed: at the beginning, times real time.

    Attributes:
        bus: of the room.
        control: the state of the runs; takes orders.
        seed, speed: of the run.
        descriptor: the simulation's end of the socket.
    """

    def __init__(
        self, room: ControlRoom, experiment: Experiment, seed: int, speed: float = 1.0
    ) -> None:
        self._room, self._experiment, self.bus = room, experiment, room.bus
        self.seed, self.speed = seed, speed
        self.control = Control(
            lambda wanted: self._send(*_SENT[wanted]),
            room.console.say,
            room.holds,
            record=self._record,
            speed=self._set_speed,
            step=lambda: self._send("step", 1),
            rules=SIMULATION_RULES,
        )
        self._stack, self._sending = ExitStack(), threading.Lock()
        self._asked: dict[int, ResultCallback] = {}
        self._asking = threading.Lock()
        self._numbers = itertools.count()
        self._current: dict[str, Message] = {}
        self._reported: dict[str, Any] = {}
        self._file = Path()
        self._joined, self._due_s = -1, 0.0
        self._key: tuple[object, ...] = ()
        self._closing = False

    def __enter__(self) -> SimRoom:
        """Opens the room; VsenseError if it cannot be served."""
        self._room.open(
            RoomCallbacks(self.control.give, ask=self._ask, time_s=lambda: self._time_s)
        )
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
        self._stack.close()

    def begin_run(self, directory: Path) -> None:
        """A run begins, whose files go to `directory`."""
        self._room.keep_in(directory)
        self._reported, self._current = {}, {}
        self._file = directory / f"{self._experiment.name}{recording.MCAP}"
        self._forget_asked()
        self._forget_sent()
        holds, locked = self.control.holds, self._room.locked
        # The speed that counts is that of this moment: the control's lock is held.
        begin = lambda: self._send("begin", (self.speed, not holds, locked))  # noqa: E731
        self.control.begin(begin, paused=holds)

    def end_run(self) -> None:
        """The run is over: nothing is changed any more."""
        self.control.end("")
        self._forget_asked()

    def next_run(self, seed: int) -> None:
        """Goes on to the run after this one, which a reset has asked for: it begins paused."""
        self.seed = seed
        self.control.next_run()

    def stop(self) -> None:
        """Has the run end where it is; OrderError where it does not listen now."""
        self._send("stop", 0)

    def _record(self, on: bool) -> str:
        """Has the simulation record or not; UsageError without the library for it."""
        recording.require()
        self._send("record", int(on))
        return f"recording to {self._file}" if on else f"recording is off: {self._file}"

    def _set_speed(self, value: float) -> str:
        speed = UNLIMITED_SPEED if value == 0.0 else value
        if not speed >= SLOWEST:
            raise OrderError(f"speed: {value:g}, expected {SLOWEST:g} or more, or 0: no limit")
        if self.control.state in DURING:
            self._send("speed", speed)
        self.speed = speed
        return "as fast as it goes" if speed == UNLIMITED_SPEED else f"{speed:g} times real time"

    def _ask(self, change: Change, by: str, answer: ResultCallback) -> None:
        """Has the simulation change its world, see `vsense.run.changes.Ask`."""
        with self._asking:
            if self.control.state not in DURING:
                run, state = self.control.run, self.control.state.value
                raise OrderError(f"nothing can be changed: run {run} is {state}")
            if len(self._asked) >= MOST_WAITING:
                raise OrderError("too many changes wait for the next timestep: try again")
            number = next(self._numbers)
            # The answer may be there before `_send` returns.
            self._asked[number] = answer
            try:
                self._send("change", (number, change, by))
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

    @property
    def _time_s(self) -> float | None:
        data = self._reported
        return data["time_s"] if data.get("timestep", -1) >= 0 else None

    def _send(self, name: str, value: Any) -> None:
        """Sends an order and never waits: pages' thread and the run's end must go on."""
        with self._sending, suppress(OSError):
            # Writable: three quarters of the socket's buffer are free, and an order is far smaller.
            writable = select.poll()
            writable.register(self._page.fileno(), select.POLLOUT)
            if not writable.poll(0):
                raise OrderError("the simulation does not listen: try again")
            self._page.send((self.control.run, name, value))

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
            self._reported = data
        elif topic == ANSWER:
            if answer := self._asked.pop(data["number"], None):
                answer(data["text"], data["ok"])
        elif topic == "/event" and not time_ns:
            self._room.console.say(data["text"], data["level"])
        else:
            if topic not in _PASSING:
                self._current[topic] = message
            self._publish_message(message)

    def _publish_message(self, message: Message) -> None:
        self.bus.publish(message)
        if message.topic == "/readings":
            self._tell_readings(message)

    def _tell_readings(self, message: Message) -> None:
        """Publishes the readings of those robots that somebody looks at."""
        for row, tag in enumerate(message.data["tag"]):
            topic = f"/readings/{tag}"
            if self.bus.wants(topic):
                columns = {
                    name: column[row : row + 1] if isinstance(column, list) else column
                    for name, column in message.data.items()
                }
                self.bus.publish(Message(topic, message.time_ns, columns))

    def _publish(self) -> None:
        """Publishes `/run`, and to newcomers everything that lasts."""
        control, now_s = self.control, time.monotonic()
        still = control.state != State.RUNNING and self._reported.get("timestep")
        key = control.state, control.run, control.by, self.speed, self.bus.joined, still
        if self._joined != self.bus.joined:
            self._joined = self.bus.joined
            for message in list(self._current.values()):
                self._publish_message(message)
        if key != self._key or now_s >= self._due_s:
            self._key, self._due_s = key, now_s + _PERIOD_S
            self.bus.notify("/run", host_ns(), self._run_data)

    def _run_data(self) -> Data:
        """Gives /run, with what a simulation has beside it: "sim"."""
        control, reported, experiment = self.control, self._reported, self._experiment
        running = control.state == State.RUNNING
        rate_hz = reported.get("rate_hz", 0.0) if running else 0.0
        data = RunMessage(
            state=control.state.value,
            run=control.run,
            by=control.by,
            can=[kind.value for kind in control.can],
            timestep=reported.get("timestep", -1),
            time_s=reported.get("time_s", 0.0),
            length_s=experiment.length_s or None,
            rate_hz=rate_hz,
            silent_s=0.0,
            **self._room.run_data()
            | {"runs": None, "recording": reported.get("recording") or dict(OFF)},
        ).data()
        speed = None if self.speed == UNLIMITED_SPEED else self.speed
        sim = {"speed": speed, "reached": round(rate_hz * experiment.timestep_s, 2)}
        return {**data, "sim": sim}


SAVE_TIMEOUT_S = 10.0
"""A run that shall end may take so long for its files."""


class WatchedRuns:
    """Carries out the runs of a room; a context that leaves no process behind.

    Attributes:
        cut: whether the newest run was ended by `interrupted`.
        failure: of the newest run; None: it has not failed.
    """

    def __init__(self, room: SimRoom, interrupted: threading.Event) -> None:
        self._room, self._interrupted = room, interrupted
        self._worker: WorkerProcess[Task] | None = None
        self._stack = ExitStack()
        self._asked_s: float | None = None
        self._stopped = False
        self.cut = False
        self.failure: VsenseError | None = None

    def __enter__(self) -> WatchedRuns:
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def run(self, task: Task, show: Show) -> dict[str, Any]:
        """Does a run; a signal ends it where it is, with all that there was of it.

        `show` is called now and then with the processes, as of `simulate_all`.

        Raises:
            Interrupted: it was ended by a signal, and did not come to its end.
            VsenseError: it has failed.
        """
        worker = self._ready()
        self._asked_s, self._stopped, self.failure = None, False, None
        try:
            jobs = [(task, task.job.to_line())]
            ((_, answer),) = watch(jobs, [worker], self, show)
            result = task.result(answer)
        except (Interrupted, VsenseError) as error:
            self.failure = error if isinstance(error, VsenseError) else None
            if not worker.is_free:
                self._drop()
            raise
        finally:
            self.cut = self._asked_s is not None
        return result

    def is_set(self) -> bool:
        """Whether the run has to end at once: some time after a signal has asked it to end."""
        if not self._interrupted.is_set():
            return False
        if self._asked_s is None:
            self._asked_s = time.monotonic()
        if not self._stopped:
            with suppress(OrderError):  # it may listen when this is called again
                self._room.stop()
                self._stopped = True
        return time.monotonic() - self._asked_s > SAVE_TIMEOUT_S or left_s() == 0.0

    def rest(self, idle: Callable[[], None]) -> bool:
        """Waits after a run until another one is wanted; False where a signal ends everything.

        `idle` is called now and then.
        """
        while not self._room.control.next_asked:
            if self._interrupted.wait(CHECK_PERIOD_S):
                return False
            idle()
        return not self._interrupted.is_set()

    def _ready(self) -> WorkerProcess[Task]:
        """The process for the next run."""
        if self._worker is None:
            self._worker = WorkerProcess[Task](self._room.descriptor)
            self._stack.callback(self._worker.close)
        return self._worker

    def _drop(self) -> None:
        """Ends a process that hangs, or has ended."""
        self._stack.close()
        self._worker = None
