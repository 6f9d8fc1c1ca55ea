"""Carries a calibration out: all robots' routines, in a lab or with real robots.

What stops a run stops a calibration: Ctrl-C, the page, `vsense control stop`. Whatever fails, the
robots are told to stand, and where nobody tells them anything any more they stand by themselves.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsense.modes.live.session import ExperimentSession
from vsense.robots.link.status import RobotStatus
from vsense.tools.robot_calibration._commanding import WheelsWanted
from vsense.tools.robot_calibration._motion_fit import BadFit, MotionFit
from vsense.tools.robot_calibration._places import FreeFloor
from vsense.tools.robot_calibration._routine import (
    Acting,
    Moment,
    MotionRoutine,
    RobotFailed,
    Speeds,
)
from vsense.tools.robot_calibration._sensing import Sensing, SensorRoutine
from vsense.tools.robot_calibration._sensor_fit import SensorFit

STUCK_S = 20.0
"""Where everybody waits for room for so long, nobody will ever have it."""


class SwarmCalibration:
    """Robots that are calibrated, each in its own time.

    Attributes:
        failed: by tag, why a robot is left out.
        routines: of all robots, by tag.
    """

    def __init__(
        self, tags: Sequence[int], floor: FreeFloor, sensing: Sensing | None = None
    ) -> None:
        """Robots on a floor; `sensing`: their sensors are measured, too."""
        self.failed: dict[int, str] = {}
        self.routines: dict[int, MotionRoutine] = {
            tag: MotionRoutine(tag, floor)
            if sensing is None
            else SensorRoutine(tag, floor, sensing)
            for tag in tags
        }
        self._acting: dict[int, Acting] = {tag: r.run() for tag, r in self.routines.items()}
        for acting in self._acting.values():
            next(acting)
        self._busy_s: float | None = None

    @property
    def is_over(self) -> bool:
        """Whether all robots are done or left out."""
        return not self._acting

    @property
    def fits(self) -> dict[int, MotionFit]:
        """What was found, by tag."""
        return {t: r.result for t, r in self.routines.items() if r.result is not None}

    def sensors_of(self, tag: int, cut: str) -> tuple[Mapping[str, SensorFit], Mapping[str, str]]:
        """What was found of a robot's sensors, and what was not and why; `cut`: all were ended."""
        routine = self.routines[tag]
        if not isinstance(routine, SensorRoutine):
            return {}, {}
        missing = set(routine.wanted) - routine.sensors.keys() - routine.troubles.keys()
        why = self.failed.get(tag, cut)
        return routine.sensors, routine.troubles | dict.fromkeys(sorted(missing), why)

    def step(self, moments: Mapping[int, Moment]) -> dict[int, Speeds]:
        """Takes a timestep; gives the speeds of all wheels that shall turn."""
        speeds = {}
        for tag in sorted(self._acting, key=lambda tag: not self.routines[tag].waits):
            try:
                speeds[tag] = self._acting[tag].send(moments[tag])
            except StopIteration:
                self._end(tag)
            except (RobotFailed, BadFit) as error:
                self.leave_out(tag, str(error))
        self._look_for_room(max((moment.time_s for moment in moments.values()), default=0.0))
        return {
            tag: wheels for tag, wheels in speeds.items() if tag in self._acting and any(wheels)
        }

    def leave_out(self, tag: int, why: str) -> None:
        """A robot is calibrated no further."""
        self.failed[tag] = why
        self._end(tag)

    def progress(self) -> str:
        """A line for people."""
        doing = Counter(self.routines[tag].doing for tag in self._acting)
        parts = [f"{count} {what}" for what, count in sorted(doing.items())]
        parts += [f"{len(self.failed)} left out"] if self.failed else []
        done = len(self.routines) - len(self._acting) - len(self.failed)
        return f"{done} of {len(self.routines)} calibrated  {'  '.join(parts)}"

    def _end(self, tag: int) -> None:
        self.routines[tag].stop()
        del self._acting[tag]

    def _look_for_room(self, now_s: float) -> None:
        """Leaves out those that wait for what will not come."""
        waiting = [tag for tag in self._acting if self.routines[tag].waits]
        if len(waiting) < len(self._acting) or not waiting or self._busy_s is None:
            self._busy_s = now_s
        elif now_s - self._busy_s > STUCK_S:
            for tag in waiting:
                self.leave_out(tag, self.routines[tag].needs)


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
            readings = {} if sensing is None else sensing.readings.newest
            now, robots = step.capture_ns, runner.robots
            moments = {t: _moment(now, seen.get(t), robots[t], readings.get(t, {})) for t in tags}
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
