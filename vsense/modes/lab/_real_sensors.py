"""The sensors of the lab's robots: how they differ, and what they read of a floor with black on it.

The nominal proximity sensor is that of `vsense.world.physics.proximity_ring`, by the table of
Webots' e-puck; no two real ones are alike: what comes back counts more or less (`gains`), and with
nothing near they read something else (`biases`). The ground sensors' two levels are in the middle
of what GCtronic's boards read of paper; they differ from board to board.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.errors import UsageError
from vsense.modes.lab._links import GROUND_RAW
from vsense.world.robot_models import EPUCK

Floats = NDArray[np.float64]

N_RING, N_GROUND = 8, 3
BLACK_RAW, WHITE_RAW = 250.0, float(GROUND_RAW)
GROUND_NOISE_RAW = 3.0
"""Standard deviation."""
BIAS_RAW = 300.0
"""Of a sensor whose gain may be 100 % off: a fifth of it at 20 %."""

NOTHING_RAW = EPUCK.ring.table_raw[-1]
WALL_RAW = EPUCK.ring.table_raw[EPUCK.ring.table_m.index(0.01)]
"""What vsensed makes of a robot's own readings: nothing near, and a white wall 1 cm ahead.
Source: the table of Webots' e-puck, as in `calibration.h`."""

PLACES_M = np.array(EPUCK.ground_m)
"""(3, 2) of the ground sensors left, centre, right in the robot's frame. Source: epuck.md 6."""


@dataclass(frozen=True, slots=True)
class SensorHardware:
    """How one robot's sensors are.

    Attributes:
        gains: (8) of ps0..ps7; 1: as nominal ones.
        biases: (8) by how much more they read.
        black, white: (3) what left, centre and right read of them.
    """

    gains: Sequence[float]
    biases: Sequence[float]
    black: Sequence[float]
    white: Sequence[float]

    @property
    def spans(self) -> dict[str, Floats]:
        """The true spans by the roster's names: (n, 2) raw readings."""
        low = NOTHING_RAW + np.array(self.biases)
        high = low + (WALL_RAW - NOTHING_RAW) * np.array(self.gains)
        ground = np.array([self.black, self.white]).T
        return {"proximity_scale": np.array([low, high]).T, "ground_scale": ground}


def draw_sensors(random: np.random.Generator, share: float) -> SensorHardware:
    """Draws a robot's sensors, each up to `share` off."""

    def off(count: int) -> Floats:
        return np.asarray(share * random.uniform(-1.0, 1.0, count))

    gains, biases, black, white = off(N_RING), off(N_RING), off(N_GROUND), off(N_GROUND)
    return SensorHardware(
        (1.0 + gains).tolist(),
        (BIAS_RAW * biases).tolist(),
        (BLACK_RAW * (1.0 + black)).tolist(),
        (WHITE_RAW * (1.0 + white)).tolist(),
    )


NOMINAL_SENSORS = SensorHardware(
    (1.0,) * N_RING, (0.0,) * N_RING, (BLACK_RAW,) * N_GROUND, (WHITE_RAW,) * N_GROUND
)


class RealGround:
    """What the robots' ground sensors read of a light floor with black discs on it."""

    def __init__(self, black: ArrayLike, robots: Sequence[SensorHardware], seed: int) -> None:
        """Discs (k, 3) x_m, y_m, radius_m; `seed` decides the noise."""
        self._discs = np.asarray(black, dtype=np.float64).reshape(-1, 3)
        self._levels = np.array([(robot.black, robot.white) for robot in robots])
        self._random = np.random.default_rng([seed, 12])

    def read(self, poses: Floats) -> NDArray[np.int16]:
        """Raw readings (n, 3) of robots at poses (n, 3), 0..1023, higher is brighter."""
        cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
        x, y = PLACES_M.T
        east, north = poses[:, :1] + cos * x - sin * y, poses[:, 1:2] + sin * x + cos * y
        black = np.zeros(east.shape, dtype=np.bool_)
        for x_m, y_m, radius_m in self._discs:
            black |= np.hypot(east - x_m, north - y_m) < radius_m
        clean = np.where(black, self._levels[:, 0], self._levels[:, 1])
        noisy = np.rint(clean + self._random.normal(0.0, GROUND_NOISE_RAW, clean.shape))
        return np.clip(noisy, 0, 1023).astype(np.int16)


def read_sensors(given: Any, count: int) -> list[SensorHardware]:
    """Reads the sensors of `count` robots from JSON; UsageError says what is expected."""
    sizes = {"gains": N_RING, "biases": N_RING, "black": N_GROUND, "white": N_GROUND}
    try:
        read = [SensorHardware(**{n: [float(v) for v in row[n]] for n in sizes}) for row in given]
        rows = [(getattr(robot, n), size) for robot in read for n, size in sizes.items()]
        right = all(len(row) == size and np.isfinite(row).all() for row, size in rows)
    except (TypeError, KeyError, ValueError, OverflowError):
        right = False
    if not right or len(read) != count:
        wanted = ", ".join(f"{size} {name}" for name, size in sizes.items())
        raise UsageError(f"spec: sensors: expected {wanted} of {count} robots")
    return read
