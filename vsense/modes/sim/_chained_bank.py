"""Sensors and actuators of one controller's robots in timesteps in C: see `_chain`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.native import kernel_ffi, pointer
from vsense.robots.inprocess import ProgramKernel
from vsense.robots.program import Program
from vsense.run.environment import Equipment
from vsense.world.actuators.bank import ActuatorKernel
from vsense.world.rays import MovingBodies
from vsense.world.sensors.bank import SensorKernel
from vsense.world.sensors.geometry import SensedScene
from vsense.world.world import World


class ChainedBank:
    """Sensors and actuators of one controller's robots: those that C reads, and the others.

    Attributes:
        in_c: sensors that C reads.
        in_python: numbers of the others.
        acting_in_c: the actuators that C can apply.
    """

    def __init__(self, world: World, equipment: Equipment, robots: Program | None) -> None:
        """`robots` run the controller; None: there are none."""
        self._world, self._bank, self._actuators = world, equipment.sensors, equipment.actuators
        tags = world.robots["tag"].tolist()
        own = list(equipment.tags)
        first = tags.index(own[0]) if own else 0
        # C takes robots that follow each other in the world.
        self._rows: NDArray[np.intp] | None = None
        if robots is not None and own == tags[first : first + len(own)]:
            self._rows = np.arange(first, first + len(own))
            self._reports = kernel_of(robots).reports
        self.in_c: list[SensorKernel] = []
        self.in_python: list[int] = []
        self.acting_in_c: list[ActuatorKernel] = []
        self._used = 0

    def follow(self, crowd: MovingBodies, used: int) -> None:
        """Takes the world as it is now; see `Chain._follow_world`."""
        self.use(used)
        kernels_of: Sequence[SensorKernel | None] = [None] * len(self._bank.table)
        if self._rows is not None:
            robots = self._robots = self._world.robots[self._rows[0] : self._rows[-1] + 1]
            kernels_of = self._bank.kernels(self._world, robots)
            self._scene = SensedScene(self._world, robots, self._rows, crowd)
        self.in_c = [sensor for sensor in kernels_of if sensor is not None]
        self.in_python = [number for number, sensor in enumerate(kernels_of) if sensor is None]

    def set_rows(self, rows: Any) -> list[NDArray[np.float64]]:
        """Fills the next of the `struct vs_sim_sensor`; gives the noise to come."""
        self._noise = []
        for sensor in self.in_c:
            row, read = next(rows), sensor.read
            row.read = kernel_ffi.addressof(read.library, read.name)
            row.sensor, row.scene, row.sent = read.cdata, self._scene.cdata, sensor.sent
            if sensor.noise is not None:
                self._noise.append(sensor.noise())
                row.noise = pointer("double", self._noise[-1])
        return self._noise

    def actuators(self) -> list[tuple[Any, ...] | None]:
        """Each as a `struct vs_sim_actuator`, None where C cannot."""
        if self._rows is None:
            return [None] * len(self._actuators.table)
        rows = self._actuators.kernels(self._world, self._robots, self._reports)
        self.acting_in_c = [row for row in rows if row is not None]
        return [
            row
            and (
                kernel_ffi.addressof(row.apply.library, row.apply.name),
                row.apply.cdata,
                self._scene.cdata,
                row.heard,
            )
            for row in rows
        ]

    def step(self, timestep: int) -> None:
        """Renews what C does not."""
        if self.in_python:
            self._bank.step(self._world, timestep, self.in_python)

    def begin(self) -> None:
        """Begins to count for `use`."""
        self._used = 0

    def use(self, timesteps: int) -> None:
        """Noise of so many timesteps since `begin` has been used by C."""
        for sensor in self.in_c:
            sensor.use(timesteps - self._used)
        self._used = timesteps


def kernel_of(program: Program) -> ProgramKernel:
    """How C steps a program that can be chained."""
    kernel = program.kernel()
    assert kernel is not None
    return kernel
