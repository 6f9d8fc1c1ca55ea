"""A simulated run timestep by timestep, and the tracker's errors that its arena states carry."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsense.arena import POSE, ArenaState, wrap_angle
from vsense.config.specs import Experiment
from vsense.errors import VsenseError, failing_as
from vsense.lab import metrics
from vsense.link.robots.status import RING_LEDS
from vsense.link.robots.wire import Shown
from vsense.pictures.run_figure import RunFigure
from vsense.pictures.run_samples import RunSamples
from vsense.recording.form import EVENTS, SHOWN, changes

Floats = NDArray[np.float64]

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
    """Makes arena states of true poses."""

    def __init__(self, tags: Sequence[int], seed: int) -> None:
        """`tags` come in the order of the poses; `seed` is that of the errors."""
        self._order = np.argsort(np.asarray(tags, dtype=np.uint32))
        self._random = np.random.default_rng([seed, _STREAM])
        self._errors = np.zeros((0, len(tags), 3))
        self._used = 0
        self._states = np.zeros(len(tags), dtype=POSE)
        self._states["tag"] = np.asarray(tags)[self._order]
        self._states["confidence"] = 1.0
        self._states["cameras"] = 1
        self._states["seen"] = True
        self._last: tuple[Floats, int] | None = None

    def update(self, poses: Floats, timestep: int, capture_ns: int) -> ArenaState:
        """Sees all true poses (n, 3) x_m, y_m, yaw_rad in (-pi, pi] at a later time than before."""
        if self._used == len(self._errors):
            self._errors = self._random.standard_normal((_BLOCK, len(self._states), 3))
            self._errors *= (POSITION_STD_M, POSITION_STD_M, HEADING_STD_RAD)
            self._used = 0
        robots = self._states.copy()
        seen = poses[self._order] + self._errors[self._used]
        self._used += 1
        x_m, y_m, yaw_rad = seen.T
        robots["x_m"], robots["y_m"], robots["yaw_rad"] = x_m, y_m, yaw_rad
        if np.abs(yaw_rad).max(initial=0.0) > np.pi:
            robots["yaw_rad"] = wrap_angle(yaw_rad)
        robots["capture_ns"] = capture_ns
        if self._last is not None:
            before, before_ns = self._last
            east_m, north_m, _ = (seen - before).T
            robots["speed_m_s"] = np.hypot(east_m, north_m) / (1e-9 * (capture_ns - before_ns))
        self._last = seen, capture_ns
        return ArenaState(timestep, capture_ns, robots, len(robots))


TRAJECTORY = "trajectory.npz"


class Record:
    """A run, timestep by timestep, at the times of capture.

    Attributes:
        timesteps: (n,) from 0.
        poses: (n, bodies, 3) true x_m, y_m, yaw_rad: robots, then objects.
        leds: (n, robots) uint16, bits 0-7 ring, 8 body, 9 front.
        share: (n,) how much was left of the first pollutant source, 1 where there is none.
        events: what controllers logged, in words, and when [s].
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
        self._shown: list[tuple[float, int, str, float | str | None]] = []
        self._showing: dict[int, dict[str, float | str]] = {}

    def end(self, timesteps: int) -> None:
        """Ends the run after so many timesteps, before its length is over."""
        self.timesteps, self.share = self.timesteps[:timesteps], self.share[:timesteps]
        self.poses, self.leds = self.poses[:timesteps], self.leds[:timesteps]

    def note(self, timestep: int, poses: Floats, leds: NDArray[np.uint16], share: float) -> None:
        """Sets the row of a timestep, from 0; see the class."""
        self.poses[timestep], self.leds[timestep], self.share[timestep] = poses, leds, share

    def note_event(self, timestep: int, text: str) -> None:
        """Adds what a controller logged in a timestep."""
        self.events.append((self._time_s(timestep), text))

    def note_shown(self, timestep: int, tag: int, values: Shown) -> None:
        """Takes all values that a robot shows from a timestep on; those that change are kept."""
        before, now = self._showing.get(tag, {}), dict(values)
        self._showing[tag] = now
        time_s = self._time_s(timestep)
        self._shown += [(time_s, tag, name, value) for name, value in changes(before, now)]

    def _time_s(self, timestep: int) -> float:
        return round(timestep * self._experiment.timestep_s, 9)

    @cached_property
    def truth(self) -> metrics.SwarmTruth:
        robots, experiment = len(self.tags), self._experiment
        depth_m = metrics.depths_in_cone(experiment, self.poses, self.timesteps, self.share)
        return metrics.SwarmTruth(self.poses[:, :robots], depth_m, (self.leds & RING_LEDS) != 0)

    def swarm(self) -> dict[str, int | None]:
        """See `metrics.swarm`."""
        return metrics.swarm(self.truth, self.timesteps, self._experiment.turn_timestep)

    def save(self, path: Path) -> None:
        """Writes the trajectories: an .npz file that NumPy reads.

        It holds time_s (n,), tags (robots,), controllers (robots,), their ids, object_tags
        (objects,), poses (n, robots, 3) and object_poses (n, objects, 3) of x_m, y_m, yaw_rad, and
        leds (n, robots).

        Raises:
            VsenseError: the file cannot be written.
        """
        robots = len(self.tags)
        try:
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
        except OSError as error:
            raise VsenseError(f"{path}: cannot be written: {error.strerror}") from None

    def save_notes(self, directory: Path) -> None:
        """Writes what controllers showed and logged: shown.csv and events.csv, as of an export.

        Raises:
            VsenseError: a file cannot be written.
        """
        events = [(time_s, "info", "", text) for time_s, text in self.events]
        for name, head, rows in (
            ("shown", SHOWN, self._shown),
            ("events", EVENTS, events),
        ):
            path = directory / f"{name}.csv"
            with (
                failing_as(VsenseError, f"{path}: cannot be written"),
                path.open("w", encoding="utf-8", newline="") as file,
            ):
                csv.writer(file).writerows([head, *rows])

    def figure(self, samples: RunSamples) -> RunFigure:
        """The run as `run_figure` draws it."""
        return self.truth.figure(self._experiment, self.timesteps, samples)
