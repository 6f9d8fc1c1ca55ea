"""Who is near whom on the floor of lab and simulation, who touches, and how far all give way.

The arithmetic is C (`c_src/host/vs_contacts.c`). With 15 robots in the pollutant
experiment's arena a tick of the physics takes 2 us; it took 125 us in NumPy.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.native import kernel_ffi

Floats = NDArray[np.float64]

_PAIR = np.dtype([("robot", "u4"), ("other", "u4")])
"""`struct vs_pair`."""


class Neighbourhood:
    """The pairs that are near enough to touch or to be felt; see `struct vs_near`.

    Attributes:
        robots: how many of the bodies can feel and give way: the first ones.
        cdata: the `struct vs_near`, for calls of the C library.
        room: of how many pairs there may be.
    """

    def __init__(self, robots: int, boxes: ArrayLike, radii_m: ArrayLike) -> None:
        """A neighbourhood without pairs yet.

        Args:
            robots: how many of the bodies are robots.
            boxes: (b, 5) x_m, y_m, yaw_rad, size_x_m, size_y_m of what stands around, arena frame.
            radii_m: (n,) radius of every body, robots first.
        """
        table = np.asarray(boxes, dtype=np.float64).reshape(-1, 5)
        axis = np.stack([np.cos(table[:, 2]), np.sin(table[:, 2])], axis=1)
        radii = np.ascontiguousarray(radii_m, dtype=np.float64)
        self.robots = robots
        self.room = robots * (len(radii) + len(table))
        # Pages that no pair ever reaches are never taken from the machine.
        self._kept = (
            radii,
            np.ascontiguousarray(np.hstack([table[:, :2], axis, table[:, 3:] / 2])),
            np.zeros((len(radii), 2)),
            np.empty(max(self.room, 1), dtype=_PAIR),
        )
        near: Any = kernel_ffi.new("struct vs_near *")
        near.robots, near.bodies, near.boxes = robots, len(radii), len(table)
        near.radii_m, near.box_rows, near.searched_m = (
            pointer("double", array) for array in self._kept[:3]
        )
        near.pairs = pointer("struct vs_pair", self._kept[3])
        self.cdata = near


class Contacts:
    """What moves overlapping bodies apart by the least possible displacement.

    Attributes:
        cdata: the `struct vs_contacts`, for calls of the C library.
    """

    def __init__(self, mobility: Floats, near: Neighbourhood) -> None:
        """Contacts of the bodies in `near`.

        Args:
            mobility: (n,) how readily each body gives way, 0 for what cannot move; the caller
                may change it between ticks.
            near: who is near whom.
        """
        size = near.room * kernel_ffi.sizeof("struct vs_contact")
        self._kept = (
            near,
            mobility,
            np.empty(size, dtype=np.uint8),
            np.empty(size, dtype=np.uint8),
            np.empty(2 * len(mobility)),
            np.empty(len(mobility), dtype=np.uint32),
        )
        _, _, now, before, moved_m, newest = self._kept
        self.cdata: Any = kernel_ffi.new("struct vs_contacts *")
        self.cdata.near = near.cdata
        self.cdata.mobility = pointer("double", mobility)
        self.cdata.now = pointer("struct vs_contact", now)
        self.cdata.before = pointer("struct vs_contact", before)
        self.cdata.moved_m = pointer("double", moved_m)
        self.cdata.newest = pointer("uint32_t", newest)


def pointer(kind: str, array: NDArray[Any]) -> Any:
    """The items of a contiguous array as a C array, which the array has to outlive."""
    return kernel_ffi.from_buffer(f"{kind}[]", array)
