"""Tests of runs: rank-sum, signed-rank, Friedman, Kruskal-Wallis, Holm's correction, equivalence.

All are two-sided. SciPy, the extra `report`, has the tails of the approximating distributions; it
is imported only where one is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vsense.studies.report.study.exact import (
    Floats,
    friedman_tails,
    midranks,
    rank_sum_tails,
    signed_rank_tails,
)

MOST_EXACT = 50
"""Runs of a condition up to which the rank-sum and signed-rank tests are exact, as in R."""
FEWEST = 2
"""Runs of a condition, or pairs, that a test needs."""
ALPHA = 0.05
"""Where the least possible p lies above it, a test cannot find anything; for intervals, too."""
_DIGITS = 12
"""Of differences, relative to the values, that are looked at: runs.csv has as many."""
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
    name, n = "Wilcoxon rank-sum test", (len(first), len(second))
    reason = _cannot(n, np.concatenate((first, second)))
    if reason:
        return RankTest(name, n, reason=reason)
    ranks = midranks(np.concatenate((first, second)))
    found = float(ranks[: n[0]].sum())
    won = found - n[0] * (n[0] + 1) / 2.0
    if max(n) <= MOST_EXACT:
        p, least_p = rank_sum_tails(ranks, n[0], found)
        return RankTest(name, n, EXACT, "W", won, None, p, least_p)
    count = sum(n)
    variance = n[0] * n[1] / 12.0 * (count + 1 - _ties(ranks) / (count * (count - 1)))
    p = _normal_p(won - n[0] * n[1] / 2.0, variance)
    return RankTest(name, n, NORMAL, "W", won, None, p)


def signed_rank(first: Floats, second: Floats) -> RankTest:
    """Wilcoxon's signed-rank test of pairs; those that are equal are left out, as in R.

    V is the sum of the ranks of pairs in which the first one is greater.
    """
    name, n = "Wilcoxon signed-rank test", (len(first),)
    if len(first) < FEWEST:
        return RankTest(name, n, reason=f"{_count(len(first), 'pair')}, at least {FEWEST} needed")
    apart = (first - second)[first != second]
    if not len(apart):
        return RankTest(name, n, reason="both runs of every pair gave the same")
    # 0.3 - 0.2 and 0.2 - 0.1 are a tie, whatever halves of last digits say.
    scale = max(float(np.abs(first).max()), float(np.abs(second).max()))
    ranks = midranks(np.round(np.abs(apart) / scale, _DIGITS))
    found = float(ranks[apart > 0.0].sum())
    if len(apart) <= MOST_EXACT:
        p, least_p = signed_rank_tails(ranks, found)
        return RankTest(name, n, EXACT, "V", found, None, p, least_p)
    count = len(apart)
    variance = count * (count + 1) * (2 * count + 1) / 24.0 - _ties(ranks) / 48.0
    p = _normal_p(found - count * (count + 1) / 4.0, variance)
    return RankTest(name, n, NORMAL, "V", found, None, p)


def friedman(table: Floats) -> RankTest:
    """Friedman's test of three or more conditions, (blocks, conditions), corrected for ties."""
    blocks, conditions = table.shape
    name, n = "Friedman test", (blocks,)
    if blocks < FEWEST:
        count = _count(blocks, "complete block")
        return RankTest(name, n, reason=f"{count}, at least {FEWEST} needed")
    ranks = np.apply_along_axis(midranks, 1, table)
    if (ranks == ranks[:, :1]).all():
        return RankTest(name, n, reason="all conditions gave the same in every block")
    scale = conditions * (conditions + 1)
    value = 12.0 / (blocks * scale) * (ranks.sum(axis=0) ** 2).sum() - 3.0 * blocks * (
        conditions + 1
    )
    value /= 1.0 - sum(map(_ties, ranks)) / (blocks * scale * (conditions - 1))
    tails = friedman_tails(ranks)
    df = conditions - 1
    if tails is not None:
        return RankTest(name, n, EXACT, "χ²", float(value), df, *tails)
    return RankTest(name, n, CHI_SQUARED, "χ²", float(value), df, _chi_squared_p(value, df))


def kruskal_wallis(groups: Sequence[Floats]) -> RankTest:
    """Kruskal and Wallis's test of three or more conditions whose runs are independent."""
    name, n = "Kruskal-Wallis test", tuple(map(len, groups))
    reason = _cannot(n, np.concatenate(groups))
    if reason:
        return RankTest(name, n, reason=reason)
    ranks, count = midranks(np.concatenate(groups)), sum(n)
    parts = np.split(ranks, np.cumsum(n)[:-1])
    sums = sum(float(part.sum()) ** 2 / len(part) for part in parts)
    value = 12.0 / (count * (count + 1)) * sums - 3.0 * (count + 1)
    value /= 1.0 - _ties(ranks) / (count**3 - count)
    df = len(groups) - 1
    return RankTest(name, n, CHI_SQUARED, "H", value, df, _chi_squared_p(value, df))


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
    if min(n) < FEWEST:
        few = f"{_count(min(n), 'pair' if paired else 'run')}, at least {FEWEST} needed"
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
        *(name, n, margin, difference, difference - reach, difference + reach),
        *(lower_t, upper_t, freedom, p),
    )


def _cannot(n: Sequence[int], values: Floats) -> str:
    """Why independent runs cannot be tested; "" where they can."""
    if min(n) < FEWEST:
        return f"a condition has {_count(min(n), 'run')}, at least {FEWEST} of each needed"
    return "all runs gave the same" if (values == values[0]).all() else ""


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"


def _ties(ranks: Floats) -> float:
    """The sum of t³ - t over ties of t values."""
    counts = np.unique(ranks, return_counts=True)[1].astype(np.float64)
    return float((counts**3 - counts).sum())


def _normal_p(away: float, variance: float) -> float:
    """Of a statistic's distance from its mean, with a correction for continuity."""
    from scipy import special

    z = max(abs(away) - 0.5, 0.0) / np.sqrt(variance)
    return float(min(1.0, 2.0 * special.ndtr(-z)))


def _chi_squared_p(value: float, df: int) -> float:
    from scipy import special

    return float(special.chdtrc(df, value))
