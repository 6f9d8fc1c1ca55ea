"""What a study gave, in plain sentences; and the paragraph for a paper's methods."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Sequence
from importlib import metadata

import numpy as np

from vsense import __version__
from vsense.monitor.pictures.run_figure import spoken
from vsense.studies.report import Questions
from vsense.studies.report._markup import DASH, figure_of, share_of
from vsense.studies.report.study._effects import EffectSize
from vsense.studies.report.study._rank_tests import (
    ALPHA,
    CHI_SQUARED,
    NORMAL,
    Equivalence,
    RankTest,
)
from vsense.studies.report.study._results import MeasureResult, PairResult, StudyResult

_MINUS = "−"
_FEW = 5
"""Runs or blocks below which a large-sample approximation is called rough."""


def number(value: float | None, signed: bool = False) -> str:
    """A number of three digits, with a real minus sign."""
    text = figure_of(value)
    if value is not None and signed and value > 0.0:
        text = f"+{text}"
    return text.replace("-", _MINUS)


def p_of(p: float | None) -> str:
    """A p as papers write it."""
    if p is None:
        return DASH
    return "< 0.0001" if p < 1e-4 else f"{p:.4f}" if p < 1e-3 else f"{p:.2g}" if p < 0.995 else "1"


def equals_p(p: float) -> str:
    """A p with its sign."""
    return f"p {p_of(p)}" if p < 1e-4 else f"p = {p_of(p)}"


def interval(value: float | None, low: float | None, high: float | None, signed: bool) -> str:
    """A value and its interval."""
    if value is None:
        return DASH
    text = number(value, signed)
    if low is None or high is None:
        return text
    return f"{text} ({number(low, signed)} to {number(high, signed)})"


def statistic(test: RankTest | None) -> str:
    """A statistic with its name and degrees of freedom."""
    if test is None or test.value is None:
        return DASH
    freedom = "" if test.df is None else f"({test.df})"
    return f"{test.symbol}{freedom} = {number(test.value)}"


def n_of(n: Sequence[int], paired: bool) -> str:
    """How many values a test had."""
    if paired:
        return f"{n[0]} {'pair' if n[0] == 1 else 'pairs'}"
    return ", ".join(map(str, n[:-1])) + f" and {n[-1]}" if len(n) > 1 else str(n[0])


def sentences(result: StudyResult, outcome: MeasureResult) -> Iterator[str]:
    """What was found in a measure, a sentence or some for each comparison."""
    yield from _left_out(result, outcome)
    if outcome.overall is not None:
        yield _overall(outcome.overall, outcome.paired)
    yield from _powerless(outcome)
    for pair in outcome.pairs:
        yield _pair(pair, outcome)
        if pair.same is not None:
            yield _same(pair, pair.same)
    if outcome.left_out:
        yield f"{outcome.left_out[0].upper()}{outcome.left_out[1:]}."


def _left_out(result: StudyResult, outcome: MeasureResult) -> Iterator[str]:
    for arm, without in zip(result.study.arms, outcome.without):
        if without:
            yield (
                f"{arm.label}: {without} of {len(arm.runs)} valid runs gave no number and are"
                " left out of this measure."
            )
    if outcome.dropped:
        what = (
            "blocks are not complete and are"
            if outcome.dropped > 1
            else "block is not complete and is"
        )
        yield (
            f"{outcome.dropped} {what} left out of the comparison: a condition has no valid run"
            " with a number there."
        )


def _overall(test: RankTest, paired: bool) -> str:
    if test.p is None:
        return f"All conditions together: not tested ({test.reason})."
    n = f"{test.n[0]} complete blocks" if paired else f"n = {n_of(test.n, False)}"
    words = (
        f"All conditions together: {test.name} ({test.method}), {n}, {statistic(test)},"
        f" {equals_p(test.p)}."
    )
    if test.method == CHI_SQUARED and min(test.n) < _FEW:
        words += " With so few runs the approximation is rough."
    return words


def _pair(pair: PairResult, outcome: MeasureResult) -> str:
    who, test = f"{pair.first} against {pair.second}", pair.test
    words = f"{who}:"
    if test is not None and test.p is None:
        words += f" not tested ({test.reason})."
    elif test is not None and test.p is not None:
        n = n_of(pair.n, outcome.paired)
        words += f" {test.name} ({test.method}), {n if outcome.paired else f'n = {n}'},"
        words += f" {statistic(test)}, {equals_p(test.p)}"
        tested = sum(compared.adjusted is not None for compared in outcome.pairs)
        if tested > 1 and pair.adjusted is not None:
            words += f", Holm-adjusted over {tested} pairs {equals_p(pair.adjusted)}"
        weak = test.least_p is not None and test.least_p > ALPHA
        words += f".{f' With so few runs it cannot be below {p_of(test.least_p)}.' if weak else ''}"
    return words + ("" if pair.effect is None else _effect(pair, pair.effect))


def _powerless(outcome: MeasureResult) -> Iterator[str]:
    """Says where no result at all could have given a small p, in any pair."""
    tests = [pair.test for pair in outcome.pairs if pair.test is not None]
    least = [test.least_p for test in tests if test.p is not None]
    values = [p for p in least if p is not None]
    if not values or len(values) < len(least) or min(values) * len(values) <= ALPHA:
        return
    words = " adjusted over the pairs" if len(values) > 1 else ""
    yield (
        f"With so few runs p{words} cannot be below {p_of(min(min(values) * len(values), 1.0))},"
        " whatever the runs give: these tests can show no difference."
    )


def _effect(pair: PairResult, effect: EffectSize) -> str:
    a12, shift = f"A12 = {number(effect.a12)}", f"shift {number(effect.shift, True)}"
    if effect.resamples:
        a12 += f", 95 % interval {number(effect.a12_low)} to {number(effect.a12_high)}"
        low, high = (number(end, True) for end in (effect.shift_low, effect.shift_high))
        shift += f", 95 % interval {low} to {high}"
    words = (
        f" A run of {pair.first} gives more than one of {pair.second} in"
        f" {share_of(effect.a12)} % of all combinations, ties counted half ({a12}); {shift}."
    )
    if effect.resamples and effect.a12 in (0.0, 1.0):
        words += " They do not overlap: the bootstrap cannot say how near A12 is to that."
    return words


def _same(pair: PairResult, same: Equivalence) -> str:
    who = f"{pair.first} the same as {pair.second} within ±{number(same.margin)}"
    if same.p is None or pair.same_adjusted is None:
        return f"{who}: not tested ({same.reason})."
    shown = pair.same_adjusted <= ALPHA
    reach = f"{number(same.low, True)} to {number(same.high, True)}"
    adjusted = ""
    if pair.same_adjusted != same.p:
        adjusted = f", Holm-adjusted {equals_p(pair.same_adjusted)}"
    return (
        f"{who}: {same.name}, difference of means {number(same.difference, True)} (90 % interval"
        f" {reach}),"
        f" t({number(same.df)}) = {number(same.lower_t)} and {number(same.upper_t)},"
        f" {equals_p(same.p)}{adjusted}: {'shown' if shown else 'not shown'} at 5 %."
    )


def software(tests: bool) -> str:
    """The versions of what computed."""
    scipy = f"SciPy {metadata.version('scipy')}, " if tests else ""
    python = platform.python_version()
    return f"vsense {__version__}, {scipy}NumPy {np.__version__} and Python {python}"


def methods(results: Sequence[StudyResult], asked: Questions) -> str:
    """The paragraph on statistics of a paper's methods: what was done here, and no more."""
    arms = [arm for result in results for arm in result.study.arms]
    runs, voids = sum(len(arm.runs) for arm in arms), sum(len(arm.voids) for arm in arms)
    left_out = "no run was invalid"
    if voids:
        left_out = (
            f"{voids} further {'run was' if voids == 1 else 'runs were'} invalid and left out"
        )
    parts = [
        f"The unit of analysis is the run: each of {runs} valid runs gives one value of a measure;"
        f" {left_out}.",
        *(_tests_used(results) if asked.tests else ()),
        *_effects_used(results, asked),
        *_claims(results),
        f"Computed with {software(asked.tests)}.",
    ]
    return " ".join(parts)


def _tests_used(results: Sequence[StudyResult]) -> Iterator[str]:
    measures = [m for result in results for m in result.measures]
    overall = [m.overall for m in measures if m.overall and m.overall.p is not None]
    tests = [pair.test for m in measures for pair in m.pairs]
    done = [test for test in tests if test is not None and test.p is not None]
    if overall:
        yield f"Three or more conditions were compared with the {_named(overall)}."
    if done:
        yield f"Two conditions were compared with the two-sided {_named(done)}."
    if any(test.name.startswith("Wilcoxon") and test.method != NORMAL for test in done):
        yield "Exact p are those of the permutation distribution, given the ties."
    if any(test.name == "Wilcoxon signed-rank test" for test in done):
        keys = next(result.study.keyed for result in results if result.study.keyed)
        names = [name for name in keys if name != "series"]
        yield f"Runs with the same {', '.join(names)} are pairs; equal ones were left out of it."
    most = max((sum(p.adjusted is not None for p in m.pairs) for m in measures), default=0)
    if most > 1:
        yield "p of pairs were adjusted by Holm's method over the pairs of a measure."
    if done and len({m.measure for m in measures}) > 1:
        yield "p were not adjusted over measures."


def _named(tests: Sequence[RankTest]) -> str:
    names = dict.fromkeys(f"{test.name} ({test.method})" for test in tests)
    return " and the ".join(names)


def _effects_used(results: Sequence[StudyResult], asked: Questions) -> Iterator[str]:
    pairs = [pair for result in results for measure in result.measures for pair in measure.pairs]
    drawn = sorted({pair.effect.resamples for pair in pairs if pair.effect} - {0})
    if any(pair.effect for pair in pairs):
        words = "Effect sizes are Vargha and Delaney's A12 and the Hodges-Lehmann shift"
        if drawn:
            counts = " or ".join(map(str, drawn))
            words += (
                f", with 95 % percentile bootstrap intervals ({counts} resamples of runs, seed"
                f" {asked.seed})"
            )
        yield f"{words}."


def _claims(results: Sequence[StudyResult]) -> Iterator[str]:
    claims = [
        (measure.measure, pair.same)
        for result in results
        for measure in result.measures
        for pair in measure.pairs
        if pair.same is not None
    ]
    if claims:
        margins = dict.fromkeys(f"{spoken(name)} ±{number(test.margin)}" for name, test in claims)
        names = dict.fromkeys(test.name for _, test in claims)
        yield (
            f"Equivalence was tested with {' and '.join(names)} at 5 %, against margins chosen"
            f" beforehand: {', '.join(margins)}."
        )
