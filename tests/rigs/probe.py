"""Whether the devices that an experiment declares are served: moves what each senses, and looks.

    python -m tests.rigs.probe FILE.argos...

A robot of each controller stands alone in the empty arena of `vsense sim`. For each of its sensors
something is put near it and moved: its reading has to follow, and where its element asks for noise
that ARGoS's device has, it has to differ from timestep to timestep. What an actuator is told has to
show in the world. The robot's own devices in simulation are told apart.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vsense.base.arena import POSE, ArenaState
from vsense.base.errors import VsenseError
from vsense.config.experiment import load
from vsense.config.specs import DeviceSpec, Experiment, Pose, Stage
from vsense.run.environment import Environment
from vsense.world.entities import Box, Light, VirtualRobot
from vsense.world.fields import Floor
from vsense.world.world import World

OWN = "own"
"""Verdict on a device that the robot has of its own in simulation, too: wheels, LEDs, its ring."""
CONSTANT = "constant, as in ARGoS"
FOLLOWS = "follows"
NOT_SERVED = "not served"

_HERE = Pose(0.0, 0.0, 0.3)
_OTHER, _OTHER_TAG = "probe", 0x10000
_NOISE = ("noise_level", "noise_std_dev", "real_range_noise")


class Verdict(NamedTuple):
    """What was found about a device of a controller."""

    controller: str
    device: DeviceSpec
    found: str

    @property
    def served(self) -> bool:
        return self.found in (OWN, FOLLOWS, CONSTANT)


def probe(experiment: Experiment) -> list[Verdict]:
    """Tries every device that the controllers of an experiment declare."""
    return [
        Verdict(controller.id, device, _Stand(experiment, controller.id).judge(device))
        for controller in experiment.controllers
        for device in controller.devices
    ]


class _Stand:
    """A robot of a controller, a virtual one beside it, and nothing else."""

    def __init__(self, experiment: Experiment, controller: str) -> None:
        robot = next(
            (r for r in experiment.robots if r.controller == controller), experiment.robots[0]
        )
        robot = replace(robot, pose=_HERE, distribution=None, controller=controller)
        other = VirtualRobot(_OTHER, _OTHER_TAG, 0.2, 0.1)
        alone = replace(
            experiment,
            robots=(robot,),
            objects=(),
            entities=(other,),
            distributed=(),
            loop_functions=None,
            floor=None,
        )
        self._tag = robot.tag
        self._environment = Environment(alone, 1)
        self._timestep = 0
        self._told = b""

    @property
    def world(self) -> World:
        return self._environment.world

    def judge(self, device: DeviceSpec) -> str:
        if not device.served:
            return NOT_SERVED
        if "the robot's own" in device.server:
            return OWN
        name = device.server.partition("'")[2].partition("'")[0]
        if device.section == "actuators":
            return self._judge_actuator(name)
        if name == "battery":
            return CONSTANT
        return self._judge_sensor(name, any(word in device.server for word in _NOISE))

    def _judge_sensor(self, name: str, noisy: bool) -> str:
        move = _SOURCES.get(name, _move_robot)
        seen = []
        for place in move(self):
            readings = np.array([self.read(name, place) for _ in range(10)])
            # Messages come in any order and may be lost, and blobs are sorted.
            if noisy and (readings == readings[0]).all():
                return "mounted, without its noise"
            seen.append(readings.mean(axis=0))
        return FOLLOWS if not np.allclose(*seen, atol=1e-4) else "mounted, but constant"

    def _judge_actuator(self, name: str) -> str:
        own = next(some for some in self._environment.equipment if self._tag in some.tags)
        self._told = b"\x01" * self._sizes()[self._tag]
        before = _shown(self.world)
        self.read(None, _HERE)
        known = any(entry.name == name for entry in own.actuators.table)
        return FOLLOWS if known and before != _shown(self.world) else "mounted, without effect"

    def _sizes(self) -> dict[int, int]:
        """Bytes that each robot reports, by its tag."""
        return {
            tag: sum(entry.size for entry in equipment.actuators.table)
            for equipment in self._environment.equipment
            for tag in equipment.tags
        }

    def read(self, name: str | None, pose: Pose) -> Any:
        """Does a timestep with the robot there; gives a sensor's reading."""
        self._timestep += 1
        capture_ns = (self._timestep + 10) * self._environment.experiment.timestep_ns
        poses = np.zeros(1, dtype=POSE)
        poses["tag"], poses["seen"], poses["capture_ns"] = self._tag, True, capture_ns
        poses["x_m"], poses["y_m"], poses["yaw_rad"] = pose
        state = ArenaState(self._timestep, capture_ns, poses, 1)
        reports = {self._tag: self._told} if self._told else {}
        # The other one is silent otherwise.
        if tell := self._sizes().get(_OTHER_TAG):
            reports[_OTHER_TAG] = b"\x02" * tell
        values = self._environment.step(state, self._timestep, reports)[self._tag]
        table = next(some for some in self._environment.equipment if self._tag in some.tags)
        for entry, (value, _) in zip(table.sensors.table, values):
            if entry.name == name:
                kind = entry.layout.rpartition("*")[2]
                return np.frombuffer(value, dtype=f"<{kind}").astype(np.float64)
        assert name is None, name
        return None


def _shown(world: World) -> bytes:
    fields = b"".join(field.amounts.tobytes() for field in world.fields.values())
    return world.leds.tobytes() + world.led_colors.tobytes() + world.messages.tobytes() + fields


def _move_robot(stand: _Stand) -> Iterator[Pose]:
    yield _HERE
    yield Pose(0.11, -0.07, 1.2)


def _move_light(stand: _Stand) -> Iterator[Pose]:
    for x_m in (0.4, -0.4):
        stand.world.put(Light("probe-light", (x_m, 0.1, 0.3), 1.0))
        yield _HERE


def _move_box(stand: _Stand) -> Iterator[Pose]:
    for x_m in (0.065, 0.5):
        stand.world.put(Box("probe-box", (x_m, 0.0, 0.0), (0.02, 0.3, 0.1)))
        yield _HERE


def _move_other(stand: _Stand) -> Iterator[Pose]:
    row = 1
    for place in ((0.1, 0.05), (-0.06, 0.09)):
        stand.world.move(_OTHER, *place)
        stand.world.led_colors[row] = stand.world.leds[row] = 200
        stand.world.messages["length"][row], stand.world.messages["data"][row] = 4, 7
        yield _HERE


def _change_floor(stand: _Stand) -> Iterator[Pose]:
    for grey in (0, 200):
        stand.world.floor = Floor(np.full((4, 4, 3), grey, dtype=np.uint8), (4.0, 4.0))
        yield _HERE


_SOURCES: dict[str, Callable[[_Stand], Iterator[Pose]]] = {
    "ground": _change_floor,
    "rgb_ground": _change_floor,
    "light": _move_light,
    "proximity": _move_box,
    "+proximity": _move_box,
    "range_and_bearing": _move_other,
    "omnidirectional_camera": _move_other,
    "leds": _move_other,
}
"""By the sensor's name what moves what it senses, between two readings."""


def main() -> int:
    """Prints a line for every device of the files, and how many files are served whole."""
    whole = 0
    for file in sys.argv[1:]:
        try:
            verdicts = probe(load(Path(file), stage=Stage.SIM))
        except VsenseError as error:
            print(f"{file}: {error}")
            continue
        whole += all(verdict.served for verdict in verdicts)
        for controller, device, found in verdicts:
            print(f"{file}: {controller} {device.section} <{device.element}>: {found}")
    print(f"{whole} of {len(sys.argv) - 1} files have every device served")
    return 0


if __name__ == "__main__":
    sys.exit(main())
