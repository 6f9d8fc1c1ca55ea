"""Which robot drives to which home: the longest way is as short as it can be.

A bottleneck assignment, and of all those that are as good the one with the shortest ways
altogether. Robots exchange homes only with their like.

Source: the threshold method of R. Burkard, M. Dell'Amico, S. Martello, Assignment Problems (2009),
section 6.2, and the Hungarian method with potentials (section 4.4) for what it leaves open.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.config.specs import Pose

Way = Callable[[Pose, Pose], float]
"""How long the way from a place to a home is [m]; infinite where there is none."""


def straight_m(place: Pose, home: Pose) -> float:
    """The straight way, over everything."""
    return math.hypot(home.x_m - place.x_m, home.y_m - place.y_m)


def assign(
    places: Mapping[int, Pose],
    homes: Mapping[int, Pose],
    kinds: Mapping[int, Hashable],
    way_m: Way = straight_m,
) -> dict[int, Pose]:
    """Gives each robot a home.

    Args:
        places: where robots stand, by tag; those that nobody sees are missing.
        homes: where each robot would begin without any exchange, by tag.
        kinds: by tag, what a robot's like have in common; robots of another kind, and those that
            have none, keep their own homes.
        way_m: from a place to a home.

    Returns:
        A home for every tag of `homes`. Robots that are not seen get what the others of their kind
        leave over, their own where it is among that.
    """
    assigned = dict[int, Pose]()
    groups: dict[Hashable, list[int]] = {}
    for tag in homes:
        groups.setdefault(kinds.get(tag, ("alone", tag)), []).append(tag)
    for group in groups.values():
        seen = [tag for tag in group if tag in places]
        costs = np.array([[way_m(places[tag], homes[other]) for other in group] for tag in seen])
        chosen = bottleneck(costs.reshape(len(seen), len(group)))
        assigned |= {tag: homes[group[column]] for tag, column in zip(seen, chosen)}
        left = [other for column, other in enumerate(group) if column not in set(chosen)]
        for tag in (t for t in group if t not in places):
            taken = tag if tag in left else left[0]
            left.remove(taken)
            assigned[tag] = homes[taken]
    return assigned


def bottleneck(costs: Floats) -> list[int]:
    """A column for every row, such that the largest cost is the least possible.

    Args:
        costs: (n, m), n at most m; infinite: only where nothing else is left.

    Returns:
        n different columns. Of all assignments with the same largest cost it is one with the least
        sum.
    """
    rows, columns = costs.shape
    if rows == 0:
        return []
    finite = costs[np.isfinite(costs)]
    never = (float(finite.max()) if len(finite) else 0.0) * (columns + 1) + 1.0
    bounded = np.where(np.isfinite(costs), costs, never)
    steps = np.unique(bounded)
    low, high = 0, len(steps) - 1
    while low < high:
        middle = (low + high) // 2
        if _matches(bounded <= steps[middle]):
            high = middle
        else:
            low = middle + 1
    # Far above any sum of allowed costs, so that none of the others is ever chosen.
    return _least_sum(np.where(bounded <= steps[low], bounded, (never + 1.0) * (rows + 1)))


def _matches(allowed: NDArray[np.bool_]) -> bool:
    """Whether every row can have an allowed column of its own."""
    owner = dict[int, int]()
    options = [np.flatnonzero(row).tolist() for row in allowed]

    def take(row: int, tried: set[int]) -> bool:
        for column in options[row]:
            if column in tried:
                continue
            tried.add(column)
            if column not in owner or take(owner[column], tried):
                owner[column] = row
                return True
        return False

    return all(take(row, set()) for row in range(len(options)))


def _least_sum(costs: Floats) -> list[int]:
    """A column for every row with the least sum of costs: one augmenting path for each row."""
    rows, columns = costs.shape
    row_price, price = np.zeros(rows), np.zeros(columns)
    owner = np.full(columns, -1)
    for new in range(rows):
        shortest = np.full(columns, np.inf)
        before = np.full(columns, -1)
        done = np.zeros(columns, dtype=bool)
        row, last, reached = new, -1, 0.0
        while True:
            slack = reached + costs[row] - row_price[row] - price
            nearer = ~done & (slack < shortest)
            shortest[nearer], before[nearer] = slack[nearer], last
            last = int(np.argmin(np.where(done, np.inf, shortest)))
            reached, done[last] = float(shortest[last]), True
            if owner[last] < 0:
                break
            row = int(owner[last])
        row_price[new] += reached
        for column in np.flatnonzero(done):
            if owner[column] >= 0:
                row_price[owner[column]] += reached - shortest[column]
            price[column] += shortest[column] - reached
        while last >= 0:
            previous = int(before[last])
            owner[last] = new if previous < 0 else owner[previous]
            last = previous
    return _columns(owner, rows)


def _columns(owner: Sequence[int] | NDArray[np.int64], rows: int) -> list[int]:
    columns = [-1] * rows
    for column, row in enumerate(owner):
        if row >= 0:
            columns[int(row)] = column
    return columns
