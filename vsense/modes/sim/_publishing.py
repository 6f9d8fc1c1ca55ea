"""What a simulation tells the page and its recording: the messages of a run, on its own clock.

The messages are those of `vsense.monitor.ui.publisher`, made of arrays: a simulation has neither
links nor pictures. What nobody has there is null.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from vsense.base.errors import VsenseError, failing_as
from vsense.base.files import read_bytes
from vsense.base.message_bus import MessageBus
from vsense.modes.sim._simulation import EPOCH_NS, Simulation
from vsense.monitor.recording.form import ROBOT_COLUMNS, Data
from vsense.monitor.ui import messages
from vsense.monitor.ui.messages import ExperimentFacts
from vsense.monitor.ui.publisher import Publisher
from vsense.monitor.ui.tables import shown
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.table import Direction
from vsense.run.changes import Changes
from vsense.run.control import State
from vsense.run.orders import OrderKind
from vsense.run.runtime import Step
from vsense.vision.cameras.grabber import Troubles

MODE = "sim"
"""Of the page, and of `/experiment`; the command's name, too."""


@dataclass(slots=True)
class SimState:
    """The state of a simulated run, as `Control` has that of others."""

    state: State = State.RUNNING
    run: int = 1
    by: str | None = None
    can: tuple[OrderKind, ...] = ()


class SimPublisher(Publisher):
    """Makes the messages of a simulation, which calls `observe` with each of its timesteps.

    Args:
        bus: takes the messages.
        simulation: is looked at.
        state: of the run.
        recording: gives the "recording" of `/run`.
        changes: of the world, by people; None: there can be none.
    """

    def __init__(
        self,
        bus: MessageBus,
        simulation: Simulation,
        blind: bool,
        state: SimState,
        recording: Callable[[], Data | None] = lambda: None,
        changes: Changes | None = None,
    ) -> None:
        """VsenseError if the experiment's file cannot be read any more."""
        environment = simulation.environment
        self._simulation, self._told_events = simulation, 0
        self._now_ns = EPOCH_NS
        experiment = environment.experiment
        with failing_as(VsenseError, f"{experiment.path}: cannot be read"):
            text = read_bytes(experiment.path).decode(errors="replace")
        facts = ExperimentFacts(MODE, text, blind, (), {}, Troubles(), mode=MODE)
        run_facts = lambda: {"runs": None, "recording": recording()}  # noqa: E731
        super().__init__(
            *(bus, facts, environment, simulation, state, run_facts, lambda: self._now_ns, changes)
        )
        self._names = [robot.id for robot in experiment.robots]
        self._controllers = [robot.controller for robot in experiment.robots]
        self._actuators = environment.entries(Direction.ACTUATOR)

    def observe(self, run_timestep: int) -> None:
        """Publishes a timestep of the run, in which everything has been sensed."""
        state = self._simulation.seen(run_timestep)
        self._now_ns = now_ns = state.capture_ns
        times_ns = (now_ns,) * 4
        self.update(Step(state.timestep, run_timestep, *times_ns, state, ()), {})
        self.tell_events()

    def note(self, run_timestep: int, leds: Mapping[int, int]) -> None:
        """Does nothing: `keep` has every timestep, also those that nobody is shown."""

    def keep(self, run_timestep: int) -> None:
        """Keeps the measures of a timestep of the run, see `Publisher.note`."""
        run = self._simulation
        super().note(run_timestep, dict(zip(run.record.tags, run.leds.tolist())))

    def tell_events(self) -> None:
        """Publishes what controllers and loop functions have logged since the last call."""
        events = self._simulation.record.events
        for time_s, text in events[self._told_events :]:
            self._bus.event(text, "info", self._now_ns, time_s)
        self._told_events = len(events)

    def end(self) -> None:
        """Publishes the state of the run that is over."""
        self.tell_events()
        self._bus.notify("/run", self._now_ns, self.run_data)

    def run_data(self) -> Data:
        """Gives /run: nothing is late, and no reading has an age."""
        timestep_s = self.environment.experiment.timestep_s
        data = {"late": None, "silent_s": 0.0, "rate_hz": round(1.0 / timestep_s, 3)}
        return {**super().run_data(), **data, "latency_ms": None}

    def robots_data(self, robots: Mapping[int, RobotStatus]) -> Data:
        """Gives /robots, of the wheels, LEDs and controllers as they are now."""
        run, record = self._simulation, self._simulation.record
        tags, count = list(record.tags), len(record.tags)
        wheels, reports = run.wheels_steps_s, run.reports()
        # Nothing holds a simulated robot: its recordings are as before there was a fence.
        names = (name for name in ROBOT_COLUMNS if name != "held")
        columns: dict[str, list[Any]] = {name: [None] * count for name in names}
        columns |= {
            "tag": tags,
            "name": self._names,
            "connected": [True] * count,
            "seen": [True] * count,
            "pose_age_ms": [0.0] * count,
            "state": ["run"] * count,
            "stop_cause": [""] * count,
            "leds": run.leds.tolist(),
            "left_steps_s": wheels[:, 0].tolist(),
            "right_steps_s": wheels[:, 1].tolist(),
            "expected": self._controllers,
            "trouble": [""] * count,
            "actuators": [
                messages.numbers(self._actuators[tag], reports.get(tag, b"")) for tag in tags
            ],
            "shown": [shown(tuple(record.showing.get(tag, {}).items())) for tag in tags],
        }
        return columns
