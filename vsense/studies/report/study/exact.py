"""Exact null distributions of rank statistics, given the ties that there are.

Ranks are doubled, so that the mean ranks of ties are whole numbers, and the number of ways to each
sum is counted: the shift algorithm of Streitberg and Röhmel (1986). No approximation, no sampling.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_TOLERANCE = 1e-9
"""Sums of halves are exact; a statistic of squares is not."""
MOST_STEPS = 100_000
"""Sums that are made for Friedman's distribution: with three conditions about 15 blocks."""


def midranks(values: Floats) -> Floats:
    """The ranks of values, from 1, (n,); those that are equal share their mean."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(count)
    return np.asarray((last - (count - 1) / 2.0)[place], dtype=np.float64)


def rank_sum_tails(ranks: Floats, chosen: int, rank_sum: float) -> tuple[float, float]:
    """How likely it is that so many of the ranks, drawn without looking, have an extreme sum.

    Args:
        ranks: of all values together, as `midranks` gives them.
        chosen: how many are drawn.
        rank_sum: the sum that was found.

    Returns:
        The probability of a sum that lies as far from its mean, either way, or farther; and of the
        most extreme ones, which is the least that the first can be.
    """
    doubled = np.rint(2.0 * ranks).astype(np.int64)
    ways = np.zeros((chosen + 1, int(doubled.sum()) + 1))
    ways[0, 0] = 1.0
    for rank in doubled.tolist():
        ways[1:, rank:] += ways[:-1, : ways.shape[1] - rank].copy()
    sums = np.arange(ways.shape[1]) / 2.0
    return _tails(sums, ways[chosen], chosen * float(ranks.mean()), rank_sum)


def signed_rank_tails(ranks: Floats, rank_sum: float) -> tuple[float, float]:
    """As `rank_sum_tails`, for the sum of the ranks that fair coins choose."""
    doubled = np.rint(2.0 * ranks).astype(np.int64)
    ways = np.zeros(int(doubled.sum()) + 1)
    ways[0] = 1.0
    for rank in doubled.tolist():
        ways[rank:] += ways[: len(ways) - rank].copy()
    return _tails(np.arange(len(ways)) / 2.0, ways, float(ranks.sum()) / 2.0, rank_sum)


def _tails(sums: Floats, ways: Floats, mean: float, found: float) -> tuple[float, float]:
    away = np.abs(sums - mean)
    whole, most = ways.sum(), away[ways > 0.0].max()
    p = ways[away >= abs(found - mean) - _TOLERANCE].sum() / whole
    return float(min(p, 1.0)), float(ways[away >= most - _TOLERANCE].sum() / whole)


def friedman_tails(ranks: Floats) -> tuple[float, float] | None:
    """As `rank_sum_tails`, for the spread of rank sums over conditions (Friedman's statistic).

    Args:
        ranks: of the conditions in each block, (blocks, conditions).

    Returns:
        None where there are too many possible sums to count.
    """
    doubled = np.rint(2.0 * ranks).astype(np.int64)
    found = _spread(tuple(doubled.sum(axis=0).tolist()))
    # Sums that differ in their order only are one: the statistic does not know conditions apart.
    ways: dict[tuple[int, ...], float] = {(0,) * ranks.shape[1]: 1.0}
    steps = 0
    for block in doubled.tolist():
        steps += len(ways) * math.factorial(len(block))
        if steps > MOST_STEPS:
            return None
        orders = list(permutations(block))
        following: dict[tuple[int, ...], float] = defaultdict(float)
        for state, count in ways.items():
            for order in orders:
                following[tuple(sorted(map(sum, zip(state, order))))] += count
        ways = following
    spreads = {state: _spread(state) for state in ways}
    whole, most = sum(ways.values()), max(spreads.values())
    p = sum(count for state, count in ways.items() if spreads[state] >= found)
    least = sum(count for state, count in ways.items() if spreads[state] == most)
    return p / whole, least / whole


def _spread(sums: Sequence[int]) -> int:
    """What Friedman's statistic grows with: whole numbers, so that equals are equal."""
    return len(sums) * sum(each * each for each in sums) - sum(sums) ** 2
