"""The real infrared proximity ring of e-pucks: what bodies and walls reflect.

The rays are C (`c_src/host/vs_ring.c`): the rings of 15 robots take 18 us, where NumPy took 130 us.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.native import kernel_ffi, kernels
from vsense.world.physics.motion import Floats, Neighbourhood, pointer
from vsense.world.sensors.geometry import EPUCK_RING_DEG

POSITIONS_M = np.array(
    [
        (0.030, -0.010), (0.022, -0.025), (0.0, -0.031), (-0.030, -0.015),
        (-0.030, 0.015), (0.0, 0.031), (0.022, 0.025), (0.030, 0.010),
    ]
)  # fmt: skip
"""(8, 2) places of ps0..ps7, clockwise from the front right, in the robot's frame (x forward,
y left). Source: epuck.md section 6."""

HEADINGS_RAD = np.radians(EPUCK_RING_DEG)
"""(8,) directions of ps0..ps7, counter-clockwise from straight ahead."""

TABLE_M = np.array([0.0, 0.005, 0.01, 0.015, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07])
"""(10,) distances at which `TABLE_RAW` holds. Source: epuck.md section 6, from Webots."""
TABLE_RAW = np.array([4095.0, 2133.0, 1466.0, 601.0, 384.0, 235.0, 158.0, 120.0, 104.0, 67.0])
"""(10,) raw readings of a surface straight ahead; the last is also the reading of nothing."""

RING_RAW_MAX: int = kernels.VS_RING_RAW_MAX
"""Largest value of the converter."""
NOISE_RAW = 8.0
"""Standard deviation of the additive noise: between Webots's 4 near and 25 far along the table."""

_NONE = np.zeros((0, 8))

_NOISE_BLOCK = 64
"""Noise of so many readings is drawn at once: that takes half the time."""

_RAYS = 7
_HALF_CONE_RAD = np.radians(30.0)
"""Rays of one sensor fan out this far to both sides, so that the cones of neighbouring sensors
meet (up to 61 degrees apart) and no robot is undetected between two of them."""
_FAN_RAD = np.linspace(-_HALF_CONE_RAD, _HALF_CONE_RAD, _RAYS)
_RESPONSE = np.cos(_FAN_RAD) ** 2
"""(_RAYS,) emitter and receiver each fall off with the cosine of the angle."""


def _ring() -> tuple[Any, list[Floats]]:
    """Makes the `struct vs_ring` of an e-puck; the arrays have to be kept with it."""
    angles = (HEADINGS_RAD[:, None] + _FAN_RAD).reshape(-1)
    starts = np.repeat(POSITIONS_M, _RAYS, axis=0).T
    arrays = [
        np.ascontiguousarray(array)
        for array in (*starts, np.cos(angles), np.sin(angles), _RESPONSE, TABLE_M, TABLE_RAW)
    ]
    ring = kernel_ffi.new("struct vs_ring *")
    ring.sensors, ring.rays, ring.points = len(POSITIONS_M), _RAYS, len(TABLE_M)
    (
        ring.from_x_m,
        ring.from_y_m,
        ring.ray_x,
        ring.ray_y,
        ring.response,
        ring.table_m,
        ring.table_raw,
    ) = (pointer("double", array) for array in arrays)
    return ring, arrays


_RING, _RING_ARRAYS = _ring()


class ProximityRing:
    """The rings of all robots, read at once.

    Attributes:
        near: the bodies that they detect; others may take their place, with as many robots.
        cdata: the `struct vs_rings *`.
    """

    def __init__(
        self, near: Neighbourhood, seed: int, gains: Floats | None = None, biases: Floats = _NONE
    ) -> None:
        """Rings that detect the bodies in `near`; `seed` decides the noise.

        Args:
            near, seed: what is detected, and chance.
            gains: (m, 8) what each sensor makes of what comes back; None: they are nominal.
            biases: (m, 8) by how much more each reads, whatever comes back.
        """
        self._random = np.random.Generator(np.random.PCG64(seed))
        self._noise = np.zeros((0, near.robots, len(POSITIONS_M)))
        self._used = 0
        sensors = (near.robots, len(POSITIONS_M))
        self._distances_m = np.empty((*sensors, _RAYS))
        self._raw = np.zeros(sensors, dtype=np.int16)
        self._clean = np.empty(sensors)
        self.cdata: Any = kernel_ffi.new("struct vs_rings *")
        self.cdata.ring = _RING
        self.cdata.distances_m = pointer("double", self._distances_m)
        self.cdata.clean = pointer("double", self._clean)
        self.cdata.raw = pointer("int16_t", self._raw)
        if gains is not None:
            built = [np.ascontiguousarray(array, dtype=np.float64) for array in (gains, biases)]
            self.cdata.gain, self.cdata.bias = (pointer("double", array) for array in built)
            self._factors = built
        self.near = near

    @property
    def near(self) -> Neighbourhood:
        return self._near

    @near.setter
    def near(self, near: Neighbourhood) -> None:
        self._near, self.cdata.near = near, near.cdata

    def read(self, poses: Floats) -> NDArray[np.int16]:
        """Raw readings (m, 8) of ps0..ps7 with noise, 0..4095, higher is nearer.

        `poses` (n, 3) are x_m, y_m, yaw_rad of all bodies, robots first, arena frame, contiguous.
        """
        noise = pointer("double", self.noise()[0])
        kernels.vs_rings_read(self.cdata, pointer("double", poses), noise)
        self.use(1)
        return np.array(self._raw)

    def noise(self) -> Floats:
        """Noise of the readings to come, (k, m, 8), one at least."""
        if self._used == len(self._noise):
            shape = (_NOISE_BLOCK, self.near.robots, len(POSITIONS_M))
            self._noise, self._used = self._random.normal(0.0, NOISE_RAW, shape), 0
        return self._noise[self._used :]

    def use(self, readings: int) -> None:
        """The noise of so many readings has been used."""
        self._used += readings

    def distances(self, poses: Floats) -> Floats:
        """Length of each ray, (m, 8, rays per sensor) [m], inf where it meets nothing.

        The array is the same at every call.
        """
        assert poses.dtype == np.float64 and poses.flags.c_contiguous
        target = pointer("double", self._distances_m)
        kernels.vs_ring_distances(_RING, self.near.cdata, pointer("double", poses), target)
        return self._distances_m


def readings(distances_m: Floats) -> Floats:
    """Raw values (...,) without noise of distances (..., rays per sensor), see `distances`.

    That of the ray that reflects most counts.
    """
    rays = np.ascontiguousarray(distances_m, dtype=np.float64)
    raw = np.empty(rays.shape[:-1])
    kernels.vs_ring_readings(_RING, pointer("double", rays), raw.size, pointer("double", raw))
    return raw
