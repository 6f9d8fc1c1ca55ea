"""Tests of runs, effect sizes and intervals, against published examples and naive ones."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vsense.studies.report.study import _effects, _rank_tests
from vsense.studies.report.study._effects import effect_of, spread_of
from vsense.studies.report.study._rank_tests import (
    CHI_SQUARED,
    EXACT,
    NORMAL,
    equivalence,
    friedman,
    friedman_tails,
    holm,
    kruskal_wallis,
    rank_sum,
    rank_sum_tails,
    signed_rank,
    signed_rank_tails,
)

Floats = NDArray[np.float64]


def numbers(text: str) -> Floats:
    return np.array(text.split(), np.float64)


# Hollander & Wolfe (1973), 29f., depression scale factors; in R's help of wilcox.test.
BEFORE = numbers("1.83 0.50 1.62 2.48 1.68 1.88 1.55 3.06 1.30")
AFTER = numbers("0.878 0.647 0.598 2.05 1.06 1.29 1.06 3.14 1.29")
# Hollander & Wolfe (1973), 69f., permeability of membranes; likewise.
AT_TERM = numbers("0.80 0.83 1.89 1.04 1.45 1.38 1.91 1.64 0.73 1.46")
EARLY = numbers("1.15 0.88 0.90 0.74 1.21")
# Student (1908), sleep; R's data set `sleep`.
DRUG_1 = numbers("0.7 -1.6 -0.2 -1.2 -0.1 3.4 3.7 0.8 0.0 2.0")
DRUG_2 = numbers("1.9 0.8 1.1 0.1 -0.1 4.4 5.5 1.6 4.6 3.4")
# New York air quality (Chambers et al. 1983), ozone in May and August; R's help of wilcox.test.
MAY = numbers("41 36 12 18 28 23 19 8 7 16 11 14 18 14 34 6 30 11 1 11 4 32 23 45 115 37")
AUGUST = numbers("39 9 16 78 35 66 122 89 110 44 28 65 22 59 23 31 44 21 9 45 168 73 76 118 84 85")
# Hollander & Wolfe (1973), 140ff., rounding first base; R's help of friedman.test.
ROUNDING = numbers(
    "5.40 5.50 5.55 5.85 5.70 5.75 5.20 5.60 5.50 5.55 5.50 5.40 5.90 5.85 5.70 5.45 5.55 5.60"
    " 5.40 5.40 5.35 5.45 5.50 5.35 5.25 5.15 5.00 5.85 5.80 5.70 5.25 5.20 5.10 5.65 5.55 5.45"
    " 5.60 5.35 5.45 5.05 5.00 4.95 5.50 5.50 5.40 5.45 5.55 5.50 5.55 5.55 5.35 5.45 5.50 5.55"
    " 5.50 5.45 5.25 5.65 5.60 5.40 5.70 5.65 5.55 6.30 6.30 6.25"
).reshape(-1, 3)
# Hollander & Wolfe (1973), 116, mucociliary efficiency; R's help of kruskal.test.
EFFICIENCY = [
    numbers("2.9 3.0 2.5 2.6 3.2"), numbers("3.8 2.7 4.0 2.4"), numbers("2.8 3.4 3.7 2.2 2.0"),
]  # fmt: skip


def test_signed_rank_of_hollander_and_wolfe() -> None:
    """R: V = 40, one-sided p = 0.01953."""
    found = signed_rank(BEFORE, AFTER)
    assert (found.value, found.method, found.n) == (40.0, EXACT, (9,))
    assert found.p == pytest.approx(2 * 0.01953, abs=1e-5)
    assert found.least_p == 2 / 2**9


def test_rank_sum_of_hollander_and_wolfe() -> None:
    """R: W = 35, one-sided p = 0.1272."""
    found = rank_sum(AT_TERM, EARLY)
    assert (found.value, found.method, found.n) == (35.0, EXACT, (10, 5))
    assert found.p == pytest.approx(2 * 0.1272, abs=1e-4)
    assert found.least_p == pytest.approx(2 / math.comb(15, 5))


def test_ties_are_exact_for_few_runs() -> None:
    """R's exactRankTests::wilcox.exact(extra ~ group, sleep): W = 25.5, p = 0.06582."""
    found = rank_sum(DRUG_1, DRUG_2)
    assert (found.value, found.method) == (25.5, EXACT)
    assert found.p == pytest.approx(0.06582, abs=1e-5)
    # All nine pairs that differ have the same sign.
    assert signed_rank(DRUG_1, DRUG_2).p == 2 / 2**9


def test_many_runs_are_approximated_as_in_r(monkeypatch: pytest.MonkeyPatch) -> None:
    """R, with ties: W = 127.5, p = 0.0001208; sleep W, p = 0.06933; paired V = 0, p = 0.009091."""
    monkeypatch.setattr(_rank_tests, "MOST_EXACT", 0)
    found = rank_sum(MAY, AUGUST)
    assert (found.value, found.method) == (127.5, NORMAL)
    assert found.p == pytest.approx(0.0001208, abs=5e-8)
    assert rank_sum(DRUG_1, DRUG_2).p == pytest.approx(0.06933, abs=5e-6)
    assert signed_rank(DRUG_1, DRUG_2).p == pytest.approx(0.009091, abs=5e-7)


@pytest.mark.campaign
def test_exact_distributions_are_scipys() -> None:
    from scipy import stats

    drawn = np.random.default_rng(3).permutation(40).astype(np.float64)
    first, second = drawn[:17], drawn[17:] + 4.5
    expected = stats.mannwhitneyu(first, second, method="exact")
    assert rank_sum(first, second).p == pytest.approx(float(expected.pvalue), rel=1e-9)
    pairs = drawn[:20], drawn[20:] + np.linspace(3.0, 5.0, 20)
    exact = stats.wilcoxon(*pairs, method="exact")
    assert signed_rank(*pairs).p == pytest.approx(float(exact.pvalue), rel=1e-9)


def test_friedman_of_hollander_and_wolfe(monkeypatch: pytest.MonkeyPatch) -> None:
    """R: chi-squared = 11.143, df = 2, p = 0.003805."""
    monkeypatch.setattr(_rank_tests, "friedman_tails", lambda ranks: None)
    found = friedman(ROUNDING)
    assert (found.n, found.df, found.method) == ((22,), 2, CHI_SQUARED)
    assert found.value == pytest.approx(11.143, abs=5e-4)
    assert found.p == pytest.approx(0.003805, abs=5e-7)


@pytest.mark.parametrize(
    ("conditions", "blocks", "sums", "p"),
    [(3, 3, (3, 6, 9), 0.028), (3, 4, (5, 7, 12), 0.042), (4, 2, (2, 4, 6, 8), 0.042)],
)
def test_few_blocks_are_exact(
    conditions: int, blocks: int, sums: tuple[int, ...], p: float
) -> None:
    """Friedman's own table (1937), also Siegel (1956), table N: chi-squared 6, 6.5, 6."""
    order = np.arange(1.0, conditions + 1.0)
    ranks = np.tile(order, (blocks, 1))
    if sums == (5, 7, 12):
        ranks[:1] = (2.0, 1.0, 3.0)
    assert tuple(ranks.sum(axis=0)) == sums
    tails = friedman_tails(ranks)
    assert tails is not None and tails[0] == pytest.approx(p, abs=5e-4)


def test_friedmans_distribution_is_that_of_all_orders() -> None:
    """With ties, by trying all."""
    from itertools import permutations, product

    ranks = np.array([[1.0, 2.5, 2.5], [3.0, 1.0, 2.0], [1.5, 1.5, 3.0]])
    spreads = [
        float(np.var(np.sum(rows, axis=0)))
        for rows in product(*(list(permutations(row)) for row in ranks.tolist()))
    ]
    found = float(np.var(ranks.sum(axis=0)))
    expected = np.mean([spread >= found - 1e-9 for spread in spreads])
    tails = friedman_tails(ranks)
    assert tails is not None and tails[0] == pytest.approx(float(expected))


def test_too_many_orders_are_not_counted() -> None:
    assert friedman_tails(np.tile(np.arange(1.0, 11.0), (4, 1))) is None
    found = friedman(np.random.default_rng(1).normal(size=(8, 10)))
    assert found.method == CHI_SQUARED and found.least_p is None


def test_kruskal_wallis_of_hollander_and_wolfe() -> None:
    """R: chi-squared = 0.77143, df = 2, p = 0.68."""
    found = kruskal_wallis(EFFICIENCY)
    assert found.value == pytest.approx(0.77143, abs=5e-6) and found.df == 2
    assert found.p == pytest.approx(0.68, abs=5e-3) and found.n == (5, 4, 5)


def test_holm() -> None:
    """Wikipedia's example of the Holm-Bonferroni method; R's p.adjust gives the same."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0] and holm([]) == []


def sample(mean: float, sd: float, n: int) -> Floats:
    """Numbers of just this mean and sample standard deviation."""
    values = np.arange(n) - (n - 1) / 2.0
    return np.asarray(mean + sd * values / values.std(ddof=1))


def test_equivalence_of_lakens() -> None:
    """Lakens (2017), and R's TOSTER: Moery & Calin-Jageman's second study, margin d = 0.43."""
    margin = 0.43 * math.sqrt((0.95**2 + 0.83**2) / 2.0)
    first, second = sample(5.25, 0.95, 95), sample(5.22, 0.83, 89)
    found = equivalence(first, second, margin, paired=False)
    assert (found.difference, found.df) == pytest.approx((0.03, 181.1), abs=0.05)
    assert found.upper_t == pytest.approx(-2.69, abs=5e-3)
    assert found.p == pytest.approx(0.004, abs=5e-4)


def test_paired_equivalence_of_lakens() -> None:
    """Lakens (2017), and R's TOSTER: n = 65, r = 0.75, dz = 0.4: t(64) = -2.49, p = .0077."""
    sd = math.sqrt(1.17**2 + 1.30**2 - 2 * 0.75 * 1.17 * 1.30)
    differences = sample(5.83 - 5.75, sd, 65)
    found = equivalence(differences, np.zeros(65), 0.4 * sd, paired=True)
    assert found.upper_t == pytest.approx(-2.49, abs=5e-3) and found.df == pytest.approx(64)
    assert found.p == pytest.approx(0.0077, abs=1e-4)


@pytest.mark.parametrize(
    ("test", "given", "reason"),
    [
        (rank_sum, (np.ones(4), np.ones(3)), "all runs gave the same"),
        (rank_sum, (np.ones(1), np.arange(3.0)), "has 1 run, at least 2 of each needed"),
        (rank_sum, (np.zeros(0), np.zeros(0)), "has 0 runs"),
        (signed_rank, (np.ones(4), np.ones(4)), "both runs of every pair gave the same"),
        (signed_rank, (np.ones(1), np.zeros(1)), "1 pair, at least 2 needed"),
        (friedman, (np.ones((4, 3)),), "all conditions gave the same in every block"),
        (friedman, (np.ones((1, 3)),), "1 complete block, at least 2 needed"),
        (kruskal_wallis, ([np.ones(3)] * 3,), "all runs gave the same"),
        (equivalence, (np.ones(3), np.ones(4), 1.0, False), "there is no spread"),
        (equivalence, (np.ones(1), np.ones(4), 1.0, False), "1 run, at least 2 needed"),
        (equivalence, (np.arange(3.0) + 1, np.arange(3.0), 1.0, True), "all differences are the"),
    ],
)
def test_what_cannot_be_tested_says_why(
    test: Callable[..., Any], given: tuple[Any, ...], reason: str
) -> None:
    found = test(*given)
    assert found.p is None and reason in found.reason


def test_the_least_p_is_that_of_the_most_extreme_runs() -> None:
    """Three against three: 2 of 20 orders; four pairs: 2 of 16 signs (Siegel 1956, tables J, G)."""
    ranks = np.arange(1.0, 7.0)
    assert rank_sum_tails(ranks, 3, 6.0) == pytest.approx((0.1, 0.1))
    assert rank_sum_tails(ranks, 3, 10.0)[1] == pytest.approx(0.1)
    assert signed_rank_tails(np.arange(1.0, 5.0), 0.0) == (0.125, 0.125)


def test_ties_of_decimals_are_ties() -> None:
    """0.3 - 0.2 is not 0.2 - 0.1 in floating point: without care V would be 8 and p 0.5."""
    found = _rank_tests.signed_rank(np.array([0.3, 0.2, 0.7, 0.9]), np.array([0.2, 0.1, 0.6, 1.0]))
    assert (found.value, found.p) == (7.5, 0.625)


def test_no_run_has_no_difference() -> None:
    found = _rank_tests.equivalence(np.zeros(0), np.ones(3), 1.0, False)
    assert found.difference is None and found.reason == "0 runs, at least 2 needed"


def test_a12_of_published_examples() -> None:
    """Hogarty & Kromrey (1999), in R's effsize: Cliff's delta -0.25; A12 = (delta + 1) / 2."""
    treatment = numbers("10 10 20 20 20 30 30 30 40 50")
    control = numbers("10 20 30 40 40 50")
    assert effect_of(treatment, control, False, 1).a12 == 0.375
    # Vargha & Delaney (2000), equation 14, of the rank-sum test's W = 35 of 10 x 5 pairs.
    assert effect_of(AT_TERM, EARLY, False, 1).a12 == pytest.approx(35 / 50)


def test_shifts_of_hollander_and_wolfe() -> None:
    """Hollander & Wolfe (1973): 0.305 (p. 77); of pairs 0.46 (p. 34)."""
    assert effect_of(AT_TERM, EARLY, False, 1).shift == pytest.approx(0.305)
    assert effect_of(BEFORE, AFTER, True, 1).shift == pytest.approx(0.46)


def naive(first: Floats, second: Floats, paired: bool) -> tuple[float, float]:
    """A12 and shift as their definitions say."""
    wins = [(a > b) + 0.5 * (a == b) for a in first for b in second]
    if paired:
        apart = first - second
        walsh = [(a + b) / 2 for i, a in enumerate(apart) for b in apart[i:]]
        return float(np.mean(wins)), float(np.median(walsh))
    return float(np.mean(wins)), float(np.median([a - b for a in first for b in second]))


@pytest.mark.parametrize("paired", [False, True])
@pytest.mark.parametrize("most", [10_000, 0])
def test_a_weighed_resample_is_the_resample(
    monkeypatch: pytest.MonkeyPatch, paired: bool, most: int
) -> None:
    """Both ways to a median, the sorted and the searched one; searching finds the lower middle."""
    monkeypatch.setattr(_effects, "_MOST_SORTED", most)
    random = np.random.default_rng(5)
    first, second = random.integers(0, 30, 9) / 2.0, random.integers(0, 30, 9 if paired else 7) / 2
    shift_of, a12_of = _effects._shift_of(first, second, paired), _effects._A12(first, second)
    for _ in range(30):
        drawn = random.integers(len(first), size=len(first))
        other = drawn if paired else random.integers(len(second), size=len(second))
        weights = [
            np.bincount(some, minlength=len(of)).astype(np.float64)[None]
            for some, of in ((drawn, first), (other, second))
        ]
        a12, shift = naive(first[drawn], second[other], paired)
        assert a12_of(*weights)[0] == pytest.approx(a12)
        assert shift_of(*weights)[0] == pytest.approx(shift, abs=1e-6)


def test_intervals_come_again_with_their_seed_and_hold_the_effect() -> None:
    found = effect_of(BEFORE, AFTER, True, 1)
    assert found == effect_of(BEFORE, AFTER, True, 1) != effect_of(BEFORE, AFTER, True, 2)
    assert found.a12_low is not None and found.a12_high is not None
    assert found.a12_low < found.a12 < found.a12_high and found.resamples == _effects.RESAMPLES
    one = effect_of(np.ones(1), np.zeros(3), False, 1)
    assert (one.a12, one.a12_low, one.resamples) == (1.0, None, 0), "of one run there is none"


@pytest.mark.campaign
def test_intervals_cover_as_often_as_they_say() -> None:
    """Of 200 samples of two normal populations 1 apart, about 95 % hold A12 = 0.760 and shift 1."""
    random = np.random.default_rng(1)
    held = np.zeros(2)
    for seed in range(200):
        found = effect_of(random.normal(1, 1, 20), random.normal(0, 1, 20), False, seed)
        assert found.a12_low is not None and found.a12_high is not None
        assert found.shift_low is not None and found.shift_high is not None
        held += (
            found.a12_low <= 0.7602 <= found.a12_high,
            found.shift_low <= 1.0 <= found.shift_high,
        )
    assert (held >= 180).all() and (held <= 198).all(), held


def test_a_spread_is_that_of_mcgill_and_of_textbooks() -> None:
    """Quartiles as R's type 7, NumPy's; the notch 1.57 IQR / sqrt(n) (McGill et al. 1978)."""
    found = spread_of(numbers("2 4 4 4 5 5 7 9"))
    assert (found.n, found.mean, found.median) == (8, 5.0, 4.5)
    assert found.sd == pytest.approx(2.13809) and found.cv == pytest.approx(0.427618)
    assert found.quartiles == (4.0, 5.5)
    assert found.notch == pytest.approx((4.5 - 0.83262, 4.5 + 0.83262), abs=1e-4)
    one = spread_of(np.zeros(1))
    assert (one.sd, one.cv, one.notch) == (None, None, None)
    assert spread_of(np.array([-1.0, 1.0])).cv is None, "of a mean of 0 there is none"
