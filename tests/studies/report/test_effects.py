"""Effect sizes against published ones, and bootstrapped intervals against naive ones."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.studies.report.test_rank_tests import AFTER, AT_TERM, BEFORE, EARLY, numbers
from vsense.studies.report.study import effects
from vsense.studies.report.study.effects import effect_of, spread_of

Floats = NDArray[np.float64]


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
    monkeypatch.setattr(effects, "_MOST_SORTED", most)
    random = np.random.default_rng(5)
    first, second = random.integers(0, 30, 9) / 2.0, random.integers(0, 30, 9 if paired else 7) / 2
    shift_of, a12_of = effects._shift_of(first, second, paired), effects._A12(first, second)
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
    assert found.a12_low < found.a12 < found.a12_high and found.resamples == effects.RESAMPLES
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
