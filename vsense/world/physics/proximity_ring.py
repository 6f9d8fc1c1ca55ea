"""The real infrared proximity ring of e-pucks: what bodies and walls reflect.

The rays are C (`c_src/host/vs_ring.c`): the rings of 15 robots take 18 us, where NumPy took 130 us.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.native import kernel_ffi, kernels, pointer
from vsense.world.physics.motion import Neighbourhood
from vsense.world.robot_models import EPUCK, RING_SENSORS, RingModel, RobotModel

RING_RAW_MAX: int = kernels.VS_RING_RAW_MAX
"""Largest value of the converter."""

_NONE = np.zeros((0, RING_SENSORS))

_NOISE_BLOCK = 64
"""Noise of so many readings is drawn at once: that takes half the time."""

_RAYS = 7
"""Rays of one sensor, which fan out to the edges of its cone."""


@cache
def _ring(model: RingModel) -> tuple[Any, list[Floats]]:
    """Makes the `struct vs_ring` of a model; the arrays have to be kept with it.

    Emitter and receiver each fall off with the cosine of the angle.
    """
    half_rad = np.radians(model.half_cone_deg)
    fan_rad = np.linspace(-half_rad, half_rad, _RAYS)
    angles = (model.headings_rad[:, None] + fan_rad).reshape(-1)
    starts = np.repeat(np.array(model.places_m).reshape(-1, 2), _RAYS, axis=0).T
    given = (*starts, np.cos(angles), np.sin(angles), np.cos(fan_rad) ** 2)
    arrays = [
        np.ascontiguousarray(array, dtype=np.float64)
        for array in (*given, model.table_m, model.table_raw)
    ]
    names = "from_x_m from_y_m ray_x ray_y response table_m table_raw"
    members = {name: pointer("double", array) for name, array in zip(names.split(), arrays)}
    members |= {"sensors": len(model.places_m), "rays": _RAYS, "points": len(model.table_m)}
    if model.stands_for:
        bits = [sum(1 << sensor for sensor in sensors) for sensors in model.stands_for]
        arrays.append(np.array(bits, dtype=np.uint8))
        members["stand_in"] = pointer("uint8_t", arrays[-1])
    return kernel_ffi.new("struct vs_ring *", members), arrays


class ProximityRing:
    """The rings of all robots, read at once.

    Attributes:
        near: the bodies that they detect; others may take their place, with as many robots.
        cdata: the `struct vs_rings *`.
    """

    def __init__(
        self,
        near: Neighbourhood,
        seed: int,
        gains: Floats | None = None,
        biases: Floats = _NONE,
        models: Sequence[RobotModel] = (),
    ) -> None:
        """Rings that detect the bodies in `near`; `seed` decides the noise.

        Args:
            near, seed: what is detected, and chance.
            gains: (m, 8) what each sensor makes of what comes back; None: they are nominal.
            biases: (m, 8) by how much more each reads, whatever comes back.
            models: of the robots; without, they are e-pucks.
        """
        self._random = np.random.Generator(np.random.PCG64(seed))
        kinds = [model.ring for model in [*models[: near.robots]] or [EPUCK] * near.robots]
        self._noise_raw = np.array([ring.noise_raw for ring in kinds])
        sensors = (near.robots, RING_SENSORS)
        self._noise, self._used = np.zeros((0, *sensors)), 0
        self._distances_m = np.empty((*sensors, _RAYS))
        self._raw = np.zeros(sensors, dtype=np.int16)
        self._clean = np.empty(sensors)
        self.cdata: Any = kernel_ffi.new("struct vs_rings *")
        self._rings = kernel_ffi.new("struct vs_ring *[]", [_ring(ring)[0] for ring in kinds])
        self.cdata.rings = kernel_ffi.cast("const struct vs_ring **", self._rings)
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
            shape = (_NOISE_BLOCK, self.near.robots, RING_SENSORS)
            self._noise, self._used = self._random.normal(0.0, 1.0, shape), 0
            self._noise *= self._noise_raw[:, None]
        return self._noise[self._used :]

    def use(self, readings: int) -> None:
        """The noise of so many readings has been used."""
        self._used += readings

    def distances(self, poses: Floats) -> Floats:
        """Length of each ray, (m, 8, rays per sensor) [m], inf where it meets nothing.

        The array is the same at every call.
        """
        assert poses.dtype == np.float64 and poses.flags.c_contiguous
        kernels.vs_rings_distances(self.cdata, pointer("double", poses))
        return self._distances_m


def readings(distances_m: Floats, model: RobotModel = EPUCK) -> Floats:
    """Raw values (...,) without noise of distances (..., rays per sensor), see `distances`.

    That of the ray that reflects most counts.
    """
    rays = np.ascontiguousarray(distances_m, dtype=np.float64)
    raw = np.empty(rays.shape[:-1])
    ring, _ = _ring(model.ring)
    kernels.vs_ring_readings(ring, pointer("double", rays), raw.size, pointer("double", raw))
    return raw
