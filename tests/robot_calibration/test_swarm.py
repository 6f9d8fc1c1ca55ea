"""Many robots at once, in the physics in C, seen and told with a delay."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from vsense.config.experiment import load
from vsense.config.specs import Pose, Stage
from vsense.lab.hardware import HardwareErrors, RobotHardware, draw, to_markers
from vsense.physics.motion import Physics, obstacles
from vsense.robot_calibration.areas import FreeFloor
from vsense.robot_calibration.commanding import WheelsWanted, commanded
from vsense.robot_calibration.routine import Moment
from vsense.robot_calibration.swarm import SwarmCalibration

ERRORS = HardwareErrors(0.004, math.radians(5.0), 0.05)
TIMESTEP_NS = 100_000_000
DELAY = 2
"""Timesteps between a picture and what robots are told because of it."""


class Arena:
    """The foraging experiment's arena with robots at places of the test's own."""

    def __init__(self, places: list[tuple[float, float]]) -> None:
        experiment = load("foraging", stage=Stage.LAB)
        robots = experiment.robots[: len(places)]
        self.experiment = commanded(experiment, WheelsWanted())
        self.tags = [robot.tag for robot in robots]
        self.poses = [Pose(*place, 0.7 * number) for number, place in enumerate(places)]
        self.built: list[RobotHardware] = [draw(tag, ERRORS) for tag in self.tags]
        self.change: Callable[[int, int, Moment], Moment] = lambda tag, timestep, moment: moment
        self.nearest_m = math.inf
        self.swarm = SwarmCalibration(self.tags, FreeFloor(self.experiment))

    def run(self, most: int = 3000) -> SwarmCalibration:
        """Drives until all robots are done."""
        boxes, posts = obstacles(self.experiment.boxes, self.experiment.cylinders)
        wheels = np.array([(one.left, one.right, one.axle_m) for one in self.built])
        physics = Physics(self.poses, [], boxes, 0, posts, wheels)
        offsets = np.array(
            [(one.marker.x_m, one.marker.y_m, one.marker.yaw_rad) for one in self.built]
        )
        told = [dict.fromkeys(self.tags, (0, 0))] * DELAY
        for timestep in range(most):
            if self.swarm.is_over:
                return self.swarm
            for row, tag in enumerate(self.tags):
                physics.drive(row, *told[-DELAY].get(tag, (0, 0)), timestep * TIMESTEP_NS)
            markers = to_markers(physics.poses, offsets).tolist()
            moments = {
                tag: self.change(
                    tag,
                    timestep,
                    Moment(timestep / 10.0, tuple(pose), told[-DELAY].get(tag, (0, 0)), True),
                )
                for tag, pose in zip(self.tags, markers)
            }
            told.append(self.swarm.step(moments))
            physics.advance((timestep + 1) * TIMESTEP_NS)
            self._measure(physics.poses)
        raise AssertionError(self.swarm.progress())

    def _measure(self, poses: np.ndarray) -> None:
        between = poses[:, None, :2] - poses[None, :, :2]
        far = np.hypot(between[..., 0], between[..., 1]) + 9.0 * np.eye(len(poses))
        self.nearest_m = min(self.nearest_m, float(far.min()))

    def check(self, tag: int) -> None:
        """A robot is known as well as the issue wants it."""
        found, true = self.swarm.found[tag], self.built[self.tags.index(tag)]
        off_m = math.hypot(found.marker.x_m - true.marker.x_m, found.marker.y_m - true.marker.y_m)
        assert off_m < 0.001
        assert abs(found.marker.yaw_rad - true.marker.yaw_rad) < math.radians(0.5)
        assert found.wheel_diameter_mm == pytest.approx(true.wheel_diameter_mm, rel=0.01)
        assert found.wheel_ratio == pytest.approx(true.wheel_ratio, rel=0.01)


def test_robots_are_calibrated_at_once_and_touch_nobody() -> None:
    # Two stand 8 cm apart, two in each other's way.
    arena = Arena([(0.0, 0.0), (0.08, 0.0), (0.0, 0.4), (0.15, 0.4), (-0.6, 0.3)])
    swarm = arena.run()
    assert not swarm.failed
    for tag in arena.tags:
        arena.check(tag)
    assert arena.nearest_m > 0.0705


def test_who_does_not_do_as_told_is_named_and_the_others_go_on() -> None:
    arena = Arena([(0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5), (-0.5, 0.0)])
    silent, unseen, held, lost, fine = arena.tags

    def change(tag: int, timestep: int, moment: Moment) -> Moment:
        if tag == silent:
            return Moment(moment.time_s, moment.pose, (0, 0), False)
        if tag == unseen or (tag == lost and timestep > 60):
            return Moment(moment.time_s, None, moment.motors, True)
        if tag == held:
            return Moment(moment.time_s, (0.0, 0.5, 1.0), moment.motors, True)
        return moment

    arena.change = change
    swarm = arena.run()
    arena.check(fine)
    assert set(swarm.found) == {fine}
    words = {silent: "does not answer", unseen: "is not seen", lost: "was not seen for 1 s"}
    for tag, text in words.items():
        assert text in swarm.failed[tag]
    assert held in swarm.failed


def test_moments_in_which_a_robot_stands_are_left_out() -> None:
    arena = Arena([(0.0, 0.0)])
    tag = arena.tags[0]
    random, stood = np.random.default_rng(3), [0.0]

    def change(tag: int, timestep: int, moment: Moment) -> Moment:
        # Every now and then its clock gains on it: as if it had stood for a moment.
        stood[0] += 0.05 if random.random() < 0.05 else 0.0
        return Moment(moment.time_s + stood[0], moment.pose, moment.motors, True)

    arena.change = change
    arena.run()
    arena.check(tag)


def test_a_robot_without_room_waits_and_is_named_in_the_end() -> None:
    ring = [
        (0.075 * math.cos(k * math.pi / 3), 0.075 * math.sin(k * math.pi / 3)) for k in range(6)
    ]
    arena = Arena([(0.0, 0.0), *map(tuple, ring)])
    middle = arena.tags[0]
    # The others never move: nobody hears them.
    arena.change = lambda tag, timestep, moment: (
        moment if tag == middle else Moment(moment.time_s, moment.pose, (0, 0), False)
    )
    swarm = arena.run()
    assert "has no room" in swarm.failed[middle]
    assert set(swarm.failed) == set(arena.tags)


@pytest.mark.parametrize("lacks", [{"pose": None}, {"connected": False}])
def test_who_makes_room_unseen_or_unheard_does_not_drive_on(lacks: dict) -> None:
    """Two that stand close: one drives away before it turns."""
    arena = Arena([(0.0, 0.0), (0.085, 0.0)])

    def hide(tag: int, timestep: int, moment: Moment) -> Moment:
        away = arena.swarm.routines[tag].doing == "making room"
        return replace(moment, **lacks) if away else moment

    arena.change = hide
    failed = arena.run().failed.values()
    assert any("for 1 s while it was making room" in why for why in failed), failed
