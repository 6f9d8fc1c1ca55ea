"""An exact permutation test, for tests that compare two small samples."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

TIE = 1e-9
"""Differences of means that are equal but for rounding."""


def p_value(first: Sequence[float], second: Sequence[float]) -> float:
    """Gives the share of all ways to deal the numbers out that set the means apart as far.

    Two-sided and exact: every way is tried. 10 and 10 numbers have 184756 of them.

    Args:
        first: one sample.
        second: the other one.

    Returns:
        The probability of such a difference of means, or a larger one, by chance.
    """
    numbers = np.array([*first, *second], dtype=np.float64)
    total = numbers.sum()

    def apart(sums: np.ndarray) -> np.ndarray:
        return np.abs(sums / len(first) - (total - sums) / len(second))

    ways = np.array(list(combinations(range(len(numbers)), len(first))))
    found = apart(np.array(sum(first)))
    return float(np.mean(apart(numbers[ways].sum(axis=1)) >= found - TIE))
