"""Tests of runs: rank-sum, signed-rank, Friedman, Kruskal-Wallis, Holm's correction, equivalence.

All are two-sided. SciPy, the extra `report`, ranks and has the approximating distributions; it is
imported only where a test is computed. It has no exact distributions where there are ties: these
are here. Ranks are doubled, so that the mean ranks of ties are integers, and the number of ways to
each sum is counted: the shift algorithm of Streitberg and Röhmel (1986). No sampling.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from vsense.base.arena import Floats
from vsense.base.terminal import counted

MOST_EXACT = 50
"""Runs of a condition up to which the rank-sum and signed-rank tests are exact, as in R."""
RUNS_MIN = 2
"""Runs of a condition, or pairs, that a test needs."""
ALPHA = 0.05
"""Where the least possible p lies above it, a test cannot find anything; for intervals, too."""
_DIGITS = 12
"""Of differences, relative to the values, that are looked at: runs.csv has as many."""
_TOLERANCE = 1e-9
"""Sums of halves are exact; a statistic of squares is not."""
MOST_STEPS = 100_000
"""Sums that are made for Friedman's distribution: with three conditions about 15 blocks."""
EXACT, NORMAL, CHI_SQUARED = "exact", "normal approximation", "chi-squared approximation"


@dataclass(frozen=True, slots=True)
class RankTest:
    """What a test has given.

    Attributes:
        name: of the test.
        n: values of each condition, or of blocks.
        method: how p was found, `EXACT`, `NORMAL` or `CHI_SQUARED`; "" where it was not.
        symbol, value: the statistic's.
        df: degrees of freedom; None: it has none.
        p: two-sided; None: not tested.
        least_p: the least p that these ranks can give; None: not known.
        reason: why there is no p; "" where there is one.
    """

    name: str
    n: Sequence[int]
    method: str = ""
    symbol: str = ""
    value: float | None = None
    df: int | None = None
    p: float | None = None
    least_p: float | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Equivalence:
    """Two one-sided t-tests of means against a margin (Schuirmann 1987; Lakens 2017).

    Attributes:
        difference: of the means, first minus second; None: a condition has no run.
        low, high: its 90 % confidence interval.
        lower_t, upper_t: against -margin and +margin.
        p: the greater of both; None: not tested, and `reason` says why.
    """

    name: str
    n: Sequence[int]
    margin: float
    difference: float | None
    low: float | None = None
    high: float | None = None
    lower_t: float | None = None
    upper_t: float | None = None
    df: float | None = None
    p: float | None = None
    reason: str = ""


def rank_sum(first: Floats, second: Floats) -> RankTest:
    """Wilcoxon's rank-sum test (Mann-Whitney) of independent runs; W as in R: pairs won."""
    from scipy import stats

    name, n = "Wilcoxon rank-sum test", (len(first), len(second))
    values = np.concatenate((first, second))
    if reason := _cannot(n, values):
        return RankTest(name, n, reason=reason)
    ranks = stats.rankdata(values)
    total = float(ranks[: n[0]].sum())
    won = total - n[0] * (n[0] + 1) / 2.0
    if max(n) <= MOST_EXACT:
        p, least_p = rank_sum_tails(ranks, n[0], total)
        return RankTest(name, n, EXACT, "W", won, None, p, least_p)
    p = float(stats.mannwhitneyu(first, second, method="asymptotic").pvalue)
    return RankTest(name, n, NORMAL, "W", won, None, p)


def signed_rank(first: Floats, second: Floats) -> RankTest:
    """Wilcoxon's signed-rank test of pairs; those that are equal are left out, as in R.

    V is the sum of the ranks of pairs in which the first one is greater.
    """
    from scipy import stats

    name, n = "Wilcoxon signed-rank test", (len(first),)
    if len(first) < RUNS_MIN:
        return RankTest(
            name, n, reason=f"{counted(len(first), 'pair')}, at least {RUNS_MIN} needed"
        )
    apart = (first - second)[first != second]
    if not len(apart):
        return RankTest(name, n, reason="both runs of every pair gave the same")
    # 0.3 - 0.2 and 0.2 - 0.1 are a tie, whatever halves of last digits say.
    scale = max(float(np.abs(first).max()), float(np.abs(second).max()))
    ranks = stats.rankdata(np.round(np.abs(apart) / scale, _DIGITS))
    total = float(ranks[apart > 0.0].sum())
    if len(apart) <= MOST_EXACT:
        p, least_p = signed_rank_tails(ranks, total)
        return RankTest(name, n, EXACT, "V", total, None, p, least_p)
    signed = np.sign(apart) * ranks
    p = float(stats.wilcoxon(signed, correction=True, method="asymptotic").pvalue)
    return RankTest(name, n, NORMAL, "V", total, None, p)


def friedman(table: Floats) -> RankTest:
    """Friedman's test of three or more conditions, (blocks, conditions), corrected for ties."""
    from scipy import stats

    blocks, conditions = table.shape
    name, n = "Friedman test", (blocks,)
    if blocks < RUNS_MIN:
        count = counted(blocks, "complete block")
        return RankTest(name, n, reason=f"{count}, at least {RUNS_MIN} needed")
    ranks = stats.rankdata(table, axis=1)
    if (ranks == ranks[:, :1]).all():
        return RankTest(name, n, reason="all conditions gave the same in every block")
    value, p = map(float, stats.friedmanchisquare(*table.T))
    if tails := friedman_tails(ranks):
        return RankTest(name, n, EXACT, "χ²", value, conditions - 1, tails[0], tails[1])
    return RankTest(name, n, CHI_SQUARED, "χ²", value, conditions - 1, p)


def kruskal_wallis(groups: Sequence[Floats]) -> RankTest:
    """Kruskal and Wallis's test of three or more conditions whose runs are independent."""
    from scipy import stats

    name, n = "Kruskal-Wallis test", tuple(map(len, groups))
    if reason := _cannot(n, np.concatenate(groups)):
        return RankTest(name, n, reason=reason)
    value, p = map(float, stats.kruskal(*groups))
    return RankTest(name, n, CHI_SQUARED, "H", value, len(groups) - 1, p)


def holm(p: Sequence[float]) -> list[float]:
    """Adjusts p for being many (Holm 1979), in the order given."""
    adjusted, greatest = [0.0] * len(p), 0.0
    for rank, place in enumerate(sorted(range(len(p)), key=lambda place: p[place])):
        greatest = max(greatest, min(1.0, (len(p) - rank) * p[place]))
        adjusted[place] = greatest
    return adjusted


def equivalence(first: Floats, second: Floats, margin: float, paired: bool) -> Equivalence:
    """Whether two means differ by less than a margin, which comes from a person, not from data.

    Welch's t for independent runs, t of the differences for pairs.
    """
    from scipy import special

    name = f"two one-sided {'paired t-tests' if paired else 'Welch t-tests'}"
    n = (len(first),) if paired else (len(first), len(second))
    if min(n) < RUNS_MIN:
        few = f"{counted(min(n), 'pair' if paired else 'run')}, at least {RUNS_MIN} needed"
        apart = float(np.mean(first) - np.mean(second)) if min(n) else None
        return Equivalence(name, n, margin, apart, reason=few)
    difference = float(np.mean(first) - np.mean(second))
    parts = [first - second] if paired else [first, second]
    variances = [float(np.var(part, ddof=1)) / len(part) for part in parts]
    error = float(np.sqrt(sum(variances)))
    if error == 0.0:
        what = "all differences are" if paired else "the runs of each condition are"
        reason = f"{what} the same: there is no spread to test against"
        return Equivalence(name, n, margin, difference, reason=reason)
    freedom = sum(variances) ** 2 / sum(v**2 / (len(part) - 1) for v, part in zip(variances, parts))
    lower_t, upper_t = (difference + margin) / error, (difference - margin) / error
    reach = float(special.stdtrit(freedom, 1.0 - ALPHA)) * error
    p = max(float(special.stdtr(freedom, -lower_t)), float(special.stdtr(freedom, upper_t)))
    return Equivalence(
        name=name,
        n=n,
        margin=margin,
        difference=difference,
        low=difference - reach,
        high=difference + reach,
        lower_t=lower_t,
        upper_t=upper_t,
        df=freedom,
        p=p,
    )


def _cannot(n: Sequence[int], values: Floats) -> str:
    """Why independent runs cannot be tested; "" where they can."""
    if min(n) < RUNS_MIN:
        return f"a condition has {counted(min(n), 'run')}, at least {RUNS_MIN} of each needed"
    return "all runs gave the same" if (values == values[0]).all() else ""


def rank_sum_tails(ranks: Floats, chosen: int, rank_sum: float) -> tuple[float, float]:
    """How likely it is that so many of the ranks, drawn without looking, have an extreme sum.

    Args:
        ranks: of all values together, equal ones share their mean.
        chosen: how many are drawn.
        rank_sum: that of those that were drawn.

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


def _tails(sums: Floats, ways: Floats, mean: float, rank_sum: float) -> tuple[float, float]:
    away = np.abs(sums - mean)
    most = away[ways > 0.0].max()
    p = ways[away >= abs(rank_sum - mean) - _TOLERANCE].sum() / ways.sum()
    return float(min(p, 1.0)), float(ways[away >= most - _TOLERANCE].sum() / ways.sum())


def friedman_tails(ranks: Floats) -> tuple[float, float] | None:
    """As `rank_sum_tails`, for the spread of rank sums over conditions (Friedman's statistic).

    Args:
        ranks: of the conditions in each block, (blocks, conditions).

    Returns:
        None where there are too many possible sums to count.
    """
    doubled = np.rint(2.0 * ranks).astype(np.int64)
    observed = _spread(tuple(doubled.sum(axis=0).tolist()))
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
    total, most = sum(ways.values()), max(spreads.values())
    p = sum(count for state, count in ways.items() if spreads[state] >= observed)
    least = sum(count for state, count in ways.items() if spreads[state] == most)
    return p / total, least / total


def _spread(sums: Sequence[int]) -> int:
    """What Friedman's statistic grows with: whole numbers, so that equals are equal."""
    return len(sums) * sum(value * value for value in sums) - sum(sums) ** 2
