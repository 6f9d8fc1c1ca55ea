"""Virtual robots that live beside the real ones: their bodies, and their controllers.

A virtual robot runs its controller as a real one does, but in this process. On the floor of the
virtual world physical and virtual things are in its way, and so are the real robots, which it
cannot push. Its own proximity sensors detect all of that. As for a real robot, what it decides in
one timestep shows in the next.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import ArenaState, Floats
from vsense.base.readings import SwarmReadings
from vsense.config.specs import Experiment
from vsense.robots.inprocess import ACT_NS, CONTROL_NS
from vsense.robots.link.table import Table
from vsense.robots.link.wire import Wanted
from vsense.run.programs import Programs, failed_words, shared_objects
from vsense.world.entities import VirtualRobot
from vsense.world.physics.motion import Physics, obstacles
from vsense.world.physics.proximity_ring import ProximityRing
from vsense.world.robot_models import EPUCK
from vsense.world.sightings import recent
from vsense.world.world import BODY_MEMORY_NS, World

_FAR_M = 1e6
"""Where robots and things are put that must block nothing."""

REST_NS = 400_000_000
"""After a longer time without an arena state they go on from where they stood, as real robots."""


class VirtualSwarm:
    """The virtual robots of an experiment that controllers drive, at least one.

    Loop functions alone move the others, and those that they put into the world. `reports` has,
    by tag, the actuators' block of each robot after the newest timestep.

    Raises:
        VsenseError: a controller cannot be built or run.
    """

    def __init__(self, experiment: Experiment, tables: Mapping[str, Table], seed: int) -> None:
        driven = {r.tag: r.controller for r in experiment.virtual_robots if r.controller}
        self._tags = list(driven)
        own = tuple(c for c in experiment.controllers if c.id in driven.values())
        libraries = shared_objects(replace(experiment, controllers=own))
        self._controllers = Programs(experiment, driven, libraries, tables, seed)
        self._seed = seed
        self._scenes = 0
        self._scene: _Scene | None = None
        self._wheels = np.zeros((len(self._tags), 2), dtype=np.int16)
        self.reports: Mapping[int, bytes] = {}

    def move(self, world: World, capture_ns: int) -> None:
        """Moves the robots, from where `world` has them, to the time of the next arena state."""
        scene = self._scene
        # After a pause, or a time without arena states, they go on from where they stood.
        restarted = scene is None or capture_ns - world.capture_ns > REST_NS
        if scene is None or restarted or not scene.holds(world):
            # Or something else has moved, or was put there or taken away.
            start_ns = capture_ns if restarted else world.capture_ns
            scene = self._scene = _Scene(world, self._tags, start_ns, self._seed + self._scenes)
            self._scenes += 1
            scene.drive(self._wheels, start_ns)
        scene.move(world, capture_ns)

    def logged(self) -> Sequence[tuple[int, str]]:
        """See `Programs.logged`."""
        return self._controllers.logged()

    def failed(self) -> list[str]:
        """See `Environment.failed`."""
        return failed_words(self._controllers.failures(), "virtual ")

    def end(self) -> None:
        """See `Program.end`."""
        self._controllers.end()

    def control(self, state: ArenaState, run_timestep: int, readings: SwarmReadings) -> None:
        """Runs every robot's control step after `move`; `readings` are what each tag senses.

        Before the run (`run_timestep` negative) robots stand.
        """
        assert self._scene is not None
        capture_ns = state.capture_ns
        self._controllers.step(
            Wanted.RUN if run_timestep >= 0 else Wanted.IDLE,
            0,
            state.timestep,
            (capture_ns, capture_ns + CONTROL_NS),
            readings,
            self._scene.proximity(),
        )
        self._wheels = self._controllers.wheels_steps_s.copy()
        self._scene.drive(self._wheels, capture_ns + ACT_NS)
        self.reports = self._controllers.reports()


class _Scene:
    """Virtual robots among all obstacles; valid until something but a real robot moves."""

    def __init__(self, world: World, tags: Sequence[int], start_ns: int, seed: int) -> None:
        here = {robot.tag: robot for robot in _robots_of(world)}
        self._tags = tags
        self._rows = [row for row, tag in enumerate(tags) if tag in here]
        self._robots = [here[tag] for tag in tags if tag in here]
        real = (*world.robots[: world.real_robots]["tag"], *world.objects["tag"])
        models = [robot.model for robot in self._robots]
        models += [world.models.get(tag, EPUCK) for tag in real]
        self._tallest_m = max(model.height_m for model in (EPUCK, *models))
        boxes, cylinders = self._standing = self._obstacles(world)
        poses = [(robot.x_m, robot.y_m, robot.yaw_rad) for robot in self._robots]
        self._physics = Physics(
            poses, _real_poses(world), boxes, start_ns, cylinders, models=models
        )
        self._ring = ProximityRing(self._physics.near, seed, models=models)

    def _obstacles(self, world: World) -> tuple[Floats, Floats]:
        return obstacles(world.boxes(), world.cylinders(), self._tallest_m)

    def holds(self, world: World) -> bool:
        """Whether only real robots have moved since `move`."""
        here = {robot.tag: robot for robot in _robots_of(world) if robot.tag in self._tags}
        same = zip(self._standing, self._obstacles(world))
        known_here = {robot.tag: robot for robot in self._robots}
        return here == known_here and all(np.array_equal(old, new) for old, new in same)

    def move(self, world: World, time_ns: int) -> None:
        """Moves the robots on to a time, and in the world."""
        poses, count = self._physics.poses, len(self._robots)
        real = _real_poses(world)
        poses[count : count + len(real)] = real
        self._physics.advance(time_ns)
        for robot, (x_m, y_m, yaw_rad) in zip(self._robots, poses.tolist()):
            world.move(robot.id, x_m, y_m, yaw_rad)
        here = {robot.tag: robot for robot in _robots_of(world)}
        self._robots = [here[robot.tag] for robot in self._robots]

    def drive(self, wheels_steps_s: NDArray[np.int16], time_ns: int) -> None:
        """Turns the wheels, (n, 2) of all tags, from a time on."""
        self._physics.drive_all(np.ascontiguousarray(wheels_steps_s[self._rows]), time_ns)

    def proximity(self) -> NDArray[np.int16]:
        """Raw values of the robots' own proximity sensors, (n, 8) of all tags."""
        raw = np.zeros((len(self._tags), 8), dtype=np.int16)
        raw[self._rows] = self._ring.read(self._physics.poses)
        return raw


def _robots_of(world: World) -> tuple[VirtualRobot, ...]:
    return tuple(e for e in world.entities.values() if isinstance(e, VirtualRobot))


def _real_poses(world: World) -> Floats:
    """Where real robots and tagged things stand, (n, 3); those nowhere are far away."""
    rows = []
    for poses in (world.robots[: world.real_robots], world.objects):
        there = recent(poses, world.capture_ns, BODY_MEMORY_NS)
        rows.append(np.stack([np.where(there, poses[k], _FAR_M) for k in ("x_m", "y_m")], axis=1))
    places = np.concatenate(rows)
    return np.column_stack((places, np.zeros(len(places))))
