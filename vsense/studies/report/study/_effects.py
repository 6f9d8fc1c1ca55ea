"""How large differences are: A12 and shift with bootstrapped intervals; and conditions' spreads.

Needs NumPy only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vsense.base.arena import Floats

RESAMPLES, FEWER_RESAMPLES = 2_000, 1_000
"""Of the bootstrap; fewer where there are more differences than `_MOST_SORTED`."""
_MOST_SORTED = 10_000
"""Differences of two conditions that are sorted; a median of more is searched for."""
_CHUNK = 2_000_000
"""Numbers that are in memory at a time."""
_MOST_AT_ONCE = 4_000_000
"""Differences whose own median is not searched for."""
_HALVINGS = 30
"""Of the range in which a median is searched for: it is known to a billionth of that."""
_INTERVAL = (0.025, 0.975)
_NOTCH = 1.57
"""Half of a notch, in interquartile ranges over the root of n (McGill, Tukey and Larsen 1978)."""


@dataclass(frozen=True, slots=True)
class EffectSize:
    """How far runs of two conditions lie apart, with 95 % percentile bootstrap intervals.

    Attributes:
        a12: how often a run of the first condition exceeds one of the second, ties counted half
            (Vargha and Delaney 2000), 0..1.
        shift: by how much: the median of all differences (Hodges and Lehmann 1963), of pairs the
            median of the mean of any two differences.
        resamples: of the bootstrap; 0: there are too few runs for intervals.
    """

    a12: float
    a12_low: float | None
    a12_high: float | None
    shift: float
    shift_low: float | None
    shift_high: float | None
    resamples: int


@dataclass(frozen=True, slots=True)
class Spread:
    """How the runs of one condition lie, in the measure's unit.

    Attributes:
        sd: of the sample; None: a single run.
        cv: standard deviation over the mean's size; None: not known, or the mean is 0.
        notch: 95 % interval of the median by McGill's formula; None: a single run.
    """

    n: int
    mean: float
    sd: float | None
    cv: float | None
    median: float
    quartiles: tuple[float, float]
    least: float
    greatest: float
    notch: tuple[float, float] | None


def spread_of(values: Floats) -> Spread:
    """The spread of one run's values at least."""
    low, middle, high = (float(v) for v in np.percentile(values, (25, 50, 75)))
    mean, n = float(values.mean()), len(values)
    sd = float(values.std(ddof=1)) if n > 1 else None
    half = _NOTCH * (high - low) / np.sqrt(n)
    return Spread(
        n=n,
        mean=mean,
        sd=sd,
        cv=None if sd is None or mean == 0.0 else sd / abs(mean),
        median=middle,
        quartiles=(low, high),
        least=float(values.min()),
        greatest=float(values.max()),
        notch=(float(middle - half), float(middle + half)) if n > 1 else None,
    )


def effect_of(first: Floats, second: Floats, paired: bool, seed: int) -> EffectSize:
    """The effect and its intervals; of pairs, pairs are drawn. One run each at least."""
    count = len(first) * len(second)
    weights = np.ones((1, len(first))), np.ones((1, len(second)))
    a12_of, shift_of = _A12(first, second), _shift_of(first, second, paired)
    a12, shift = float(a12_of(*weights)[0]), float(shift_of(*weights)[0])
    if _MOST_SORTED < count <= _MOST_AT_ONCE and not paired:
        shift = float(np.median(first[:, None] - second[None, :]))
    if min(len(first), len(second)) < 2:
        return EffectSize(a12, None, None, shift, None, None, 0)
    resamples = RESAMPLES if count <= _MOST_SORTED else FEWER_RESAMPLES
    random = np.random.default_rng(seed)
    firsts = _weights(random, len(first), resamples)
    seconds = firsts if paired else _weights(random, len(second), resamples)
    step = max(_CHUNK // min(count, _MOST_SORTED), 1)
    cuts = [slice(at, at + step) for at in range(0, resamples, step)]
    a12s = np.concatenate([a12_of(firsts[cut], seconds[cut]) for cut in cuts])
    shifts = np.concatenate([shift_of(firsts[cut], seconds[cut]) for cut in cuts])
    intervals = np.quantile(a12s, _INTERVAL), np.quantile(shifts, _INTERVAL)
    (a12_low, a12_high), (shift_low, shift_high) = (map(float, interval) for interval in intervals)
    return EffectSize(a12, a12_low, a12_high, shift, shift_low, shift_high, resamples)


def _weights(random: np.random.Generator, n: int, resamples: int) -> Floats:
    """How often each of n runs was drawn, (resamples, n)."""
    drawn = random.integers(n, size=(resamples, n)) + n * np.arange(resamples)[:, None]
    counts = np.bincount(drawn.ravel(), minlength=n * resamples)
    return counts.reshape(resamples, n).astype(np.float64)


class _A12:
    """A12 of resamples: runs are sorted once, a resample only weighs them again."""

    def __init__(self, first: Floats, second: Floats) -> None:
        self._order = np.argsort(second, kind="stable")
        sides = (np.searchsorted(second[self._order], first, side) for side in ("left", "right"))
        self._below, self._upto = sides

    def __call__(self, firsts: Floats, seconds: Floats) -> Floats:
        """A12, (n,), where runs were drawn so often, (n, runs) each."""
        sums = _sums(seconds[:, self._order])
        won = (sums[:, self._below] + sums[:, self._upto]) / 2.0
        pairs = firsts.sum(axis=1) * sums[:, -1]
        return np.asarray((firsts * won).sum(axis=1) / pairs)


def _shift_of(first: Floats, second: Floats, paired: bool) -> Callable[[Floats, Floats], Floats]:
    """Makes the function that gives the shifts, (n,), of runs that were drawn so often."""
    if len(first) * len(second) > _MOST_SORTED:
        return _Search(first, second, paired).medians
    if paired:
        i, j = np.triu_indices(len(first))
        differences = first - second
        values = (differences[i] + differences[j]) / 2.0
    else:
        i, j = (indices.ravel() for indices in np.indices((len(first), len(second))))
        values = first[i] - second[j]
    order = np.argsort(values, kind="stable")
    i, j, values = i[order], j[order], values[order]

    def medians(firsts: Floats, seconds: Floats) -> Floats:
        left, right = firsts[:, i], seconds[:, j]
        # Of k copies of a pair there are k (k + 1) / 2 means with each other.
        ways = np.where(i == j, left * (left + 1.0) / 2.0, left * right) if paired else None
        sums = np.cumsum(left * right if ways is None else ways, axis=1)
        count = sums[:, -1]
        middles = np.floor((count + 1.0) / 2.0), np.floor(count / 2.0) + 1.0
        low, high = (values[(sums < middle[:, None]).sum(axis=1)] for middle in middles)
        return np.asarray((low + high) / 2.0)

    return medians


class _Search:
    """Finds medians of more differences than one would sort, by halving a range."""

    def __init__(self, first: Floats, second: Floats, paired: bool) -> None:
        # Means of two differences are halves of one minus the other, turned round.
        self._paired = paired
        self._first = (first - second) / 2.0 if paired else first
        self._order = np.argsort(-self._first if paired else second, kind="stable")
        self._second = (-self._first if paired else second)[self._order]
        self._low = float(self._first.min() - self._second[-1])
        self._high = float(self._first.max() - self._second[0])

    def medians(self, firsts: Floats, seconds: Floats) -> Floats:
        """The shifts, (n,), where runs were drawn so often, (n, runs)."""
        sums = _sums(seconds[:, self._order])
        count = sums[:, -1:]
        half = (firsts.sum(axis=1) * count[:, 0] + (count[:, 0] if self._paired else 0.0)) / 2.0
        low, high = np.full(len(firsts), self._low), np.full(len(firsts), self._high)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2.0
            places = np.searchsorted(self._second, self._first - middle[:, None])
            upto = count - np.take_along_axis(sums, places, axis=1)
            counted = (firsts * upto).sum(axis=1)
            if self._paired:
                counted += (firsts * (2.0 * self._first <= middle[:, None])).sum(axis=1)
            enough = counted >= half
            low, high = np.where(enough, low, middle), np.where(enough, middle, high)
        return np.asarray((low + high) / 2.0)


def _sums(weights: Floats) -> Floats:
    """Sums of the first 0, 1, ... columns, (n, columns + 1)."""
    sums = np.zeros((weights.shape[0], weights.shape[1] + 1))
    np.cumsum(weights, axis=1, out=sums[:, 1:])
    return sums
