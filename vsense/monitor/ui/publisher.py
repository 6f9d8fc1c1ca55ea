"""Publishes the state of the run after every timestep; messages are made only if they are wanted.

It runs in the thread of the timesteps, when the readings have left. Pictures become small JPEGs, a
few per second, on a thread of their own.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Protocol

import cv2
import numpy as np

from vsense.base.arena import ArenaState, Frame
from vsense.base.clock import host_ns, pace
from vsense.base.message_bus import Message, MessageBus
from vsense.monitor.recording import _senses, form
from vsense.monitor.recording.form import PARTS, PICTURE, SETTINGS_TOPIC, Data, RunMessage
from vsense.monitor.recording.measures import MeasureHistory, measures_of
from vsense.monitor.ui import messages
from vsense.monitor.ui.messages import ExperimentFacts
from vsense.monitor.ui.tables import CameraTable, RobotTable
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.table import Direction
from vsense.robots.link.wire import ReadingValues
from vsense.run.alarms import Alarm
from vsense.run.cast import played
from vsense.run.changes import CarriedOut, Changes
from vsense.run.control import State
from vsense.run.environment import Environment
from vsense.run.orders import OrderKind
from vsense.run.runtime import Step

SECOND_NS = 1_000_000_000
FIELDS_NS = HISTORY_NS = SECOND_NS // 2
_RATE_TIMESTEPS = 100
"""Timesteps that rates and latencies are taken from."""


class Rates:
    """How often arena states come, and how old pictures are at the end of a timestep, lately."""

    def __init__(self) -> None:
        self._times: deque[tuple[int, int]] = deque(maxlen=_RATE_TIMESTEPS)

    def add(self, capture_ns: int, done_ns: int) -> None:
        """Counts a timestep."""
        self._times.append((capture_ns, done_ns - capture_ns))

    def data(self) -> Data:
        """Gives "rate_hz" and "latency_ms" of /run; any thread."""
        if len(self._times) < 2:
            return {"rate_hz": 0.0, "latency_ms": None}
        captures, ages = np.array(self._times).T
        rate_hz = (len(captures) - 1) / max((captures[-1] - captures[0]) / 1e9, 1e-9)
        p50, p99 = np.percentile(ages / 1e6, (50, 99))
        latency = {"p50": round(float(p50), 2), "p99": round(float(p99), 2)}
        return {"rate_hz": round(float(rate_hz), 2), "latency_ms": latency}


class SentReadings(Protocol):
    """Who has the newest readings of all robots: a `Runtime`."""

    @property
    def readings(self) -> Mapping[int, ReadingValues]:
        """By tag: (payload, capture time) per sensor."""
        ...


class RunState(Protocol):
    """The state of the present run: a `Control`."""

    @property
    def state(self) -> State:
        """What it does."""
        ...

    @property
    def run(self) -> int:
        """Its number, from 1."""
        ...

    @property
    def by(self) -> str | None:
        """Who gave the last order that was obeyed."""
        ...

    @property
    def can(self) -> Sequence[OrderKind]:
        """The orders that make sense now."""
        ...


class Publisher:
    """Makes the messages of one process's runs.

    Args:
        bus: takes the messages.
        facts: what all runs have in common.
        environment: the present run's virtual world.
        runtime: has the readings that the robots were sent.
        control: has the state of the run.
        room_data: gives the rest of /run: runs, text, recording, disk_free_bytes, doubts.
        alarms: gives what is wrong with the run now; pages hear at once of one that is new.
        clock: host's monotonic clock [ns].
        changes: of the world, by people; None: there can be none.
    """

    def __init__(
        self,
        bus: MessageBus,
        facts: ExperimentFacts,
        environment: Environment,
        runtime: SentReadings,
        control: RunState,
        room_data: Callable[[], Data],
        clock: Callable[[], int] = host_ns,
        changes: Changes | None = None,
        alarms: Callable[[], Sequence[Alarm]] = tuple,
    ) -> None:
        self._changes, self._alarms = changes, alarms
        if changes is not None:
            changes.notes.append(self._note)
        self.environment = environment
        self._bus, self._common = bus, facts
        self._runtime = runtime
        self._control = control
        self._room_data = room_data
        self._clock = clock
        self._equip(environment)
        self._cameras = CameraTable(facts.cameras, facts.troubles)
        self._state: ArenaState | None = None
        self._rates = Rates()
        self._published: dict[str, object] = {}
        self._due_ns = self._fields_due_ns = self._late = self._looked_ns = 0
        self._run_timestep = self._joined = -1
        self._verdict: str | None = None
        self._why = ""
        self._history, self._history_due_ns = MeasureHistory(), 0

    def _equip(self, environment: Environment) -> None:
        """Prepares the robots' table and their devices'."""
        self._sensors = environment.entries(Direction.SENSOR)
        actuators = environment.entries(Direction.ACTUATOR)
        robots = environment.experiment.robots
        names, controllers = {r.tag: r.id for r in robots}, {r.tag: r.controller for r in robots}
        self._robots = RobotTable(names, controllers, actuators)

    def update(self, step: Step | None, robots: Mapping[int, RobotStatus]) -> None:
        """Publishes what is new: `step` is None where no arena state came for a while."""
        now_ns = self._looked_ns = self._clock()
        newcomers, self._joined = self._bus.joined != self._joined, self._bus.joined
        if newcomers:
            self._published.clear()
            self._due_ns = self._fields_due_ns = self._history_due_ns = 0
        facts = lambda: messages.experiment(self._common, self.environment)  # noqa: E731
        self._if_new("/experiment", self._control.run, facts, now_ns)
        changes = self._changes
        if changes is not None:
            settings = lambda: changes.settings(self.environment)  # noqa: E731
            self._if_new(SETTINGS_TOPIC, (self._control.run, changes.version), settings, now_ns)
        uids = tuple(robot.uid for robot in robots.values())
        numbers = self._control.run, self._run_timestep
        cast = self.environment.experiment
        parts = lambda: messages.parts(played(cast, robots), *numbers)  # noqa: E731
        self._if_new(PARTS, (self._control.run, tuple(robots), uids), parts, now_ns)
        if step is not None:
            self._publish_step(step, now_ns)
            self.note(step.run_timestep, leds_of(robots))
        if now_ns >= self._due_ns:
            self._bus.notify("/cameras", now_ns, lambda: self._cameras.data(now_ns))
        self._publish_run(now_ns)
        if host_ns() >= self._history_due_ns:
            self.publish_history()
        self._bus.notify("/robots", now_ns, lambda: self.robots_data(robots))

    def note(self, run_timestep: int, leds: Mapping[int, int]) -> None:
        """Keeps the measures of a timestep of the run; `leds` are bits by tag."""
        if run_timestep >= 0:
            tags = (robot.tag for robot in self.environment.experiment.robots)
            self._history.add(run_timestep, measures_of(self.environment.world, tags, leds))

    def publish_history(self) -> None:
        """Publishes the measures since the run began, where a listener lacks some of them."""
        # Pages miss timesteps by the wall's clock, of which a fast simulation has its own.
        self._history_due_ns = host_ns() + HISTORY_NS
        version = self._control.run, self._run_timestep
        timestep_s = self.environment.experiment.timestep_s
        data = lambda: self._history.data(self._control.run, timestep_s)  # noqa: E731
        self._if_new("/history", version, data, self._clock())

    def _publish_step(self, step: Step, now_ns: int) -> None:
        self._state = step.state
        self._robots.see(step.state)
        self._cameras.see(step.frames)
        self._rates.add(step.capture_ns, step.sent_ns)
        if step.run_timestep >= 0:
            missed = max(step.run_timestep - self._run_timestep - 1, 0)
            late = step.sent_ns - step.capture_ns > self.environment.experiment.timestep_ns
            self._late += missed + late
            self._run_timestep = step.run_timestep
        world = self.environment.world
        self._bus.notify("/arena", step.capture_ns, lambda: _arena(step))
        self._if_new("/world", world.version, lambda: messages.world(world), now_ns)
        self._bus.notify("/signals", step.capture_ns, lambda: messages.signals(world))
        if world.fields and now_ns >= self._fields_due_ns:
            self._fields_due_ns = now_ns + FIELDS_NS
            self._bus.notify("/fields", now_ns, lambda: messages.fields(world.fields.values()))
        self._publish_readings(step)
        given = step.given
        if given is not None:
            numbers = step.timestep, step.run_timestep
            self._bus.notify(form.DEEDS, step.sent_ns, lambda: _senses.reported(given, *numbers))

    def _note(self, done: CarriedOut) -> None:
        """Publishes a change of the world."""
        self._bus.notify(form.ORDERS_TOPIC, self._clock(), done.data)

    def _publish_readings(self, step: Step) -> None:
        sent = self._runtime.readings

        def publish(topic: str, tags: Sequence[int]) -> None:
            def data() -> Data:
                chosen = {tag: sent[tag] for tag in tags}
                return _senses.readings(self._sensors, chosen, step.timestep, step.capture_ns)

            self._bus.notify(topic, step.sent_ns, data)

        publish("/readings", list(sent))
        for tag in sent:
            publish(f"/readings/{tag}", [tag])

    def robots_data(self, robots: Mapping[int, RobotStatus]) -> Data:
        """Gives /robots, from the status of every robot by tag; any thread."""
        return self._robots.data(robots, self._state, self._clock())

    def recast(self, environment: Environment) -> None:
        """Goes on with other robots in the parts."""
        self.environment = environment
        self._equip(environment)
        self._published.clear()

    def begin_run(self, environment: Environment) -> None:
        """Prepares for the next run."""
        self.environment = environment
        self._history = MeasureHistory()
        self._run_timestep, self._late = -1, 0
        self._verdict, self._why = None, ""
        self._published.clear()

    def judge(self, facts: Mapping[str, str]) -> None:
        """Publishes the verdict on the run that is over; `facts` as summaries have them."""
        self._verdict, self._why = facts["verdict"], facts["why"]
        self._publish_run(self._clock())

    @property
    def time_s(self) -> float | None:
        """Since the run's beginning, None: before it."""
        if self._run_timestep < 0:
            return None
        return round(self._run_timestep * self.environment.experiment.timestep_s, 3)

    def run_data(self) -> Data:
        """Gives /run; while nobody looks, as when robots stop, nothing is unseen for longer."""
        control, experiment = self._control, self.environment.experiment
        newest_ns = None if self._state is None else self._state.capture_ns
        return RunMessage(
            state=control.state.value,
            run=control.run,
            by=control.by,
            can=[kind.value for kind in control.can],
            timestep=self._run_timestep,
            time_s=round(max(self._run_timestep, 0) * experiment.timestep_s, 3),
            length_s=experiment.length_s or None,
            late=self._late,
            silent_s=None if newest_ns is None else silence_s(self._looked_ns - newest_ns),
            **self._rates.data(),
            **self._room_data(),
            alarms=[asdict(alarm) for alarm in self._alarms()],
            verdict=self._verdict,
            why=self._why,
        ).data()

    def _publish_run(self, now_ns: int) -> None:
        control = self._control
        alarms = tuple(alarm.text for alarm in self._alarms())
        key = (control.state, control.run, control.by, control.can, self._verdict, alarms)
        if self._published.get("/run") == key and now_ns < self._due_ns:
            return
        self._published["/run"] = key
        # Pages wait for it by the wall's clock, of which a slow lab's second is many.
        self._due_ns = now_ns + round(SECOND_NS * pace())
        self._bus.notify("/run", now_ns, self.run_data)

    def _if_new(self, topic: str, version: object, make: Callable[[], Data], now_ns: int) -> None:
        """Publishes what changes rarely: when it has changed, or for a new listener."""
        if self._published.get(topic) != version and self._bus.wants(topic):
            self._published[topic] = version
            self._bus.publish(Message(topic, now_ns, make()))


def leds_of(robots: Mapping[int, RobotStatus]) -> dict[int, int]:
    """The LEDs of the robots that have reported them, bits by tag."""
    return {tag: robot.telemetry.leds for tag, robot in robots.items() if robot.telemetry}


def _arena(step: Step) -> Data:
    return {**step.state.data(), "run_timestep": step.run_timestep}


def silence_s(age_ns: int) -> float:
    """Time without an arena state, 0 up to half a second."""
    return round(age_ns / 1e9, 1) if age_ns > SECOND_NS // 2 else 0.0


PICTURE_PERIOD_NS = 250_000_000
"""Of each camera's pictures."""

PICTURE_PX = 640
"""Greatest width of a picture."""

JPEG_QUALITY = 70


class PreviewEncoder:
    """Makes JPEG pictures on a thread of its own; of each camera the newest picture only."""

    def __init__(self, bus: MessageBus) -> None:
        self._bus = bus
        self._due_ns: dict[str, int] = {}
        self._waiting: dict[str, Frame] = {}
        self._lock = threading.Lock()
        self._news = threading.Event()
        self._ending = False
        self._thread: threading.Thread | None = None

    def offer(self, frames: Sequence[Frame]) -> None:
        """Takes pictures, copying those that are wanted; does not wait."""
        for frame in frames:
            due_ns = self._due_ns.get(frame.camera, 0)
            if frame.capture_ns < due_ns or not self._bus.wants(PICTURE + frame.camera):
                continue
            self._due_ns[frame.camera] = max(due_ns + PICTURE_PERIOD_NS, frame.capture_ns)
            copy = replace(frame, image=frame.image.copy())
            with self._lock:
                self._waiting[frame.camera] = copy
            self._news.set()
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._run, name="vsense-preview", daemon=True
                )
                self._thread.start()

    def close(self) -> None:
        """Ends the thread, which begins with the first picture that somebody wants."""
        self._ending = True
        self._news.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while self._news.wait() and not self._ending:
            self._news.clear()
            with self._lock:
                waiting, self._waiting = self._waiting, {}
            for frame in waiting.values():
                self._bus.publish(picture(frame))


def picture(frame: Frame) -> Message:
    """Makes the message with a small picture."""
    height, width = frame.image.shape
    scale = min(1.0, PICTURE_PX / width)
    size = (round(width * scale), round(height * scale))
    small = cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA)
    blob = cv2.imencode(".jpg", small, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))[1].tobytes()
    data = {
        "camera": frame.camera,
        "timestep": frame.timestep,
        "capture_ns": frame.capture_ns,
        "format": "jpeg",
        "width_px": width,
        "height_px": height,
        "scale": scale,
    }
    return Message(PICTURE + frame.camera, frame.capture_ns, data, blob)
