"""A simulated run timestep by timestep, and the tracker's errors that its arena states carry."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import POSE, ArenaState, Floats
from vsense.base.errors import VsenseError, failing_as
from vsense.base.native import kernel_ffi, kernels, pointer
from vsense.base.terminal import Level
from vsense.config.specs import Experiment
from vsense.modes.lab import _metrics
from vsense.monitor.pictures.run_samples import RunSamples
from vsense.monitor.recording import EVENTS, SHOWN, changes
from vsense.robots.link.status import RING_LEDS
from vsense.robots.link.wire import ShownData
from vsense.world.sightings import POSE_FIELDS
from vsense.world.world import World

if TYPE_CHECKING:
    from vsense.monitor.pictures.run_figure import RunFigure


POSITION_STD_M = 26e-6
"""Standard deviation of a tracked position along each axis: 0.037 mm in all, as in the lab.
Source: `tracking.position_rmse_mm` of `vsense lab pollutant --json`, 120 s, seeds 1 to 3."""

HEADING_STD_RAD = 1.1e-3
"""That of a tracked heading: 0.062 degrees. Source: `tracking.heading_rmse_deg` there."""

_STREAM = 1
"""Separates these random numbers from the others that follow from a run's seed."""

_BLOCK = 256
"""Errors of so many timesteps are drawn at once: one call costs as much as ten of them."""


class SimulatedTracker:
    """Makes arena states of true poses; `cdata` is the `struct vs_tracker *`."""

    def __init__(self, tags: Sequence[int], seed: int) -> None:
        """`tags` come in the order of the poses; `seed` is that of the errors."""
        order = np.argsort(np.asarray(tags, dtype=np.uint32))
        self._random = np.random.default_rng([seed, _STREAM])
        self._errors = np.zeros((0, len(tags), 3))
        self._used = 0
        self._states = np.zeros(len(tags), dtype=POSE)
        self._states["tag"] = np.asarray(tags)[order]
        self._states["confidence"] = 1.0
        self._states["cameras"] = 1
        self._states["seen"] = True
        self._keep_alive = order.astype(np.uint32), np.zeros((len(tags), 3))
        self.cdata: Any = kernel_ffi.new("struct vs_tracker *")
        self.cdata.fields, self.cdata.count = POSE_FIELDS, len(tags)
        self.cdata.order = pointer("uint32_t", self._keep_alive[0])
        self.cdata.last, self.cdata.last_ns = pointer("double", self._keep_alive[1]), -1
        self.cdata.states = pointer("uint8_t", self._states)

    def update(self, poses: Floats, timestep: int, capture_ns: int) -> ArenaState:
        """Sees all true poses (n, 3) x_m, y_m, yaw_rad in (-pi, pi] at a later time than before."""
        errors = pointer("double", self.errors()[0])
        kernels.vs_tracker_see(self.cdata, pointer("double", poses), errors, capture_ns)
        self.use(1)
        return self.newest(timestep, capture_ns)

    def newest(self, timestep: int, capture_ns: int) -> ArenaState:
        """Gives what was seen last, at that time."""
        robots = self._states.copy()
        return ArenaState(timestep, capture_ns, robots, len(robots))

    def errors(self) -> Floats:
        """Errors of the timesteps to come, (k, n, 3), one at least."""
        if self._used == len(self._errors):
            self._errors = self._random.standard_normal((_BLOCK, len(self._states), 3))
            self._errors *= (POSITION_STD_M, POSITION_STD_M, HEADING_STD_RAD)
            self._used = 0
        return self._errors[self._used :]

    def use(self, timesteps: int) -> None:
        """So many timesteps' errors have been used."""
        self._used += timesteps


class EventLog:
    """The events of a run in a file, as of an export: each is there at once, come what may."""

    def __init__(self, path: Path) -> None:
        """Begins or continues it; VsenseError if it cannot be written, here and in `add`."""
        self._path = path
        with failing_as(VsenseError, f"{path}: cannot be written"):
            self._file = path.open("a", encoding="utf-8", errors="replace", newline="")
            if not self._file.tell():
                csv.writer(self._file).writerow(EVENTS)
                self._file.flush()

    def add(self, time_s: float, text: str, level: Level = "info") -> None:
        """Adds an event."""
        with failing_as(VsenseError, f"{self._path}: cannot be written"):
            csv.writer(self._file).writerow((time_s, level, "", text))
            self._file.flush()

    def close(self) -> None:
        """There are no more."""
        self._file.close()


class SimulationRecord:
    """A run, timestep by timestep, at the times of capture.

    Attributes:
        timesteps: (n,) from 0.
        poses: (n, bodies, 3) true x_m, y_m, yaw_rad: robots, then objects.
        leds: (n, robots) uint16, bits 0-7 ring, 8 body, 9 front.
        share: (n,) how much was left of the first pollutant source, 1 where there is none.
        events: what controllers logged, in words, and when [s].
        showing: the values that each robot shows now, by tag and name.
    """

    def __init__(self, experiment: Experiment) -> None:
        timesteps = experiment.timesteps
        self.tags = tuple(robot.tag for robot in experiment.robots)
        self.object_tags = tuple(thing.tag for thing in experiment.objects)
        self.timesteps = np.arange(timesteps)
        self.poses = np.zeros((timesteps, len(self.tags) + len(self.object_tags), 3))
        self.leds = np.zeros((timesteps, len(self.tags)), dtype=np.uint16)
        self.share = np.ones(timesteps)
        self._experiment = experiment
        self.events: list[tuple[float, str]] = []
        self._event_log: EventLog | None = None
        self._shown: list[tuple[float, int, str, float | str | None]] = []
        self.showing: dict[int, dict[str, float | str]] = {}

    def end(self, timesteps: int) -> None:
        """Ends the run after so many timesteps, before its length is over."""
        self.timesteps, self.share = self.timesteps[:timesteps], self.share[:timesteps]
        self.poses, self.leds = self.poses[:timesteps], self.leds[:timesteps]

    def note(self, timestep: int, poses: Floats, leds: NDArray[np.uint16]) -> None:
        """Sets the row of a timestep, from 0; see the class."""
        self.poses[timestep], self.leds[timestep] = poses, leds

    def note_event(self, timestep: int, text: str) -> None:
        """Adds what a controller logged in a timestep; at once to the file, if there is one."""
        time_s = self._time_s(timestep)
        self.events.append((time_s, text))
        if self._event_log is not None:
            self._event_log.add(time_s, text)

    def keep_events(self, path: Path) -> None:
        """Begins the file of the events: it has all until the moment in which the process crashes.

        Raises:
            VsenseError: it cannot be written.
        """
        self._event_log = EventLog(path)

    def note_shown(self, timestep: int, tag: int, values: ShownData) -> None:
        """Takes all values that a robot shows from a timestep on; those that change are kept."""
        before, now = self.showing.get(tag, {}), dict(values)
        self.showing[tag] = now
        time_s = self._time_s(timestep)
        self._shown += [(time_s, tag, name, value) for name, value in changes(before, now)]

    def _time_s(self, timestep: int) -> float:
        return round(timestep * self._experiment.timestep_s, 9)

    @cached_property
    def truth(self) -> _metrics.SwarmTruth:
        robots, experiment = len(self.tags), self._experiment
        depth_m = _metrics.depths_in_cone(experiment, self.poses, self.timesteps, self.share)
        return _metrics.SwarmTruth(self.poses[:, :robots], depth_m, (self.leds & RING_LEDS) != 0)

    def swarm(self) -> dict[str, int | None]:
        """See `metrics.swarm`."""
        return _metrics.swarm(self.truth, self.timesteps, self._experiment.turn_timestep)

    def save(self, path: Path) -> None:
        """Writes the trajectories: an .npz file that NumPy reads.

        It holds time_s (n,), tags (robots,), controllers (robots,), their ids, object_tags
        (objects,), poses (n, robots, 3) and object_poses (n, objects, 3) of x_m, y_m, yaw_rad, and
        leds (n, robots).

        Raises:
            VsenseError: the file cannot be written.
        """
        robots = len(self.tags)
        with failing_as(VsenseError, f"{path}: cannot be written"):
            np.savez(
                path,
                time_s=self.timesteps * self._experiment.timestep_s,
                tags=np.array(self.tags, dtype=np.uint32),
                controllers=np.array([r.controller for r in self._experiment.robots]),
                object_tags=np.array(self.object_tags, dtype=np.uint32),
                poses=self.poses[:, :robots],
                object_poses=self.poses[:, robots:],
                leds=self.leds,
            )

    def save_notes(self, directory: Path) -> None:
        """Writes what controllers showed: shown.csv, as of an export.

        Raises:
            VsenseError: the file cannot be written.
        """
        path = directory / "shown.csv"
        with (
            failing_as(VsenseError, f"{path}: cannot be written"),
            path.open("w", encoding="utf-8", newline="") as file,
        ):
            csv.writer(file).writerows([SHOWN, *self._shown])

    def figure(self, samples: RunSamples, world: World) -> RunFigure:
        """The run as `run_figure` draws it; `world` is that at its end."""
        from vsense.modes.lab._reach import drawn  # with all that draws: few runs have a picture

        part = drawn(world, self._experiment.arena, self.poses)
        return self.truth.figure(self._experiment, self.timesteps, samples, part)
