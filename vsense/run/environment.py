"""The virtual world of a run, one timestep at a time: the same for `sim`, `lab` and `run`.

They differ in who makes the arena states and who carries readings and reports. The order is here
in which the world takes the poses, virtual actuators act, the world evolves, and is sensed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vsense.base.arena import ArenaState
from vsense.base.readings import SwarmReadings, TimedReadings
from vsense.config.arena import floor_of, make_field
from vsense.config.placement import settle
from vsense.config.specs import ControllerSpec, Experiment, Stage
from vsense.robots.link.table import Direction, Entry, Table
from vsense.robots.link.wire import ShownData
from vsense.run.cxx_loop import CxxLoopFunctions, LoopHost
from vsense.world.actuators.bank import NO_SENDERS, ActuatorBank
from vsense.world.loop_functions import Hooks, LoopFunctions
from vsense.world.physics.motion import Physics, obstacles
from vsense.world.sensors.bank import SensorBank
from vsense.world.world import World

if TYPE_CHECKING:
    from vsense.run._virtual_swarm import VirtualSwarm
    from vsense.run.remote import RemoteSwarm


MOST_SEED = 2**32 - 1


@dataclass(frozen=True, slots=True)
class Equipment:
    """What the robots of one controller sense and do virtually.

    Attributes:
        controller: its id.
        tags: the robots, virtual ones included.
        table: all of it, as the robots are told.
    """

    controller: str
    tags: Sequence[int]
    sensors: SensorBank
    actuators: ActuatorBank
    table: Table


def table_of(sensors: SensorBank, actuators: ActuatorBank) -> Table:
    """The table that robots with these sensors and actuators are told.

    Raises:
        WireError: they do not fit a datagram.
    """
    entries = [Entry(e.id, e.name, e.layout, Direction.SENSOR) for e in sensors.table]
    entries += [Entry(e.id, e.name, e.layout, Direction.ACTUATOR) for e in actuators.table]
    return Table(entries)


NO_TIMES: Mapping[int, int] = {}


class Environment:
    """World, virtual sensors and virtual actuators of one run. It reads no clock.

    Args:
        experiment: what to make; the attribute has everything in its place. `equipment` is each
            controller's, in the experiment's order.
        seed: of everything that is drawn in the virtual world, and of the places of what is
            distributed; not negative.
        blind: every virtual sensor is held at 0: the control experiment.
        host: of loop functions in C++.

    Raises:
        VsenseError: something in the experiment cannot be made.
    """

    def __init__(
        self,
        experiment: Experiment,
        seed: int,
        blind: bool = False,
        host: LoopHost = LoopHost(),  # noqa: B008 (frozen)
    ) -> None:
        # Nothing distributed: then the start poses of real robots do not matter here.
        settled = settle(experiment, seed) if experiment.distributed else experiment
        self.experiment = settled
        self.seed = seed
        self.blind = blind
        self._host = host
        self.equipment = self._equipped()
        self._loop = _loop_functions(settled, seed, host, self.tables)
        self.world = _world(settled, seed, self._loop)
        if self._loop is not None:
            self._loop.reset(self.world)
        self._swarm, self._remote = self._virtual_swarm(), self._remote_swarm()

    def _equipped(self) -> tuple[Equipment, ...]:
        """Equips all robots anew."""
        experiment = self.experiment
        driven = {r.tag: experiment.controller_of(r).id for r in experiment.robots}
        driven |= {r.tag: experiment.controller_of(r).id for r in experiment.virtual_robots}
        return tuple(
            self._equip(controller, [tag for tag, name in driven.items() if name == controller.id])
            for controller in experiment.controllers
        )

    def _equip(self, controller: ControllerSpec, tags: Sequence[int]) -> Equipment:
        """Equips the robots of a controller; devices of each controller have noise of their own."""
        first = controller is self.experiment.controllers[0]
        stream = "" if first else f"{controller.id}/"
        sensors = SensorBank(controller.sensors, tags, self.blind, self.seed, stream)
        count = len(sensors.table)
        actuators = ActuatorBank(controller.actuators, tags, self.seed, count + 1, stream)
        return Equipment(
            controller.id, tuple(tags), sensors, actuators, table_of(sensors, actuators)
        )

    @property
    def tables(self) -> dict[str, Table]:
        """The sensor table of each controller, by its id."""
        return {equipment.controller: equipment.table for equipment in self.equipment}

    def entries(self, direction: Direction) -> dict[int, list[Entry]]:
        """The virtual sensors, or the actuators, of every robot in their order, by its tag."""
        by_tag = dict[int, list[Entry]]()
        for equipment in self.equipment:
            rows = [entry for entry, *_ in equipment.table.of_direction(direction)]
            by_tag |= dict.fromkeys(equipment.tags, rows)
        return by_tag

    def _virtual_swarm(self) -> VirtualSwarm | None:
        if not any(robot.controller for robot in self.experiment.virtual_robots):
            return None
        # It needs a compiler, which experiments without such robots do not.
        from vsense.run._virtual_swarm import VirtualSwarm

        return VirtualSwarm(self.experiment, self.tables, self.seed)

    def _remote_swarm(self) -> RemoteSwarm | None:
        experiment = self.experiment
        controllers = {experiment.controller_of(robot).id for robot in experiment.robots}
        own = [c for c in experiment.controllers if c.id in controllers and c.program.is_hosted]
        if not own or experiment.stage is Stage.SIM:
            return None
        from vsense.run.remote import RemoteSwarm  # 20 ms

        return RemoteSwarm(experiment, own, self.tables, self.seed)

    @property
    def wire_tables(self) -> dict[str, Table]:
        """What the robots of each controller are told, by its id."""
        return {**self.tables, **({} if self._remote is None else self._remote.tables)}

    @property
    def commands(self) -> Mapping[int, TimedReadings]:
        """What robots that are driven from here are sent in place of what they sense, by tag."""
        return {} if self._remote is None else self._remote.commands

    @property
    def shown(self) -> Mapping[int, ShownData]:
        """What the controllers of robots that are driven from here show to people, by tag."""
        return {} if self._remote is None else self._remote.shown

    def logged(self) -> list[tuple[str, str]]:
        """What the controllers that run here logged since the last call: the robot, and words."""
        said = () if self._swarm is None else self._swarm.logged()
        words = [(f"virtual robot {tag}", text) for tag, text in said]
        more = () if self._remote is None else self._remote.logged()
        return [*words, *((f"robot {tag}", text) for tag, text in more)]

    def failed(self) -> list[str]:
        """Which controllers that run here have failed, and why, in words."""
        swarms = self._swarm, self._remote
        return [text for swarm in swarms if swarm is not None for text in swarm.failed()]

    def said(self) -> Sequence[str]:
        """What the loop functions logged since the last call."""
        return _emptied(self._loop.said) if self._loop is not None else ()

    def moved(self) -> Mapping[int, tuple[float, float, float]]:
        """Robots that the loop functions have put somewhere since the last call, by row."""
        if self._loop is None or not self._loop.moved:
            return {}
        moved = dict(self._loop.moved)
        self._loop.moved.clear()
        return moved

    @property
    def finished(self) -> bool:
        """Whether the loop functions have said that the experiment is over."""
        return self._loop is not None and self._loop.finished

    def reset(self) -> None:
        """Goes back to the state before the run; what the cameras saw last stays."""
        self.world.reset()
        self.equipment = self._equipped()
        if self._loop is not None:
            self._loop = self._loop.renewed()
            self._loop.reset(self.world)
        self._swarm, self._remote = self._virtual_swarm(), self._remote_swarm()

    def following(self) -> Environment:
        """Gives the environment of the run after this one, whose seed is one more."""
        return Environment(self.experiment, self.seed % MOST_SEED + 1, self.blind, self._host)

    def recast(self, experiment: Experiment) -> Environment:
        """Gives the environment of the same run with other robots in its parts."""
        return Environment(experiment, self.seed, self.blind, self._host)

    def step(
        self,
        state: ArenaState,
        run_timestep: int,
        reports: Mapping[int, bytes],
        senders: Mapping[int, bytes] = NO_SENDERS,
        heard_ns: Mapping[int, int] = NO_TIMES,
    ) -> SwarmReadings:
        """Runs one timestep; before the run nothing acts or evolves, but everything is sensed.

        Args:
            state: the arena state of this timestep.
            run_timestep: timestep of the run, from 0; negative before it.
            reports: by tag, the actuators' block of the newest report; other robots are silent.
            senders: by tag, who reports, where more than one robot may have had the tag.
            heard_ns: by tag, when each report came; who is not in it: with the arena state.

        Returns:
            By tag what every robot senses, in the order of its controller's table.

        Raises:
            VsenseError: something in the virtual world has failed; the run cannot go on.
        """
        world, swarm, remote = self.world, self._swarm, self._remote
        reports = reports if remote is None else remote.hear(reports, heard_ns, state.capture_ns)
        if swarm is not None:
            swarm.move(world, state.capture_ns)
            reports = {**reports, **swarm.reports}
        world.update(state, run_timestep)
        if run_timestep >= 0:
            self.pre_step()
            self.act(reports, senders)
        encoded = ((p.controller, p.sensors.encode(world, state.timestep)) for p in self.equipment)
        readings = SwarmReadings(dict(encoded))
        for driven in (swarm, remote):
            if driven is not None:
                driven.control(state, run_timestep, readings)
        if run_timestep >= 0:
            self.post_step()
        return readings

    def pre_step(self) -> None:
        """Calls the user's `pre_step`, as `step` does."""
        if self._loop is not None:
            self._loop.pre_step(self.world)

    def loop_kernel(self) -> Any:
        """What calls the user's functions in C; None: they have to be called here."""
        loop = self._loop
        return loop.kernel(self.world) if isinstance(loop, CxxLoopFunctions) else None

    def heard(self, function: int, is_called: bool) -> int:
        """Does what C has left; see `CxxLoopFunctions.heard`."""
        assert isinstance(self._loop, CxxLoopFunctions)
        return self._loop.heard(self.world, function, is_called)

    def act(self, reports: Mapping[int, bytes], senders: Mapping[int, bytes] = NO_SENDERS) -> None:
        """Has actuators act and fields change, as `step` does."""
        for equipment in self.equipment:
            equipment.actuators.apply(self.world, reports, senders)
        self.world.step()

    def post_step(self) -> None:
        """Calls the user's `post_step`, as `step` does."""
        if self._loop is not None:
            self._loop.post_step(self.world)

    @property
    def hooks(self) -> frozenset[str]:
        """Which of pre_step and post_step the user has."""
        return frozenset() if self._loop is None else self._loop.steps

    @property
    def robots_may_change(self) -> bool:
        """Whether virtual robots may come and go: the user's functions say so, or are none."""
        return self._loop is None or self._loop.robots_may_change

    @property
    def drives(self) -> bool:
        """Whether virtual robots run controllers here."""
        return self._swarm is not None

    def end(self) -> dict[str, float]:
        """Ends the run; gives its results by name: the world's, or those of the user's `end`."""
        for swarm in (self._swarm, self._remote):
            if swarm is not None:
                swarm.end()
        return dict(self.world.results) if self._loop is None else self._loop.end(self.world)


def _emptied(lines: list[str]) -> list[str]:
    """What a list held, which is empty then."""
    held = list(lines)
    lines.clear()
    return held


def _loop_functions(
    experiment: Experiment, seed: int, host: LoopHost, tables: Mapping[str, Table]
) -> Hooks | None:
    """Loads the user's functions; each run has its own."""
    spec = experiment.loop_functions
    if spec is None:
        return None
    if spec.program is None:
        return LoopFunctions(spec.path, spec.label, spec.params)
    return CxxLoopFunctions(experiment, spec, seed, host, tables)


def _world(experiment: Experiment, seed: int, loop: Hooks | None) -> World:
    """Makes the world of an experiment as it is at the start."""
    floor = floor_of(experiment)
    spec = experiment.floor
    if spec is not None and spec.source == "loop_functions" and loop is not None:
        floor = loop.floor(experiment.arena, spec.pixels_per_m)
    return World(
        [robot.tag for robot in experiment.robots],
        experiment.sources,
        entities=experiment.entities,
        fields=[make_field(spec, experiment.arena) for spec in experiment.fields],
        floor=floor,
        objects=[thing.tag for thing in experiment.objects],
        arena=experiment.arena,
        timestep_s=experiment.timestep_s,
        seed=seed,
        controllers={robot.tag: robot.controller for robot in experiment.robots}
        | {robot.tag: robot.controller for robot in experiment.virtual_robots},
        models=experiment.models,
    )


def physics_of(experiment: Experiment, time_ns: int) -> Physics:
    """Makes the physics of all that is real in a settled experiment, at rest."""
    robots, objects = (
        np.array([body.pose for body in bodies], dtype=np.float64).reshape(-1, 3)
        for bodies in (experiment.robots, experiment.objects)
    )
    models = [body.model for body in experiment.bodies]
    boxes, cylinders = obstacles(experiment.boxes, experiment.cylinders, experiment.tallest_m)
    return Physics(robots, objects, boxes, time_ns, cylinders, models=models)
