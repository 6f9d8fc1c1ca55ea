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

from vsense.base.arena import Floats
from vsense.base.errors import UsageError
from vsense.modes.lab._links import GROUND_RAW
from vsense.world.robot_models import EPUCK, RobotModel

N_RING, N_GROUND = 8, 3
BLACK_RAW, WHITE_RAW = 250.0, float(GROUND_RAW)
GROUND_NOISE_RAW = 3.0
"""Standard deviation."""
BIAS_RAW = 300.0
"""Of a sensor whose gain may be 100 % off: a fifth of it at 20 %."""


def _three(places: Any) -> Any:
    """What bases tell of ground sensors: left, centre, right; of two the mean is the centre."""
    if len(places) < N_GROUND:
        return places[0], np.mean(places, axis=0), places[-1]
    return places[:N_GROUND]


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

    def spans(self, model: RobotModel) -> dict[str, Floats]:
        """The true spans by the roster's names: (n, 2) raw readings."""
        _, nothing, wall = model.ring.span
        low = nothing + np.array(self.biases)
        high = low + (wall - nothing) * np.array(self.gains)
        ring = np.array([low, high]).T[: len(model.ring.places_m)]
        return {"proximity_scale": ring, "ground_scale": np.array([self.black, self.white]).T}


def draw_sensors(
    random: np.random.Generator, share: float, model: RobotModel = EPUCK
) -> SensorHardware:
    """Draws the sensors of a robot of a model, each up to `share` off."""

    def off(count: int) -> Floats:
        return np.asarray(share * random.uniform(-1.0, 1.0, count))

    gains, biases, black, white = off(N_RING), off(N_RING), off(N_GROUND), off(N_GROUND)
    if len(model.ground_m) == 2:
        black, white = (np.array(_three(levels[::2])) for levels in (black, white))
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

    def __init__(
        self,
        black: ArrayLike,
        robots: Sequence[SensorHardware],
        seed: int,
        models: Sequence[RobotModel],
    ) -> None:
        """Discs (k, 3) x_m, y_m, radius_m; `seed` decides the noise."""
        self._places_m = np.array([_three(model.ground_m) for model in models])
        self._discs = np.asarray(black, dtype=np.float64).reshape(-1, 3)
        self._levels = np.array([(robot.black, robot.white) for robot in robots])
        self._random = np.random.default_rng([seed, 12])

    def read(self, poses: Floats) -> NDArray[np.int16]:
        """Raw readings (n, 3) of robots at poses (n, 3), 0..1023, higher is brighter."""
        cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
        x, y = np.moveaxis(self._places_m, -1, 0)
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
