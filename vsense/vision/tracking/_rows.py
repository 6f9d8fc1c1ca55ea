"""What all pictures of a timestep show: rows of them together, so that they share NumPy's calls.

Rows of one picture stay apart from those of another: what is near in the arena, but in another
picture, is another camera's view.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.vision.cameras._camera_array import Places

Floats = NDArray[np.float64]

NEAR_M = 0.03
"""What is farther than this from where a robot is expected is another one: a robot is 0.07 wide."""


class Rows(NamedTuple):
    """Rows of a timestep's pictures.

    Attributes:
        values: (n,) MARKER or EXPECTED.
        picture: (n,) which of the pictures they are in.
    """

    values: NDArray[np.void]
    picture: Places

    def where(self, chosen: NDArray[Any]) -> Rows:
        """Returns some of the rows: (n,) bool, or their numbers."""
        return Rows(self.values[chosen], self.picture[chosen])

    def places(self) -> Floats:
        """Returns the (n, 2) places in the arena [m]."""
        return np.stack((self.values["x_m"], self.values["y_m"]), axis=1)


def gather(found: Sequence[NDArray[np.void]], pictures: Places | None = None) -> Rows:
    """Puts one picture's rows after the other's; `pictures` are their numbers, if not 0, 1 ..."""
    numbers = np.arange(len(found)) if pictures is None else pictures
    return Rows(stack_rows(found), np.repeat(numbers, [len(one) for one in found]))


def stack_rows(arrays: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """Concatenates arrays of one dtype; NumPy compares the fields of every two that have some."""
    dtype = arrays[0].dtype
    whole = np.dtype((np.void, dtype.itemsize))
    return np.concatenate([one.view(whole) for one in arrays]).view(dtype)


def join(some: Rows, more: Rows) -> Rows:
    """Adds rows that are at none of the places found already in their picture."""
    if len(some.picture) == 0 or len(more.picture) == 0:
        return more if len(some.picture) == 0 else some
    more = more.where(~are_near(more, some))
    picture = np.concatenate((some.picture, more.picture))
    return Rows(stack_rows((some.values, more.values)), picture)


def each_once(rows: Rows) -> Rows:
    """Leaves out rows at the place of an earlier one in their picture."""
    one, other = near_pairs(rows, rows)
    again = np.zeros(len(rows.picture), dtype=bool)
    again[one[other < one]] = True
    return rows.where(~again)


def is_in(values: NDArray[Any], others: NDArray[Any]) -> NDArray[np.bool_]:
    """Tells which of (n,) whole numbers are among (m,) others.

    For the few of a timestep, `np.isin` takes five times as long.
    """
    if len(others) == 0:
        return np.zeros(len(values), dtype=bool)
    ordered = np.sort(others)
    place = np.minimum(np.searchsorted(ordered, values), len(ordered) - 1)
    return np.asarray(ordered[place] == values)


def are_near(some: Rows, others: Rows) -> NDArray[np.bool_]:
    """Tells which rows have at least one of others at their place."""
    near = np.zeros(len(some.picture), dtype=bool)
    near[near_pairs(some, others)[0]] = True
    return near


def single_pairs(some: Rows, others: Rows) -> tuple[Places, Places]:
    """Returns the numbers of the rows of which one of each is near the other, and no third."""
    one, other = near_pairs(some, others)
    alone = np.bincount(one, minlength=len(some.picture))[one] == 1
    alone &= np.bincount(other, minlength=len(others.picture))[other] == 1
    return one[alone], other[alone]


def near_pairs(some: Rows, others: Rows) -> tuple[Places, Places]:
    """Returns the numbers of all rows that are nearer to each other than `NEAR_M`, sorted.

    Of each row, those of the others that lie in the same strip across its picture are looked at.
    """
    if len(some.picture) == 0 or len(others.picture) == 0:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    here, there = some.places(), others.places()
    # One axis for all pictures, on which they lie far from each other.
    apart = 1.0 + 2.0 * max(np.abs(here[:, 0]).max(), np.abs(there[:, 0]).max())
    along = there[:, 0] + apart * others.picture
    order = np.argsort(along, kind="stable")
    at = here[:, 0] + apart * some.picture
    first = np.searchsorted(along[order], at - 2.0 * NEAR_M)
    counts = np.searchsorted(along[order], at + 2.0 * NEAR_M) - first
    one = np.repeat(np.arange(len(at)), counts)
    begin = np.repeat(first - np.concatenate(([0], np.cumsum(counts)[:-1])), counts)
    other = order[np.arange(len(one)) + begin]
    offset = here[one] - there[other]
    near = np.hypot(offset[:, 0], offset[:, 1]) < NEAR_M
    near &= some.picture[one] == others.picture[other]
    one, other = one[near], other[near]
    order = np.lexsort((other, one))
    return one[order], other[order]
