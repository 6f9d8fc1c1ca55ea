"""Pairs of bodies that are near each other on the floor, and how those that overlap give way.

The arithmetic is C (`c_src/vs_near.c`, `vs_contacts.c`). With 15 robots in the pollutant
experiment's arena a tick of the physics takes 2 us; it took 125 us in NumPy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.native import ffi, lib
from vsense.world.entities import BODY_RADIUS_M as BODY_RADIUS_M

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_PAIR = np.dtype([("robot", "u4"), ("other", "u4")])
"""`struct vs_pair`."""


@dataclass(frozen=True, slots=True)
class Boxes:
    """Rectangular obstacles that stand on the floor and never move.

    Attributes:
        rows: (b, 6) x_m, y_m, cosine and sine of the yaw, half of each extent, arena frame.
    """

    rows: Floats

    @classmethod
    def from_rows(cls, rows: ArrayLike) -> Boxes:
        """Boxes of rows (b, 5): x_m, y_m, yaw_rad, size_x_m, size_y_m, arena frame."""
        table = np.asarray(rows, dtype=np.float64).reshape(-1, 5)
        axis = np.stack([np.cos(table[:, 2]), np.sin(table[:, 2])], axis=1)
        return cls(np.ascontiguousarray(np.hstack([table[:, :2], axis, table[:, 3:] / 2])))

    def gaps(self, points_m: ArrayLike, box: ArrayLike) -> tuple[Floats, Floats]:
        """Signed distance of each point to the outline of its box, and the way out.

        Args:
            points_m: (q, 2) points, arena frame.
            box: (q,) which box each point is measured against.

        Returns:
            (q,) distances in m, negative inside; (q, 2) outward unit normals, arena frame.
        """
        points = np.ascontiguousarray(points_m, dtype=np.float64)
        number = np.ascontiguousarray(box, dtype=np.uint32)
        gaps, normals = np.empty(len(points)), np.empty((len(points), 2))
        lib.vs_box_gaps(
            pointer("double", self.rows),
            pointer("uint32_t", number),
            pointer("double", points),
            len(points),
            pointer("double", gaps),
            pointer("double", normals),
        )
        return gaps, normals


class Neighbourhood:
    """The pairs of bodies that are near enough to touch, or for a proximity ring to detect.

    They are searched for again only when a body has moved far enough to matter.

    Attributes:
        robots: how many of the bodies are robots: the first ones.
        boxes: what stands around.
        cdata: the `struct vs_near`, for calls of the C library.
    """

    def __init__(self, robots: int, boxes: Boxes, radii_m: ArrayLike | None = None) -> None:
        """A neighbourhood without pairs yet.

        Args:
            radii_m: (n,) radius of every body, robots first; without it all that come are
                e-pucks.
        """
        self.boxes = boxes
        self.robots = robots
        self.cdata: Any = ffi.new("struct vs_near *")
        self._radii_m = None if radii_m is None else np.asarray(radii_m, dtype=np.float64)

    @property
    def robot(self) -> Indices:
        """The robot of every pair of a robot and a body, rising."""
        return self._pairs()["robot"].astype(np.intp)

    @property
    def body(self) -> Indices:
        """The other body of these pairs."""
        return self._pairs()["other"].astype(np.intp)

    def prepare(self, bodies: int) -> None:
        """Makes room for so many bodies."""
        near = self.cdata
        if near.bodies == bodies and near.pairs != ffi.NULL:
            return
        radii_m = np.full(bodies, BODY_RADIUS_M) if self._radii_m is None else self._radii_m
        boxes = len(self.boxes.rows)
        self._kept = (np.ascontiguousarray(radii_m), np.zeros((bodies, 2)))
        # Pages that no pair ever reaches are never taken from the machine.
        self._table = np.empty(max(self.robots * (bodies + boxes), 1), dtype=_PAIR)
        near.robots, near.bodies, near.boxes = self.robots, bodies, boxes
        near.radii_m = pointer("double", self._kept[0])
        near.searched_m = pointer("double", self._kept[1])
        near.box_rows = pointer("double", self.boxes.rows)
        near.pairs = pointer("struct vs_pair", self._table)
        near.searches = near.count = 0

    def update(self, positions_m: Floats) -> None:
        """Makes the pairs hold for `positions_m` (n, 2), robots first, arena frame."""
        self.prepare(len(positions_m))
        lib.vs_near_update(self.cdata, *strided(positions_m))

    def _pairs(self) -> NDArray[np.void]:
        """The pairs with bodies, without those with boxes."""
        pairs: NDArray[np.void] = self._table[: self.cdata.count]
        return np.asarray(pairs[pairs["other"] < self.cdata.bodies])


class Contacts:
    """Moves overlapping bodies apart by the least possible displacement; see `vs_contacts.h`.

    Attributes:
        cdata: the `struct vs_contacts`, for calls of the C library.
    """

    def __init__(self, mobility: Floats, near: Neighbourhood) -> None:
        """Contacts of the bodies in `near`.

        Args:
            mobility: (n,) how readily each body gives way, 0 for what cannot move; the caller
                may change it between ticks.
            near: the pairs.
        """
        bodies = len(mobility)
        near.prepare(bodies)
        room = near.robots * (bodies + len(near.boxes.rows)) * ffi.sizeof("struct vs_contact")
        self.cdata: Any = ffi.new("struct vs_contacts *")
        self._kept = (
            near,
            mobility,
            np.empty(room, dtype=np.uint8),
            np.empty(room, dtype=np.uint8),
            np.empty(2 * bodies),
            np.empty(bodies, dtype=np.uint32),
        )
        _, _, now, before, moved_m, newest = self._kept
        self.cdata.near = near.cdata
        self.cdata.mobility = pointer("double", mobility)
        self.cdata.now = pointer("struct vs_contact", now)
        self.cdata.before = pointer("struct vs_contact", before)
        self.cdata.moved_m = pointer("double", moved_m)
        self.cdata.newest = pointer("uint32_t", newest)

    def separate(self, positions_m: Floats) -> None:
        """Moves the bodies (n, 2) apart, in place, arena frame."""
        lib.vs_contacts_separate(self.cdata, *strided(positions_m))


def pointer(kind: str, array: NDArray[Any]) -> Any:
    """The items of a contiguous array as a C array, which the array has to outlive."""
    return ffi.from_buffer(f"{kind}[]", array)


def strided(positions_m: Floats) -> tuple[Any, int]:
    """Positions (n, 2) as C takes them: a pointer, and how many numbers lie from row to row."""
    assert positions_m.dtype == np.float64 and positions_m.strides[1] == positions_m.itemsize
    first = ffi.cast("double *", positions_m.ctypes.data)
    return first, positions_m.strides[0] // positions_m.itemsize
