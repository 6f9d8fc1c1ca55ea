"""What stands in the way of straight lines, robots, boxes and cylinders: `c_src/host/vs_rays.h`.

A body is an upright cylinder or an upright box with a turn about z; a line is blocked where it
touches one, from its start to its end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.native import check, kernel_ffi, kernels, lib, pointer
from vsense.world.entities import Box, Cylinder, Light
from vsense.world.robot_models import EPUCK, RobotModel
from vsense.world.sightings import LastSightings

_FIELDS = "x_m y_m z_low_m z_high_m radius_m half_x_m half_y_m cosine sine"
BODY = np.dtype([(name, "f8") for name in _FIELDS.split()])
"""One body; the fields are those of `struct vs_obstacle`."""

_LEAST_ROOM = 64


class Bodies:
    """Bodies that stand in the way, sorted into a grid for quick questions.

    Making them raises WireError where a number is not finite, or beyond what an arena can hold.

    Attributes:
        rows: BODY array, not to be changed. A body with z_high_m < z_low_m is not there.
        cdata: the `struct vs_obstacles *`.
    """

    def __init__(self, rows: NDArray[np.void]) -> None:
        self.rows = np.ascontiguousarray(rows)
        self.cdata = self._obstacles = kernel_ffi.new("struct vs_obstacles *")
        self._obstacles.bodies = pointer("struct vs_obstacle", self.rows)
        self._obstacles.count = len(self.rows)
        self._sort()

    def _sort(self) -> None:
        check(kernels.vs_obstacles_plan(self._obstacles), "bodies in the way")
        self._memory = np.empty(self._obstacles.words, dtype=np.uint32)
        kernels.vs_obstacles_sort(self._obstacles, pointer("uint32_t", self._memory))

    def __len__(self) -> int:
        return len(self.rows)


class MovingBodies(Bodies):
    """Robots, tagged things and what stands among them, from timestep to timestep.

    The rows are those of the robots, then of the things, then of what stands.

    Attributes:
        crowd: the `struct vs_crowd *`.
    """

    def __init__(
        self,
        seen: LastSightings,
        models: Sequence[RobotModel],
        standing: NDArray[np.void],
        memory_ns: int,
    ) -> None:
        """Who was not seen for `memory_ns` is not there; `models` are of robots, then of things,
        and `standing` are BODY rows."""
        self._seen, moving = seen, np.zeros(seen.count)
        self.crowd: Any = kernel_ffi.new("struct vs_crowd *")
        discs = disc_rows(moving, moving)
        discs["radius_m"] = [model.radius_m for model in models]
        discs["half_x_m"], discs["half_y_m"] = np.array([m.nose_m for m in models]).reshape(-1, 2).T
        self._heights_m = np.array([model.height_m for model in models])
        super().__init__(np.concatenate((discs, standing)))
        self.crowd.world, self.crowd.obstacles = seen.cdata, self.cdata
        self.crowd.bodies = pointer("struct vs_obstacle", self.rows)
        self.crowd.heights_m = pointer("double", self._heights_m)
        self.crowd.memory_ns = memory_ns

    def _sort(self) -> None:
        self._make_room(_LEAST_ROOM)

    def _make_room(self, words: int) -> None:
        self._memory = np.empty(words, dtype=np.uint32)
        self.crowd.memory, self.crowd.room = pointer("uint32_t", self._memory), words

    def stand(self, now_ns: int) -> None:
        """Puts everybody where they were seen last, at a time."""
        code = kernels.vs_crowd_stand(self.crowd, now_ns)
        if code == lib.VS_ERR_SPACE:
            self.grow()
            code = kernels.vs_crowd_stand(self.crowd, now_ns)
        check(code, "bodies in the way")

    def grow(self) -> None:
        """Makes the room for which the library has asked."""
        self._make_room(2 * self.cdata.words)


LIGHT_ROW = np.dtype([("at_m", "f8", 3), ("intensity", "f8")])
"""One light; the fields are those of `struct vs_light`."""


class LightTable:
    """The lights that shine, as the C library takes them.

    Attributes:
        rows: LIGHT_ROW array, not to be changed.
        cdata: the same as `struct vs_light *`.
    """

    def __init__(self, lights: Sequence[Light]) -> None:
        shining = [(light.position_m, light.intensity) for light in lights if light.intensity > 0]
        self.rows = np.array(shining, dtype=LIGHT_ROW)
        self.cdata = pointer("struct vs_light", self.rows)

    def __len__(self) -> int:
        return len(self.rows)


def disc_rows(
    x_m: ArrayLike,
    y_m: ArrayLike,
    there: ArrayLike = True,
    radius_m: float = EPUCK.radius_m,
    height_m: float = EPUCK.height_m,
) -> NDArray[np.void]:
    """Makes BODY rows of robots and tagged things at (n,) centres.

    One that is not `there`, (n,) or one for all, blocks no line but has its row.
    """
    rows = np.zeros(len(np.atleast_1d(x_m)), dtype=BODY)
    rows["x_m"], rows["y_m"], rows["radius_m"] = x_m, y_m, radius_m
    rows["z_high_m"] = np.where(there, height_m, -1.0)
    return rows


def entity_rows(entities: Sequence[Box | Cylinder]) -> NDArray[np.void]:
    """Makes BODY rows of boxes and cylinders."""
    rows = np.zeros(len(entities), dtype=BODY)
    for row, entity in zip(rows, entities):
        row["x_m"], row["y_m"], row["z_low_m"] = entity.position_m
        if isinstance(entity, Cylinder):
            row["radius_m"], height_m = entity.radius_m, entity.height_m
        else:
            row["half_x_m"], row["half_y_m"] = entity.size_m[0] / 2, entity.size_m[1] / 2
            row["cosine"], row["sine"] = math.cos(entity.yaw_rad), math.sin(entity.yaw_rad)
            height_m = entity.size_m[2]
        row["z_high_m"] = entity.position_m[2] + height_m
    return rows
