"""Paired runs, looked at again and again until the answer is clear: with its error bounded.

Old and new run with the same seed are a pair. After 8, 12, 16, ... pairs (`LOOKS`) an interval is
drawn around the difference of the means; these intervals hold the truth *all at once* in 95 % of
all comparisons, where means of so many differences are nearly normal. So whoever stops as soon as
an interval says something is wrong in 2.5 % on either side, however often was looked. Differences
are not normal where a swarm now and then fails whole: see `fewest_to_pass`.

Source:
    Repeated confidence intervals: C. Jennison and B. W. Turnbull, "Interim Analyses: The Repeated
    Confidence Interval Approach", J. R. Statist. Soc. B 51 (1989) 305-361. The boundary is that of
    S. J. Pocock, Biometrika 64 (1977) 191-199, computed for these looks by the recursion of P.
    Armitage, C. K. McPherson and B. C. Rowe, J. R. Statist. Soc. A 132 (1969) 235-244. Variances
    are estimated: Student's t at the same level (Jennison and Turnbull, Group Sequential Methods,
    2000, section 4.4), its quantile by M. Abramowitz and I. A. Stegun 26.7.5. The interval of a
    ratio is that of E. C. Fieller, J. R. Statist. Soc. B 16 (1954) 175-185.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vsense.base.arena import Floats

LOOKS = (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 400)
"""After so many pairs is looked."""
FEWEST_ALIKE = 48
"""Pairs that all differ by the same say nothing before: what is seldom had no time to happen. Where
in one of thirteen pairs it does, all of 48 are alike in 2.1 % of all cases."""
_BOUNDARY = 2.68854
"""In standard errors: a mean of normal differences with a known variance crosses it at one of
`LOOKS` in 5 % of all sequences. With fewer looks it does so less often."""

BETTER, NOT_WORSE, WORSE, NOT_CLEAR = "better", "not worse", "worse", "not clear"
"""What a comparison can say."""


@dataclass(frozen=True, slots=True)
class Shift:
    """How far new runs lie from old ones.

    Attributes:
        value: new mean minus old mean; a relative one is a share of the old mean's size.
        low, high: 95 % interval, for all looks at once; infinite where nothing is known.
        relative: it is a share.
    """

    value: float
    low: float
    high: float
    relative: bool

    @property
    def known(self) -> bool:
        """Whether it has bounds."""
        return math.isfinite(self.low) and math.isfinite(self.high)


def looks(pairs: int) -> Iterator[int]:
    """After how many pairs is looked, where there are at most so many, `LOOKS[-1]` or less."""
    yield from (look for look in LOOKS if look < pairs)
    yield pairs


def shift_of(old: Floats, new: Floats, relative: bool, alike: int = FEWEST_ALIKE) -> Shift:
    """The shift of pairs, two at least, by their order; see `Shift`.

    `alike`: so many pairs that all differ by the same say something.
    """
    x, y = float(old.mean()), float(new.mean())
    value = _divided(y - x, abs(x)) if relative else y - x
    if len(old) < alike and np.ptp(new - old) == 0.0:
        return Shift(value, -math.inf, math.inf, relative)
    if np.array_equal(old, new):
        return Shift(0.0, 0.0, 0.0, relative)
    squared = _quantile(len(old) - 1) ** 2 / len(old)
    if not relative:
        half = math.sqrt(squared * float((new - old).var(ddof=1)))
        return Shift(y - x, y - x - half, y - x + half, False)
    (xx, xy), (_, yy) = np.cov(old, new)
    # All ratios r for which the mean of new - r old may be 0: a r^2 - 2 b r + c <= 0.
    a, b, c = (u * v - squared * float(s) for u, v, s in ((x, x, xx), (x, y, xy), (y, y, yy)))
    if a <= 0.0:  # the old mean itself may be 0
        return Shift(value, -math.inf, math.inf, True)
    root = math.sqrt(max(b * b - a * c, 0.0))
    ends = sorted(math.copysign(1.0, x) * ((b + side) / a - 1.0) for side in (-root, root))
    return Shift(value, ends[0], ends[1], True)


def verdict_of(shift: Shift, margin: float, more_is_better: bool) -> str:
    """What a shift says where losses up to `margin`, in its unit, are accepted."""
    least, most = shift.low, shift.high
    if not more_is_better:
        least, most = -most, -least
    if least > 0.0:
        return BETTER
    if most < 0.0 and least < -margin:
        return WORSE
    return NOT_WORSE if least >= -margin else NOT_CLEAR


def fewest_to_pass(margin: float, relative: bool) -> int:
    """Before so many pairs nothing is better or not worse: what is seldom needs time to happen.

    A failure that loses everything in a share of the runs larger than a relative `margin` costs
    more than is accepted; no run of these pairs has it in 2.5 % of all cases at most.
    """
    if not relative:
        return FEWEST_ALIKE
    unseen = math.log(0.025) / math.log1p(-margin) if margin > 0.0 else math.inf
    return math.ceil(min(max(FEWEST_ALIKE, unseen), LOOKS[-1]))


def _divided(number: float, by: float) -> float:
    return number / by if by else math.nan


def _quantile(freedom: int) -> float:
    """Student's t where the normal distribution has `_BOUNDARY`."""
    z = _BOUNDARY
    terms = (
        (z**3 + z) / 4,
        (5 * z**5 + 16 * z**3 + 3 * z) / 96,
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
        (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160,
    )
    return z + math.fsum(term / freedom**power for power, term in enumerate(terms, 1))
