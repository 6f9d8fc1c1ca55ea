"""Robots of the lab's physics that are calibrated without pictures: seen and told with a delay."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from vsense.config.experiment import load
from vsense.config.specs import Experiment, Pose, Stage
from vsense.modes.lab._real_sensors import RealGround
from vsense.modes.lab.hardware import HardwareErrors, RobotHardware, draw, to_markers
from vsense.tools.robot_calibration._commanding import WheelsWanted, commanded
from vsense.tools.robot_calibration._driving import SwarmCalibration
from vsense.tools.robot_calibration._places import FreeFloor
from vsense.tools.robot_calibration._routine import Moment
from vsense.tools.robot_calibration._sensing import Sensing
from vsense.world.physics.motion import Physics, obstacles
from vsense.world.physics.proximity_ring import ProximityRing
from vsense.world.robot_models import EPUCK, RobotModel

ERRORS = HardwareErrors(0.004, math.radians(5.0), 0.05, sensor=0.2)
TIMESTEP_NS = 100_000_000
DELAY = 2
"""Timesteps between a picture and what robots are told because of it."""
DISC_M = 0.05


class Arena:
    """The foraging experiment's arena with robots at places of the test's own."""

    def __init__(
        self,
        places: list[tuple[float, float]],
        sensing: Callable[[Experiment], Sensing] | None = None,
        wall_off_m: float = 0.0,
        models: Sequence[RobotModel] = (),
    ) -> None:
        """`wall_off_m`: walls stand farther out than the experiment says; without `models` all are
        e-pucks."""
        experiment = load("foraging", stage=Stage.LAB)
        robots = experiment.robots[: len(places)]
        models = models or [EPUCK] * len(places)
        robots = tuple(replace(robot, model=model) for robot, model in zip(robots, models))
        experiment = replace(experiment, robots=robots)
        self.experiment = commanded(experiment, WheelsWanted())
        self.tags = [robot.tag for robot in robots]
        self.poses = [Pose(*place, 0.7 * number) for number, place in enumerate(places)]
        self.built: list[RobotHardware] = [
            draw(tag, ERRORS, model) for tag, model in zip(self.tags, models)
        ]
        self.change: Callable[[int, int, Moment], Moment] = lambda tag, timestep, moment: moment
        self.nearest_m = self.nearest_wall_m = math.inf
        self.timesteps = 0
        self._wall_off_m = wall_off_m
        self._sensing = None if sensing is None else sensing(self.experiment)
        self._floor = FreeFloor(self.experiment)
        self.swarm = SwarmCalibration(self.tags, self._floor, self._sensing)

    def run(self, most: int = 3000) -> SwarmCalibration:
        """Drives until all robots are done."""
        boxes, posts = obstacles(self.experiment.boxes, self.experiment.cylinders)
        away_m = np.maximum(np.hypot(*boxes[:, :2].T), 1e-9)[:, None]
        boxes[:, :2] *= 1.0 + self._wall_off_m / away_m
        wheels = np.array([(one.left, one.right, one.axle_m) for one in self.built])
        models = [one.model for one in self.built]
        physics = Physics(self.poses, [], boxes, 0, posts, wheels, models)
        offsets = np.array(
            [(one.marker.x_m, one.marker.y_m, one.marker.yaw_rad) for one in self.built]
        )
        read = self._sensors(physics)
        told = [dict.fromkeys(self.tags, (0, 0))] * DELAY
        for timestep in range(most):
            if self.swarm.is_over:
                return self.swarm
            for row, tag in enumerate(self.tags):
                physics.drive(row, *told[-DELAY].get(tag, (0, 0)), timestep * TIMESTEP_NS)
            markers = to_markers(physics.poses, offsets).tolist()
            readings = read()
            moments = {
                tag: self.change(
                    tag,
                    timestep,
                    Moment(
                        timestep / 10.0,
                        tuple(pose),
                        told[-DELAY].get(tag, (0, 0)),
                        True,
                        {name: rows[row] for name, rows in readings.items()},
                    ),
                )
                for row, (tag, pose) in enumerate(zip(self.tags, markers))
            }
            told.append(self.swarm.step(moments))
            physics.advance((timestep + 1) * TIMESTEP_NS)
            self._measure(physics.poses)
            self.timesteps = timestep
        raise AssertionError(self.swarm.progress())

    def _sensors(self, physics: Physics) -> Callable[[], dict[str, np.ndarray]]:
        if self._sensing is None:
            return dict
        sensors = [one.sensors for one in self.built]
        gains, biases = (np.array([getattr(s, n) for s in sensors]) for n in ("gains", "biases"))
        models = [one.model for one in self.built]
        rings = ProximityRing(physics.near, 3, gains, biases, models)
        ground = self._sensing.ground
        black: Sequence = () if ground is None else [(*ground.black, DISC_M)]
        floor = RealGround(black, sensors, 4, models)
        return lambda: {
            "proximity": rings.read(physics.bodies).astype(float),
            "ground": floor.read(physics.poses).astype(float),
        }

    def _measure(self, poses: np.ndarray) -> None:
        between = poses[:, None, :2] - poses[None, :, :2]
        far = np.hypot(between[..., 0], between[..., 1]) + 9.0 * np.eye(len(poses))
        self.nearest_m = min(self.nearest_m, float(far.min()))
        self.nearest_wall_m = min(self.nearest_wall_m, self._floor.clearance_m(poses[:, :2]))

    def check(self, tag: int) -> None:
        """A robot is known as well as the issue wants it."""
        found, true = self.swarm.fits[tag], self.built[self.tags.index(tag)]
        off_m = math.hypot(found.marker.x_m - true.marker.x_m, found.marker.y_m - true.marker.y_m)
        assert off_m < 0.001
        assert abs(found.marker.yaw_rad - true.marker.yaw_rad) < math.radians(0.5)
        assert found.wheel_diameter_mm == pytest.approx(true.wheel_diameter_mm, rel=0.01)
        assert found.wheel_ratio == pytest.approx(true.wheel_ratio, rel=0.01)
