"""Carries a calibration out: timestep by timestep, in a lab or with real robots.

What stops a run stops a calibration: Ctrl-C, the page, `vsense stop`. Whatever fails, the robots
are told to stand, and where nobody tells them anything any more they stand by themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsense.modes.live.session import ExperimentSession
from vsense.robots.link.status import RobotStatus
from vsense.tools.robot_calibration.areas import FreeFloor
from vsense.tools.robot_calibration.commanding import WheelsWanted
from vsense.tools.robot_calibration.routine import Moment
from vsense.tools.robot_calibration.sensing import Sensing
from vsense.tools.robot_calibration.swarm import SwarmCalibration

PATIENCE_S = 20.0
"""Robots are waited for so long; then it begins without those that are missing."""


def drive(
    session: ExperimentSession,
    wheels: WheelsWanted,
    directory: Path,
    progress: Callable[[str], None],
    sensing: Sensing | None = None,
) -> SwarmCalibration:
    """Calibrates all robots of an open session, and has them stand.

    Args:
        session: the robots have been waited for; its controllers obey `wheels`.
        directory: of the session's files.
        progress: takes a line for people, in every timestep.
        sensing: what is measured of sensors; None: nothing.

    Raises:
        VsenseError: something else than a robot has failed.
    """
    experiment, runner = session.experiment, session.runner
    floor = FreeFloor(experiment)
    tags = [robot.tag for robot in experiment.robots]
    swarm = SwarmCalibration(tags, floor, sensing)
    objects = [thing.tag for thing in experiment.objects]
    session.setup.room.begin_run(session.environment, directory)
    try:
        for step in runner.timesteps():
            seen = _seen(step.state.robots)
            floor.places.update({tag: pose[1][:2] for tag, pose in seen.items() if tag in objects})
            told = {} if sensing is None else sensing.readings.newest
            now, robots = step.capture_ns, runner.robots
            moments = {t: _moment(now, seen.get(t), robots[t], told.get(t, {})) for t in tags}
            wheels.speeds = _step(swarm, moments, session)
            progress(swarm.progress())
            if swarm.is_over:
                runner.control.end("time")
    finally:
        wheels.speeds = {}
        session.stop()
        session.setup.room.recorders.end_run()
    return swarm


def _step(
    swarm: SwarmCalibration, moments: dict[int, Moment], session: ExperimentSession
) -> dict[int, tuple[int, int]]:
    """A timestep of all routines; says who is left out."""
    before = set(swarm.failed)
    speeds = swarm.step(moments)
    for tag in sorted(swarm.failed.keys() - before):
        session.setup.console.say(f"robot {tag} is left out: {swarm.failed[tag]}", "warning")
    return speeds


_Pose = tuple[float, float, float]


def _seen(robots: NDArray[np.void]) -> dict[int, tuple[float, _Pose]]:
    """When [s] and where the bodies are that were seen in this timestep."""
    rows = robots[robots["seen"]]
    return {
        int(row["tag"]): (
            float(row["capture_ns"]) * 1e-9,
            (float(row["x_m"]), float(row["y_m"]), float(row["yaw_rad"])),
        )
        for row in rows
    }


def _moment(
    now_ns: int,
    seen: tuple[float, _Pose] | None,
    status: RobotStatus,
    readings: Mapping[str, NDArray[np.float64]],
) -> Moment:
    time_s, pose = (now_ns * 1e-9, None) if seen is None else seen
    telemetry = status.telemetry
    if telemetry is None:
        return Moment(time_s, pose, (0, 0), False)
    motors = telemetry.left_steps_s, telemetry.right_steps_s
    return Moment(time_s, pose, motors, status.connected, readings)
