"""Noise of simulated wheels, as ARGoS has it: every command comes out a little different.

    <epuck_wheels noise_std_dev="0.05" />: v + v N(0, noise_std_dev)
    <differential_steering bias_avg bias_stddev factor_avg factor_stddev />, each also with _left
        and _right: N(factor_avg, factor_stddev) (v + bias) while one of the wheels turns; the bias
        [m/s] is drawn once for every robot

Source: argos3-epuck 66cb8d9, epuck_wheels_default_actuator.cpp lines 78-98; argos3 421bd76,
differential_steering_default_actuator.cpp lines 44-120.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.world.physics.motion import MAX_SPEED_STEPS_S, STEP_M
from vsense.world.sensors.quality import generator

_STREAM = "wheels"

Wheels = tuple[float, float]
"""Of the left wheel, and of the right one."""


@dataclass(frozen=True, slots=True)
class WheelNoise:
    """What simulated wheels make of a command: factor * (v (1 + relative) + bias).

    Attributes:
        relative: standard deviation, each time.
        bias_m_s, bias_dev_m_s: mean and standard deviation, once for every robot.
        factor, factor_dev: likewise, each time.
    """

    relative: Wheels = (0.0, 0.0)
    bias_m_s: Wheels = (0.0, 0.0)
    bias_dev_m_s: Wheels = (0.0, 0.0)
    factor: Wheels = (1.0, 1.0)
    factor_dev: Wheels = (0.0, 0.0)


class NoisyWheels:
    """What becomes of the commands to the wheels of some robots; `is_quiet`: nothing."""

    def __init__(self, noises: Sequence[WheelNoise | None], seed: int) -> None:
        """Draws what stays the same during a run.

        Args:
            noises: that of each robot; None: its wheels obey.
            seed: of the run; the wheels draw independently of all devices.
        """
        self.is_quiet = not any(noises)
        known = [noise or WheelNoise() for noise in noises]
        self._random = generator(seed, _STREAM)
        self._relative = _column(known, "relative")
        self._factor, self._factor_dev = _column(known, "factor"), _column(known, "factor_dev")
        deviation, shape = _column(known, "bias_dev_m_s"), (len(known), 2)
        bias_m_s = _column(known, "bias_m_s") + deviation * self._random.normal(size=shape)
        self._bias = bias_m_s / STEP_M

    def apply(self, commands: NDArray[np.int16]) -> NDArray[np.int16]:
        """Gives the speeds (n, 2) [step/s] that robots drive at which are told `commands`.

        They are those of one control step: ARGoS draws anew with every command. No motor turns
        faster than it can.
        """
        if self.is_quiet:
            return commands
        wanted, shape = commands.astype(np.float64), commands.shape
        drawn = wanted * (1.0 + self._relative * self._random.normal(size=shape))
        factor = self._factor + self._factor_dev * self._random.normal(size=shape)
        turning = (commands != 0).any(axis=1)[:, None]
        speeds = np.where(turning, factor * (drawn + self._bias), drawn)
        limited = np.clip(np.rint(speeds), -MAX_SPEED_STEPS_S, MAX_SPEED_STEPS_S)
        return np.asarray(limited.astype(np.int16))

    def of_robot(self, robot: int, left_steps_s: int, right_steps_s: int) -> tuple[int, int]:
        """The same for one robot, by its index."""
        if self.is_quiet:
            return left_steps_s, right_steps_s
        commands = np.zeros(self._bias.shape, dtype=np.int16)
        commands[robot] = left_steps_s, right_steps_s
        left, right = self.apply(commands)[robot].tolist()
        return left, right


def _column(noises: Sequence[WheelNoise], name: str) -> NDArray[np.float64]:
    """One setting of all robots, left and right: (n, 2)."""
    return np.array([getattr(noise, name) for noise in noises], dtype=np.float64).reshape(-1, 2)
