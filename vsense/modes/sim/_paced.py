"""The simulation's end of a page: obeys its orders between timesteps, and tells it what is new.

Both ends share a socket, which lives longer than one run: every tuple begins with the run's number.
From the page come (run, name, value):

    begin    the value says how it begins: (speed, playing, locked)
    play     1 on, 0 off
    step     so many timesteps
    speed    times real time
    record   1 on, 0 off
    stop     the run is over here
    change   of the world: (number, Change, by whom), which `ANSWER` answers

To the page go (run, topic, time_ns, data), the messages of `SimPublisher`, `TOLD` and `ANSWER`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from vsense.base.message_bus import Message, MessageBus
from vsense.modes.sim._publishing import SimPublisher, SimState
from vsense.modes.sim._simulation import WARM_UP_TIMESTEPS, Simulation
from vsense.monitor.recording.form import Data
from vsense.run.changes import Changes
from vsense.run.changing import Change
from vsense.run.orders import OrderError

TOLD = "/sim"
"""Where the run is: `timestep`, `time_s`, `rate_hz` in the last second, `recording`."""

ANSWER = "/answer"
"""What became of a change: its `number`, `text`, `ok`."""

_NOT_SENT = ("/run", "/cameras")
"""The page's own end tells these."""

_RATE_S = 1.0


SLOWEST = 0.1
"""Times real time."""
UNLIMITED_SPEED = math.inf
"""As fast as it goes."""

FRAME_S = 0.05
"""The page is told the state of the run this often at most."""

_SHARE = 0.5
"""Of what was measured, how much a new stretch's rate counts."""


class SimPace:
    """Says how many timesteps may follow at a time; times [s] are of any steady clock.

    A simulation that cannot keep the speed does not catch up.

    Attributes:
        speed: times real time.
        playing: whether it goes on by itself.
    """

    def __init__(self, timestep_s: float, speed: float = 1.0, playing: bool = True) -> None:
        self.speed, self.playing = speed, playing
        self._timestep_s = timestep_s
        self._steps = 0
        self._due_s: float | None = None
        self._begun_s, self._from = 0.0, -1
        self._rate_hz = 0.0

    def play(self, on: bool) -> None:
        """Goes on by itself, or waits; single steps that were asked for are forgotten."""
        self.playing, self._steps, self._due_s = on, 0, None

    def step(self, count: int = 1) -> None:
        """Pauses, and lets so many more timesteps happen."""
        self.playing, self._due_s = False, None
        self._steps += count

    def set_speed(self, speed: float) -> None:
        """Goes on at so many times real time."""
        self.speed, self._due_s = speed, None

    def grant(self, timestep: int, now_s: float) -> tuple[int, float | None]:
        """How many timesteps may follow now, from this one on; where that is 0, how long to wait.

        None: until something is ordered.
        """
        self._measure(timestep, now_s)
        if self._steps:
            self._steps -= 1
            return 1, None
        if not self.playing:
            return 0, None
        count, wait_s = self._due(now_s)
        if count:
            self._begun_s, self._from = now_s, timestep
        return count, wait_s

    def _due(self, now_s: float) -> tuple[int, float | None]:
        """What `grant` gives while it plays."""
        most = max(int(self._rate_hz * FRAME_S), 1)
        if math.isinf(self.speed):
            return most, None
        period_s = self._timestep_s / self.speed
        if self._due_s is None or now_s - self._due_s > 4.0 * max(period_s, FRAME_S):
            self._due_s = now_s
        if now_s < self._due_s:
            # Those of a frame are made together: nobody sees them one by one.
            return 0, max(self._due_s - now_s, min(FRAME_S, period_s))
        count = min(math.floor((now_s - self._due_s) / period_s) + 1, most)
        self._due_s += count * period_s
        return count, None

    def _measure(self, timestep: int, now_s: float) -> None:
        """Takes the time that the last stretch took."""
        begun_s, first, self._from = self._begun_s, self._from, -1
        if 0 <= first < timestep and now_s > begun_s:
            rate_hz = (timestep - first) / (now_s - begun_s)
            weight = _SHARE if self._rate_hz else 1.0
            self._rate_hz += (rate_hz - self._rate_hz) * weight


class PacedRun:
    """Lets a simulation go on as the page says; `gate` is its `Simulation.gate`.

    Args:
        connection: the page's socket.
        simulation: is paced.
        record: switches the recording on or off; gives words for people, "" where it worked.
        recording: gives the "recording" of `/run`.

    Attributes:
        changes: of the world, by people.
    """

    def __init__(
        self,
        connection: Connection,
        simulation: Simulation,
        blind: bool,
        record: Callable[[bool], str],
        recording: Callable[[], Data | None],
    ) -> None:
        """Waits for the page to begin the run; EOFError if the page has gone."""
        self._page, self._simulation = connection, simulation
        self._record, self._recording = record, recording
        self._timestep_s = simulation.environment.experiment.timestep_s
        self.run, speed, playing, locked = self._begin()
        self._pace = SimPace(self._timestep_s, speed, playing)
        self._stopped, self._shown, self._frame_s = False, -2, 0.0
        self._rate_hz, self._rated = 0.0, (time.monotonic(), 0)
        bus = MessageBus()
        bus.join(self._send, lambda topic: topic not in _NOT_SENT)
        self.changes = Changes(self.say, locked, simulation.ground)
        state = SimState(run=self.run)
        self._publisher = SimPublisher(bus, simulation, blind, state, changes=self.changes)

    def gate(self, run_timestep: int) -> int:
        """How many timesteps may follow; waits. Here, between two timesteps, orders are obeyed."""
        while True:
            while self._page.poll():
                self._obey(*self._heard())
            self._change(run_timestep)
            if self._stopped:
                # A run has a timestep at least.
                return int(run_timestep == 0)
            count, wait_s = self._pace.grant(run_timestep, time.monotonic())
            # What stands still is shown as it is.
            stands = wait_s is None and not count
            if stands or time.monotonic() - self._frame_s >= FRAME_S:
                self._show(run_timestep - 1)
            if stands:
                self._publisher.publish_history()
            if count:
                return count
            self._page.poll(wait_s)

    def end(self) -> None:
        """Shows the last timestep of the run, which is over."""
        self._show(len(self._simulation.record.timesteps) - 1)
        self._publisher.publish_history()

    def note(self, run_timestep: int) -> None:
        """Keeps the measures of a timestep: the page sees a few of those of a fast run."""
        self._publisher.keep(run_timestep)

    def say(self, text: str, level: str = "info") -> None:
        """Tells the page something for people."""
        self._send(Message("/event", 0, {"text": text, "level": level, "by": None}))

    def _begin(self) -> tuple[int, float, bool, bool]:
        """The first order: what was meant for the run before this one is left out."""
        while True:
            run, name, value = self._page.recv()
            if name == "begin":
                return run, *value

    def _heard(self) -> tuple[int, str, Any]:
        try:
            run, name, value = self._page.recv()
        except EOFError:
            return self.run, "stop", 0.0
        return run, name, value

    def _obey(self, run: int, name: str, value: Any) -> None:
        """Carries out an order of this run; everything between two timesteps is here."""
        if run != self.run:
            return
        if name == "play":
            self._pace.play(value != 0.0)
        elif name == "step":
            self._pace.step(int(value))
        elif name == "speed":
            self._pace.set_speed(value)
        elif name == "stop":
            self._stopped = True
        elif name == "change":
            self._ask(*value)
        elif name == "record":
            if trouble := self._record(value != 0.0):
                self.say(trouble, "trouble")
            self._shown = -2

    def _ask(self, number: int, change: Change, by: str) -> None:
        """Takes a change of the world, and answers when it is carried out or refused."""

        def answer(text: str, ok: bool) -> None:
            self._send(Message(ANSWER, 0, {"number": number, "text": text, "ok": ok}))

        try:
            self.changes.ask(change, by, answer)
        except OrderError as error:
            answer(str(error), False)

    def _change(self, run_timestep: int) -> None:
        """Carries out what people want changed before a timestep; they see it at once."""
        version, environment = self.changes.version, self._simulation.environment
        self.changes.carry_out(environment, WARM_UP_TIMESTEPS + run_timestep, run_timestep)
        if self.changes.version != version:
            self._shown = -2

    def _show(self, run_timestep: int) -> None:
        """Tells the page a timestep of the run, -1 before the first, unless it was told already."""
        if run_timestep == self._shown:
            return
        self._shown, self._frame_s = run_timestep, time.monotonic()
        self._rate(run_timestep)
        self._publisher.observe(run_timestep)
        data: dict[str, Any] = {
            "timestep": run_timestep,
            "time_s": round(max(run_timestep, 0) * self._timestep_s, 9),
            "rate_hz": self._rate_hz,
            "recording": self._recording(),
        }
        self._send(Message(TOLD, 0, data))

    def _rate(self, run_timestep: int) -> None:
        """Measures how fast it goes."""
        (then_s, first), now_s = self._rated, time.monotonic()
        if now_s - then_s >= _RATE_S:
            self._rate_hz = round((run_timestep - first) / (now_s - then_s), 2)
            self._rated = now_s, run_timestep

    def _send(self, message: Message) -> None:
        try:
            self._page.send((self.run, message.topic, message.time_ns, dict(message.data)))
        except OSError:
            self._stopped = True
