"""What a simulated run leaves behind: its trajectories, and its picture."""

from __future__ import annotations

from pathlib import Path

import cv2

from vsense.config.specs import Experiment
from vsense.errors import VsenseError
from vsense.pictures import story
from vsense.pictures.canvas import Image
from vsense.pictures.story import Story
from vsense.sim.job import Job
from vsense.sim.simulation import Simulation

TRAJECTORY = "trajectory.npz"


def save(run: Simulation, experiment: Experiment, job: Job, directory: Path) -> None:
    """Writes `TRAJECTORY` and the picture of a run that has an album.

    Raises:
        VsenseError: a file cannot be written.
    """
    run.record.save(directory / TRAJECTORY)
    path = directory / f"{experiment.name}.png"
    if not cv2.imwrite(str(path), draw(run, experiment, job)):
        raise VsenseError(f"{path}: cannot be written")


def draw(run: Simulation, experiment: Experiment, job: Job) -> Image:
    """Draws the picture of a run that has an album; without cameras nothing lies beneath it."""
    assert run.album is not None
    record, truth = run.record, run.record.truth
    told = Story(
        experiment,
        record.timesteps["run_timestep"],
        truth.poses,
        truth.lit,
        None if truth.depth_m is None else truth.depth_m >= 0,
        record.turn,
        run.album,
    )
    heading = f"{experiment.name}{', blind' if job.setup.blind else ''}"
    subtitle = f"{len(record.tags)} simulated robots, seed {job.seed}"
    return story.draw(told, heading, subtitle, lambda timestep: None)
