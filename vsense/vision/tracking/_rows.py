"""What all pictures of a timestep show: rows of them together, so that they share NumPy's calls.

Rows of one picture stay apart from those of another: what is near in the arena, but in another
picture, is another camera's view.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.vision.cameras._camera_array import Index

SAME_ROBOT_M = 0.03
"""What is farther than this from where a robot is expected is another one: a robot is 0.07 wide."""


class Rows(NamedTuple):
    """Rows of a timestep's pictures.

    Attributes:
        values: (n,) MARKER or EXPECTED.
        picture: (n,) which of the pictures they are in.
    """

    values: NDArray[np.void]
    picture: Index

    def where(self, chosen: NDArray[Any]) -> Rows:
        """Returns some of the rows: (n,) bool, or their numbers."""
        return Rows(self.values[chosen], self.picture[chosen])

    def places(self) -> Floats:
        """Returns the (n, 2) places in the arena [m]."""
        return np.stack((self.values["x_m"], self.values["y_m"]), axis=1)


def gather(arrays: Sequence[NDArray[np.void]], pictures: Index | None = None) -> Rows:
    """Puts one picture's rows after the other's; `pictures` are their numbers, if not 0, 1 ..."""
    numbers = np.arange(len(arrays)) if pictures is None else pictures
    return Rows(stack_rows(arrays), np.repeat(numbers, [len(array) for array in arrays]))


def stack_rows(arrays: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """Concatenates arrays of one dtype; NumPy compares the fields of every two that have some."""
    dtype = arrays[0].dtype
    raw = np.dtype((np.void, dtype.itemsize))
    return np.concatenate([array.view(raw) for array in arrays]).view(dtype)


def join(rows: Rows, more: Rows) -> Rows:
    """Adds rows that are at none of the places found already in their picture."""
    if len(rows.picture) == 0 or len(more.picture) == 0:
        return more if len(rows.picture) == 0 else rows
    more = more.where(~are_near(more, rows))
    picture = np.concatenate((rows.picture, more.picture))
    return Rows(stack_rows((rows.values, more.values)), picture)


def each_once(rows: Rows) -> Rows:
    """Leaves out rows at the place of an earlier one in their picture."""
    row, other = near_pairs(rows, rows)
    again = np.zeros(len(rows.picture), dtype=bool)
    again[row[other < row]] = True
    return rows.where(~again)


def is_in(values: NDArray[Any], choices: NDArray[Any]) -> NDArray[np.bool_]:
    """Tells which of (n,) whole numbers are among (m,) others.

    For the few of a timestep, `np.isin` takes five times as long.
    """
    if len(choices) == 0:
        return np.zeros(len(values), dtype=bool)
    ordered = np.sort(choices)
    place = np.minimum(np.searchsorted(ordered, values), len(ordered) - 1)
    return np.asarray(ordered[place] == values)


def are_near(rows: Rows, reference: Rows) -> NDArray[np.bool_]:
    """Tells which rows have at least one of others at their place."""
    near = np.zeros(len(rows.picture), dtype=bool)
    near[near_pairs(rows, reference)[0]] = True
    return near


def single_pairs(rows: Rows, reference: Rows) -> tuple[Index, Index]:
    """Returns the numbers of the rows of which one of each is near the other, and no third."""
    row, other = near_pairs(rows, reference)
    alone = np.bincount(row, minlength=len(rows.picture))[row] == 1
    alone &= np.bincount(other, minlength=len(reference.picture))[other] == 1
    return row[alone], other[alone]


def near_pairs(rows: Rows, reference: Rows) -> tuple[Index, Index]:
    """Returns the numbers of all rows that are nearer to each other than `SAME_ROBOT_M`, sorted.

    Of each row, those of the others that lie in the same strip across its picture are looked at.
    """
    if len(rows.picture) == 0 or len(reference.picture) == 0:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    here, there = rows.places(), reference.places()
    # One axis for all pictures, on which they lie far from each other.
    apart = 1.0 + 2.0 * max(np.abs(here[:, 0]).max(), np.abs(there[:, 0]).max())
    along = there[:, 0] + apart * reference.picture
    order = np.argsort(along, kind="stable")
    at = here[:, 0] + apart * rows.picture
    first = np.searchsorted(along[order], at - 2.0 * SAME_ROBOT_M)
    counts = np.searchsorted(along[order], at + 2.0 * SAME_ROBOT_M) - first
    row = np.repeat(np.arange(len(at)), counts)
    begin = np.repeat(first - np.concatenate(([0], np.cumsum(counts)[:-1])), counts)
    other = order[np.arange(len(row)) + begin]
    offset = here[row] - there[other]
    near = np.hypot(offset[:, 0], offset[:, 1]) < SAME_ROBOT_M
    near &= rows.picture[row] == reference.picture[other]
    row, other = row[near], other[near]
    order = np.lexsort((other, row))
    return row[order], other[order]
