"""A short run of a shipped experiment whose world people change, in one process."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from tests.run.stage import status
from tests.world.sensors.scenes import STEP_NS, arena_state
from vsense.base.arena import ArenaState, Frame
from vsense.base.message_bus import MessageBus
from vsense.config.casting import Casting
from vsense.config.experiment import load
from vsense.config.placement import settle
from vsense.config.specs import Stage
from vsense.monitor.ui.messages import ExperimentFacts
from vsense.monitor.ui.publisher import Publisher
from vsense.robots.link.status import ActuatorReport
from vsense.robots.link.wire import ReadingValues, ShownData, Wanted
from vsense.run.changes import Changes
from vsense.run.changing import Change
from vsense.run.control import Control
from vsense.run.environment import Environment
from vsense.run.runtime import Runtime
from vsense.vision.cameras.grabber import Troubles

SEED = 5
PAUSE = range(14, 18)


class ChangedRun:
    """The robots wander; their virtual actuators say something new in every timestep.

    Attributes:
        answers: what became of each change.
        told: the lines for people.
    """

    def __init__(
        self,
        name: str = "foraging",
        locked: bool = False,
        blind: bool = False,
        robots: int | None = None,
    ) -> None:
        experiment = load(name, stage=Stage.LAB, casting=Casting(limit=robots))
        made = settle(experiment, SEED)
        self.bus, self.now_ns = MessageBus(), 0
        self.answers: list[tuple[str, bool]] = []
        self.told: list[str] = []
        self.environment = Environment(made, SEED, blind)
        self.places = {robot.tag: robot.pose for robot in made.robots}
        self.random = np.random.default_rng(3)
        self.changes = Changes(self.told.append, locked, clock=lambda: self.now_ns)
        self.runtime = Runtime(self, self.environment, self, lambda: 0, self.changes)  # type: ignore[arg-type]
        path, text = experiment.path, experiment.path.read_text()
        how: dict[str, Any] = {
            "path": str(path), "stage": "lab", "length_s": None, "settings": {},
            "virtual_devices": False, "robots": robots, "seed": SEED,
        }  # fmt: skip
        facts = ExperimentFacts("lab", text, blind, (), {}, Troubles(), how)
        control = Control(lambda wanted: None, self.told.append)
        self.publisher = Publisher(
            *(self.bus, facts, self.environment, self.runtime, control, dict, lambda: self.now_ns),
            self.changes,
        )
        self.robots = {robot.tag: status(robot.tag, robot.id) for robot in made.robots}
        self._due, self._timestep = threading.Semaphore(0), -1

    def ask(self, **said: Any) -> None:
        """Asks for a change as a page does."""
        self.changes.ask(Change.read(said), "Ada", lambda *answer: self.answers.append(answer))

    def live(self, timesteps: int, asked: Mapping[int, Callable[[], None]]) -> list[Any]:
        """Lives timesteps with a pause in them; gives the readings of each."""
        self.runtime.open()
        found = []
        for timestep in range(timesteps):
            if timestep == 2:
                self.runtime.start()
            if timestep == PAUSE.start:
                self.runtime.hold()
            if timestep == PAUSE.stop:
                self.runtime.resume()
            asked.get(timestep, lambda: None)()
            self._due.release()
            step = self.runtime.step()
            self.now_ns = step.capture_ns + STEP_NS // 2
            self.publisher.update(step, self.robots)
            found.append({tag: self.runtime.readings[tag] for tag in self.runtime.readings})
        self._due.release()
        self.runtime.close()
        return found

    # -- the source of arena states, and the robots' server ---------------------------------

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        assert self._due.acquire(timeout=20.0)
        self._timestep += 1
        for tag, (x_m, y_m, yaw_rad) in self.places.items():
            step = self.random.normal(0.0, 0.02, 3)
            self.places[tag] = (x_m + step[0], y_m + step[1], yaw_rad)
        return arena_state(self.places, (self._timestep + 1) * STEP_NS), ()

    def start(self) -> None:
        """See `ArenaSource`."""

    def stop(self) -> None:
        """See `ArenaSource`."""

    def show(self, shown: Mapping[int, ShownData]) -> None:
        """There is nobody to show it to."""

    def reports(self) -> dict[int, ActuatorReport]:
        (equipment,) = self.environment.equipment
        size = sum(entry.size for entry in equipment.actuators.table)
        said = np.float32(0.5 + 0.1 * (self._timestep % 7)).tobytes()
        return {tag: ActuatorReport(b"me", said.ljust(size, b"\0")[:size]) for tag in self.places}

    def publish(self, timestep: int, capture_ns: int, values: Mapping[int, ReadingValues]) -> int:
        return capture_ns

    def command(self, wanted: Wanted, from_timestep: int = 0) -> None:
        pass
