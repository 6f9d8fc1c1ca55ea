"""The picture of a run with real robots: the state that the host knew, at chosen moments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import compress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Frame
from vsense.config.specs import Experiment
from vsense.monitor.pictures import run_figure
from vsense.monitor.pictures.run_cameras import RunCameras
from vsense.monitor.pictures.run_figure import RunFigure
from vsense.monitor.pictures.run_samples import SPARE, RunSamples
from vsense.robots.link.status import RobotStatus
from vsense.vision.cameras.camera import Camera
from vsense.world.sightings import NEVER_NS
from vsense.world.world import World

MOST_TIMESTEPS = 6_000
"""Ten minutes at 10 Hz: of longer runs every second timestep is kept, every fourth, and so on."""


class Portrait:
    """Filled timestep by timestep while a run goes on; `cameras` are our own, in any order."""

    def __init__(self, experiment: Experiment, cameras: Sequence[Camera] = ()) -> None:
        self._experiment = experiment
        self._cameras = RunCameras(cameras, experiment.marker.height_m)
        self._newest = -1
        self._samples = RunSamples(experiment)
        self._source = experiment.source
        self._every = 1
        self._timesteps: list[int] = []
        self._poses: list[NDArray[np.float64]] = []
        self._known: list[NDArray[np.bool_]] = []
        self._lit: list[list[bool]] = []
        self._inside: list[NDArray[np.bool_]] = []

    def add(
        self,
        run_timestep: int,
        world: World,
        robots: Mapping[int, RobotStatus],
        frames: Sequence[Frame] = (),
    ) -> None:
        """Adds a timestep, the links' statuses by tag, and the pictures; `world` is up to date."""
        self._look(run_timestep, frames)
        if run_timestep % self._every and run_timestep not in self._samples.kept:
            return
        rows = world.robots[: len(self._experiment.robots)]
        self._timesteps.append(run_timestep)
        self._poses.append(np.stack([rows[key] for key in ("x_m", "y_m", "yaw_rad")], axis=-1))
        self._known.append(rows["capture_ns"] != NEVER_NS)
        self._lit.append([robots[robot.tag].lit for robot in self._experiment.robots])
        if self._source is not None:
            cone = world.cone(self._source)
            places = self._poses[-1][:, :2]
            outside = np.zeros(len(places), bool)
            self._inside.append(outside if cone is None else cone.contains(places))
        self._samples.add(run_timestep, world)
        if len(self._timesteps) >= MOST_TIMESTEPS:
            self._thin()

    def _look(self, run_timestep: int, frames: Sequence[Frame]) -> None:
        """Copies pictures once in a second, and where a view or the run's end may need them.

        Nobody knows which timestep is the last one of a run that is stopped.
        """
        second = max(round(self._experiment.ticks_per_second), 1)
        last = self._experiment.timesteps - 1
        is_kept = run_timestep in self._samples.kept
        if not frames or not (
            is_kept or run_timestep % second == 0 or last - SPARE < run_timestep <= last
        ):
            return
        if self._newest not in self._samples.kept:
            self._cameras.drop(self._newest)
        self._newest = run_timestep
        self._cameras.keep(run_timestep, frames)

    def _thin(self) -> None:
        """Forgets every other timestep, but for those of a view and the last."""
        self._every *= 2
        last, kept = self._timesteps[-1], self._samples.kept
        stay = [t % self._every == 0 or t in kept or t == last for t in self._timesteps]
        self._timesteps = list(compress(self._timesteps, stay))
        self._poses = list(compress(self._poses, stay))
        self._known = list(compress(self._known, stay))
        self._lit = list(compress(self._lit, stay))
        self._inside = list(compress(self._inside, stay))
        self._samples.thin(stay)

    def draw(self, path: Path, world: World, blind: bool, subtitle: str) -> bool:
        """Draws the picture after the run, into an existing folder; `subtitle` says how it was run.

        False if no robot was ever seen; PictureError if the file cannot be written.
        """
        known = np.array(self._known)
        if not known.any():
            return False
        self._samples.end(world)
        run_figure.save(self._figure(known), path, blind, subtitle)
        return True

    def _figure(self, known: NDArray[np.bool_]) -> RunFigure:
        """The figure of the robots that were seen at all."""
        seen = known.any(axis=0)
        poses = np.array(self._poses)
        # Before a robot was seen for the first time it stands where that was.
        first = known.argmax(axis=0)
        for robot in np.flatnonzero(seen):
            poses[: first[robot], robot] = poses[first[robot], robot]
        return RunFigure(
            self._experiment,
            np.array(self._timesteps, np.int64),
            poses[:, seen],
            np.array(self._lit)[:, seen],
            np.array(self._inside)[:, seen] if self._source is not None else None,
            self._experiment.turn_timestep,
            self._samples,
            cameras=self._cameras,
        )
