"""Records the lab's pictures of a wandering swarm, for `vsense camera track` in place of cameras.

It does not run in real time; random wheel speeds drive the robots instead of daemons. The same seed
gives the same recording.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Frame
from vsense.base.errors import failing_as
from vsense.config.placement import settle
from vsense.config.specs import Experiment
from vsense.modes.lab._camera_spec import LabCameraSpec, spec_for
from vsense.modes.lab._optics import SAMPLES, sample_times_ns
from vsense.modes.lab._renderer import Studio
from vsense.monitor.recording.pictures import (
    PictureRecorder,
    PictureRecordingError,
    one_tracker,
    write_session_files,
)
from vsense.run.environment import physics_of
from vsense.world.physics.motion import TICK_NS

TRUTH = "truth.csv"

_LEAD_NS = 1_000_000_000
_CRUISE_STEPS_S = (500, 950)
_TURN_STEPS_S = 350
_LEG_TICKS = (30, 200)


class Wanderers:
    """Robots of a settled experiment that drive straight and turn by chance, in true physics."""

    def __init__(self, experiment: Experiment, seed: int) -> None:
        self._robots = len(experiment.robots)
        self._physics = physics_of(experiment, 0)
        self._rng = np.random.default_rng([seed, 9])
        self._legs = np.zeros(self._robots, dtype=np.int64)
        self._turning = np.ones(self._robots, dtype=bool)
        self._now_ns = 0

    def move_to(self, time_ns: int) -> NDArray[np.float64]:
        """Moves to a later time; returns poses (n, 3) of robots, then objects, arena frame."""
        while self._now_ns + TICK_NS <= time_ns:
            self._now_ns += TICK_NS
            self._physics.tick(self._now_ns)
            self._legs -= 1
            for robot in np.flatnonzero(self._legs <= 0):
                self._begin_leg(int(robot))
        if time_ns > self._now_ns:
            self._physics.tick(time_ns)
        return np.array(self._physics.poses, dtype=np.float64)

    def _begin_leg(self, robot: int) -> None:
        """Turns on the spot and drives straight in turn."""
        self._turning[robot] = not self._turning[robot]
        if self._turning[robot]:
            speed = int(self._rng.choice((-_TURN_STEPS_S, _TURN_STEPS_S)))
            self._legs[robot] = self._rng.integers(10, 80)
            self._physics.drive(robot, -speed, speed, self._now_ns)
        else:
            speed = int(self._rng.integers(*_CRUISE_STEPS_S))
            self._legs[robot] = self._rng.integers(*_LEG_TICKS)
            self._physics.drive(robot, speed, speed, self._now_ns)


def record(
    experiment: Experiment,
    directory: Path,
    timesteps: int,
    seed: int,
    suffix: str = "png",
    progress: Callable[[int], None] | None = None,
    spec: LabCameraSpec | None = None,
) -> None:
    """Records the experiment's arena as the lab's cameras see it.

    Args:
        directory: gets `pictures`, `cameras`, `resources.xml`, `experiment.xml`, and the true poses
            in `truth.csv`.
        seed: of poses, ways, floor, litter and noise.
        suffix: format of the pictures.
        progress: called with the number of timesteps done.
        spec: other cameras than the lab's.

    Raises:
        VsenseError: the arena does not fit, or the recording cannot be written.
    """
    experiment = settle(experiment, seed)
    spec = spec or spec_for(experiment, "", seed, Path())
    recorder = PictureRecorder(directory, spec.cameras, suffix)
    heights_m = {body.tag: body.height_m for body in spec.bodies}
    failure = f"{directory}: cannot be written"
    with closing(recorder), failing_as(PictureRecordingError, failure):
        trackers = one_tracker(spec.cameras, spec.family, heights_m)
        write_session_files(directory, spec.cameras, trackers)
        with (directory / TRUTH).open("w", encoding="utf-8") as truth:
            truth.write("timestep,capture_ns,tag,x_m,y_m,yaw_rad\n")
            _record(experiment, spec, recorder, truth, timesteps, progress)


def _record(
    experiment: Experiment,
    spec: LabCameraSpec,
    recorder: PictureRecorder,
    truth: TextIO,
    timesteps: int,
    progress: Callable[[int], None] | None,
) -> None:
    studio = Studio(spec)
    swarm = Wanderers(experiment, spec.seed)
    images = np.zeros(spec.shape, dtype=np.uint8)
    leds = np.zeros(len(spec.bodies), dtype=np.uint16)
    for timestep in range(timesteps):
        capture_ns = _LEAD_NS + timestep * spec.timestep_ns
        moments = sample_times_ns(capture_ns, SAMPLES)
        poses = np.stack([swarm.move_to(moment) for moment in moments])
        studio.prepare(timestep, images)
        studio.expose(timestep, poses, leds, images)
        recorder.write(
            [Frame(c.id, i, timestep, capture_ns, capture_ns) for c, i in zip(spec.cameras, images)]
        )
        for body, (x_m, y_m, yaw_rad) in zip(spec.bodies, poses[SAMPLES // 2]):
            row = f"{timestep},{capture_ns},{body.tag},{x_m:.6f},{y_m:.6f},{yaw_rad:.6f}\n"
            truth.write(row)
        if progress is not None:
            progress(timestep + 1)
