"""Makes the world of a recorded run again, and compares what the robots sensed with the recorded.

The world follows from the experiment, its seed, the arena states, what the robots' virtual
actuators did and what people changed; a recording holds all of it. With the same vsense and the
same loop functions the readings are the same in every bit.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import vsense
from vsense.base.arena import POSE, ArenaState
from vsense.base.errors import VsenseError
from vsense.base.message_bus import DAMAGED, Message
from vsense.base.readings import SwarmReadings
from vsense.config.casting import Casting
from vsense.config.experiment import first_robots, read
from vsense.config.placement import StartPlaces, settle
from vsense.config.specs import Experiment, Stage
from vsense.monitor.recording import _senses, form
from vsense.monitor.recording.form import ExperimentMessage, RecordingError
from vsense.monitor.recording.reader import Recording
from vsense.robots.link.table import Direction
from vsense.robots.sources import CodeOptions
from vsense.run.changing import Change, Ground, carry_out
from vsense.run.environment import Environment

_TOPICS = frozenset(("/experiment", "/arena", "/readings", form.DEEDS, form.ORDERS_TOPIC))
_WAITING = 500
"""Timesteps of which not everything has come yet."""

_DONE_ALREADY = Ground(put=lambda row, x_m, y_m, yaw_rad: None, rebuilds=True)
"""What was done to the real arena is in the arena states."""


@dataclass(frozen=True, slots=True)
class FirstDifference:
    """The first reading that is another one: timestep of the run, robot, sensor, both values."""

    run_timestep: int
    tag: int
    sensor: str
    before: Any
    now: Any


@dataclass(slots=True)
class ResenseComparison:
    """How the readings of two makings of one run differ.

    Attributes:
        timesteps: those of the world that were made again, from before the run's first one on.
        readings: so many were compared.
        different: so many of them are not the same in every bit.
        sensors: in how many readings of each sensor.
        orders: so many changes of the world were carried out again.
        first: None: there is none.
        versions: the vsense that recorded, and this one, where they are not the same.
    """

    timesteps: int = 0
    readings: int = 0
    different: int = 0
    sensors: dict[str, int] = field(default_factory=dict)
    orders: int = 0
    first: FirstDifference | None = None
    versions: tuple[str, str] | None = None

    @property
    def exit_code(self) -> int:
        """1 where readings differ."""
        return int(self.different > 0)

    def lines(self) -> list[str]:
        """The comparison for people."""
        same = self.readings - self.different
        lines = [
            f"{self.timesteps} timesteps made again, with {self.orders} changes of the world:"
            f" {self.readings} readings compared, {same} the same in every bit"
        ]
        if self.versions is not None:
            then, now = self.versions
            lines.append(f"vsense was {then}, now {now}: the last bits may differ")
        if self.first is not None:
            first, by_sensor = self.first, sorted(self.sensors.items())
            lines += [
                f"the first that differs: timestep {first.run_timestep} of the run, robot"
                f" {first.tag}, {first.sensor}: recorded {first.before}, now {first.now}",
                "by sensor: " + ", ".join(f"{name} {count}" for name, count in by_sensor),
            ]
        return lines


class Resensing:
    """The world on a recording.

    Args:
        recording: of `vsense lab` or `vsense run`, from the run's beginning.
        path: where the experiment's file is, None: where it was; what it names is taken from there.
        change: gives what is read in place of what the recording says of its experiment.
    """

    def __init__(
        self,
        recording: Recording,
        path: Path | None = None,
        change: Callable[[ExperimentMessage], ExperimentMessage] = lambda message: message,
    ) -> None:
        self.comparison = ResenseComparison()
        self._recording = recording
        self._path, self._change = path, change
        self._environment: Environment | None = None
        self._casting: Any = None
        self._count = self._changes = 0
        self._states: dict[int, Mapping[str, Any]] = {}
        self._readings: dict[int, Mapping[str, Any]] = {}
        self._orders: list[Mapping[str, Any]] = []

    def timesteps(self) -> Iterator[int]:
        """Makes the world again to the recording's end; gives each timestep of the run.

        Raises:
            RecordingError: something that the world depends on is not in the recording.
            VsenseError: the experiment cannot be read or made again.
        """
        try:
            for message in self._recording.messages(_TOPICS):
                run_timestep = self._take(message)
                if run_timestep is not None:
                    yield run_timestep
        except DAMAGED as error:
            name = self._recording.path
            raise RecordingError(f"{name}: cannot be sensed again: {error!r}") from None
        if not self.comparison.timesteps:
            raise self._error("holds no deeds of robots: it was recorded by an older vsense, or is"
                              " none of vsense lab or vsense run")  # fmt: skip

    @property
    def measures(self) -> dict[str, float]:
        """The experiment's measures after the newest timestep."""
        environment = self._environment
        return {} if environment is None else dict(environment.world.results)

    def end(self) -> dict[str, float]:
        """Ends the run as it ended then; gives its results."""
        return {} if self._environment is None else self._environment.end()

    def _take(self, message: Message) -> int | None:
        """Takes a message; gives the timestep of the run that is complete with it."""
        data = message.data
        if message.topic == "/experiment":
            self._begin(self._change(ExperimentMessage.read(data)))
        elif message.topic == form.ORDERS_TOPIC:
            self._orders.append(data)
        elif message.topic == form.DEEDS:
            return self._step(data)
        else:
            waiting = self._states if message.topic == "/arena" else self._readings
            waiting[data["timestep"]] = data
            if len(waiting) > _WAITING:  # the world was held
                del waiting[next(iter(waiting))]
        return None

    def _begin(self, message: ExperimentMessage) -> None:
        """Makes the first world, and another one where somebody was put in before the run."""
        casting = (message.made or {}).get("casting")
        if self._environment is None or casting != self._casting:
            self._environment, self._casting = self._make_environment(message), casting
            self._count = self._changes = 0
            self._orders.clear()

    def _make_environment(self, message: ExperimentMessage) -> Environment:
        """The virtual world as it was before the first timestep."""
        setup = message.made
        if message.mode == "sim":
            raise self._error("is of a simulation: vsense pack and reproduce run it again")
        if not setup or message.seed is None:
            raise self._error("does not say how its experiment was read: an older vsense made it")
        if message.version != vsense.__version__:
            self.comparison.versions = message.version, vsense.__version__
        experiment = self._experiment(message.file_text, setup)
        return Environment(experiment, message.seed, bool(message.blind))

    def _experiment(self, text: str, setup: Mapping[str, Any]) -> Experiment:
        path, stage = self._path or Path(setup["path"]), Stage(setup["stage"])
        if not path.is_absolute() and self._path is None:
            # No recording of ours has one: it would be whatever the current folder holds.
            raise self._error(
                f"says that its experiment is {str(path)!r}: say where with --experiment FILE"
            )
        how = setup["length_s"], setup["settings"], stage, setup["virtual_devices"]
        try:
            code = CodeOptions(**setup.get("code", {}))  # older recordings have none
            casting = Casting.read(setup.get("casting", {}))
            experiment = read(text.encode(), path.name, path, *how, code, casting)
            experiment = first_robots(experiment, setup["robots"])
            places = StartPlaces.read({"poses": setup.get("poses", ()), "seed": setup["seed"]})
            experiment = places.put(experiment)
        except VsenseError as error:
            hint = "" if self._path else "; say where its file is with --experiment FILE"
            raise self._error(f"its experiment cannot be read again: {error}{hint}") from None
        return settle(experiment, setup["seed"], real=stage is not Stage.RUN)

    def _step(self, data: Mapping[str, Any]) -> int:
        """Makes a timestep of the world again, and compares its readings."""
        given, timestep = _senses.given_reports(data), data["timestep"]
        run_timestep: int = data["run_timestep"]
        state, readings = self._states.pop(timestep, None), self._readings.pop(timestep, None)
        environment, done = self._environment, self._count
        if environment is None or given.count != done or state is None or readings is None:
            raise self._missing(done)
        while self._orders and self._orders[0]["timestep"] <= timestep:
            carry_out(Change.read(self._orders.pop(0)["change"]), environment, _DONE_ALREADY)
            self._changes += 1
            self.comparison.orders += 1
        if given.orders != self._changes:
            raise self._missing(done)
        now = environment.step(arena_state(state), run_timestep, given.reports, given.senders)
        self._count += 1
        self.comparison.timesteps += 1
        self._compare(readings, now, environment, run_timestep)
        return run_timestep

    def _compare(
        self,
        before: Mapping[str, Any],
        sensed: SwarmReadings,
        environment: Environment,
        run_timestep: int,
    ) -> None:
        entries = environment.entries(Direction.SENSOR)
        now = _senses.readings(entries, sensed, before["timestep"], before["capture_ns"])
        rows = {tag: row for row, tag in enumerate(before["tag"])}
        for at, tag in enumerate(now["tag"]):
            row = rows[tag]
            for number, entry in enumerate(entries[tag]):
                pair = [
                    [data[name][place][number] for name in ("values", "captured_ns")]
                    for data, place in ((before, row), (now, at))
                ]
                self.comparison.readings += 1
                # As text: 0.0 and -0.0 are equal, but not the same.
                if json.dumps(pair[0]) != json.dumps(pair[1]):
                    self._differ(FirstDifference(run_timestep, tag, entry.name, *pair))

    def _differ(self, difference: FirstDifference) -> None:
        comparison = self.comparison
        comparison.different += 1
        comparison.sensors[difference.sensor] = comparison.sensors.get(difference.sensor, 0) + 1
        comparison.first = comparison.first or difference

    def _missing(self, done: int) -> RecordingError:
        if not done:
            return self._error(
                "does not begin with its run: a world can be made again from its beginning only;"
                " record with --record"
            )
        gaps = [gap.why for gap in self._recording.gaps]
        why = f" ({gaps[0]})" if gaps else ""
        return self._error(f"lacks a timestep after {done}{why}: the world cannot go on from there")

    def _error(self, what: str) -> RecordingError:
        return RecordingError(f"{self._recording.path}: {what}")


def arena_state(data: Mapping[str, Any]) -> ArenaState:
    """What `ArenaState.data` was made of, as far as a world sees it."""
    columns = data["robots"]
    robots = np.zeros(len(columns["tag"]), POSE)
    for name in POSE.names or ():
        robots[name] = _column(columns[name], name == "covariance")
    return ArenaState(data["timestep"], data["capture_ns"], robots, data["detected"])


def _column(values: list[Any], nines: bool) -> NDArray[Any]:
    """A column as an array; what JSON has no number for is NaN."""
    if nines:
        unknown = [float("nan")] * 9
        return np.array([unknown if row is None else row for row in values]).reshape(-1, 3, 3)
    return np.array([float("nan") if value is None else value for value in values])
