"""Computes what a study gives: each measure's spreads, tests, effects and equivalences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from vsense.base.arena import Floats
from vsense.base.errors import UsageError, instead
from vsense.run.runs_csv import RunRow
from vsense.studies.report import Questions
from vsense.studies.report.study import _rank_tests
from vsense.studies.report.study._design import Arm, Study, studies
from vsense.studies.report.study._effects import EffectSize, Spread, effect_of, spread_of
from vsense.studies.report.study._rank_tests import Equivalence, RankTest

MOST_ARMS = 10
"""Conditions that are all compared with each other."""


@dataclass(frozen=True, slots=True)
class PairResult:
    """Two conditions in one measure; `adjusted` p are Holm's, over the pairs of the measure.

    `n` are the runs of each, or how many pairs of runs there are.
    """

    first: str
    second: str
    n: Sequence[int]
    test: RankTest | None
    effect: EffectSize | None
    same: Equivalence | None = None
    adjusted: float | None = None
    same_adjusted: float | None = None


@dataclass(frozen=True, slots=True)
class MeasureResult:
    """One measure of a study.

    Attributes:
        values: of the runs of each arm; `spreads` of those that have any.
        without: how many valid runs of each arm have no number.
        paired: runs are compared in pairs or blocks, of which `dropped` are not complete.
        overall: the test of all conditions together, where there are three or more.
        left_out: why not all pairs are there; "": they are.
    """

    measure: str
    values: Sequence[Floats]
    spreads: Sequence[Spread | None]
    without: Sequence[int]
    paired: bool
    dropped: int
    overall: RankTest | None
    pairs: Sequence[PairResult]
    left_out: str = ""


@dataclass(frozen=True, slots=True)
class StudyResult:
    """What a study gave."""

    study: Study
    measures: Sequence[MeasureResult]

    @property
    def counts(self) -> str:
        """How many runs each condition has, and how many were void."""
        return ", ".join(
            f"{arm.label} n = {len(arm.runs)} ({len(arm.voids)} invalid)" for arm in self.study.arms
        )


def results_of(
    rows: Sequence[RunRow], asked: Questions, show: Callable[[str], None] = lambda text: None
) -> list[StudyResult]:
    """Sorts runs into studies and computes these; `show` takes what is at work.

    UsageError where a question names a column, a measure or a condition that there is not.
    """
    sorted_runs = studies(rows, asked.by, asked.independent)
    _require(sorted_runs, asked)
    return [result_of(study, asked, show) for study in sorted_runs]


def _require(sorted_runs: Sequence[Study], asked: Questions) -> None:
    measures = list(dict.fromkeys(name for study in sorted_runs for name in study.measures))
    for option, names in (("--same", asked.margins), ("--measure", asked.only)):
        for name in names:
            if name not in measures:
                raise UsageError(
                    f"{option} {name}: no measure of these runs; {instead(name, measures)}"
                )
    labels = [arm.label for study in sorted_runs for arm in study.arms]
    if asked.against and asked.against not in labels:
        named = instead(asked.against, labels)
        raise UsageError(f"--against {asked.against}: no condition of these runs; {named}")


def result_of(
    study: Study, asked: Questions, show: Callable[[str], None] = lambda text: None
) -> StudyResult:
    """Computes everything; `show` takes what is at work."""
    outcomes = []
    for name in study.measures:
        if not asked.only or name in asked.only:
            show(f"{study.title}: {name}")
            outcomes.append(_measure(study, name, asked))
    return StudyResult(study, outcomes)


def _measure(study: Study, name: str, asked: Questions) -> MeasureResult:
    arms, paired = study.arms, bool(study.keyed)
    values = [arm.values(name) for arm in arms]
    table, dropped = study.blocks(name, arms) if paired else (np.zeros((0, 0)), 0)
    compared = list(table.T) if paired else values
    overall: RankTest | None = None
    if asked.tests and len(arms) > 2:
        overall = _rank_tests.friedman(table) if paired else _rank_tests.kruskal_wallis(values)
    pairs, left_out = _wanted(arms, asked)
    return MeasureResult(
        measure=name,
        values=values,
        spreads=[spread_of(numbers) if len(numbers) else None for numbers in values],
        without=[len(arm.runs) - len(numbers) for arm, numbers in zip(arms, values)],
        paired=paired,
        dropped=dropped,
        overall=overall,
        pairs=_adjusted([_pair(name, arms, compared, pair, paired, asked) for pair in pairs]),
        left_out=left_out,
    )


def _wanted(arms: Sequence[Arm], asked: Questions) -> tuple[list[tuple[int, int]], str]:
    labels = [arm.label for arm in arms]
    if asked.against in labels:
        against = labels.index(asked.against)
        return [(place, against) for place in range(len(arms)) if place != against], ""
    if len(arms) > MOST_ARMS:
        return [], (
            f"{len(arms)} conditions are {len(arms) * (len(arms) - 1) // 2} pairs, which are not"
            " compared: --against CONDITION compares all others with one"
        )
    return list(combinations(range(len(arms)), 2)), ""


def _pair(
    name: str,
    arms: Sequence[Arm],
    values: Sequence[Floats],
    pair: tuple[int, int],
    paired: bool,
    asked: Questions,
) -> PairResult:
    first, second = (values[place] for place in pair)
    test = same = effect = None
    if asked.tests:
        test = (_rank_tests.signed_rank if paired else _rank_tests.rank_sum)(first, second)
        if name in asked.margins:
            same = _rank_tests.equivalence(first, second, asked.margins[name], paired)
    if len(first) and len(second):
        effect = effect_of(first, second, paired, asked.seed)
    n = (len(first),) if paired else (len(first), len(second))
    label, other_label = (arms[place].label for place in pair)
    return PairResult(label, other_label, n, test, effect, same)


def _adjusted(pairs: Sequence[PairResult]) -> list[PairResult]:
    tests, equivalences = _holm([pair.test for pair in pairs]), _holm([pair.same for pair in pairs])
    return [
        replace(pair, adjusted=test, same_adjusted=equivalence)
        for pair, test, equivalence in zip(pairs, tests, equivalences)
    ]


def _holm(tests: Sequence[RankTest | Equivalence | None]) -> list[float | None]:
    """Holm's correction, over those that could be tested."""
    p = [None if test is None else test.p for test in tests]
    adjusted = iter(_rank_tests.holm([value for value in p if value is not None]))
    return [None if value is None else next(adjusted) for value in p]


def as_json(result: StudyResult) -> dict[str, Any]:
    """All numbers of a study, for scripts."""
    study = result.study
    arms = [
        {
            "condition": arm.label,
            "n": len(arm.runs),
            "runs": [run.run for run in arm.runs],
            "void": [{"run": run.run, "why": run.why} for run in arm.voids],
        }
        for arm in study.arms
    ]
    return {
        **dict(study.where),
        "by": list(study.by),
        "conditions": arms,
        "paired_by": list(study.keyed),
        "independent_because": study.why_independent,
        "differences": {
            name: dict(zip(_labels(study), texts)) for name, texts in study.differences()
        },
        "measures": {measure.measure: _measure_json(study, measure) for measure in result.measures},
    }


def _measure_json(study: Study, outcome: MeasureResult) -> dict[str, Any]:
    spreads = [None if spread is None else asdict(spread) for spread in outcome.spreads]
    return {
        "conditions": {
            label: {"values": values.tolist(), "without": without, "spread": spread}
            for label, values, without, spread in zip(
                _labels(study), outcome.values, outcome.without, spreads
            )
        },
        "paired": outcome.paired,
        "incomplete_blocks": outcome.dropped,
        "overall": None if outcome.overall is None else asdict(outcome.overall),
        "pairs": [asdict(pair) for pair in outcome.pairs],
        "left_out": outcome.left_out,
    }


def _labels(study: Study) -> list[str]:
    return [arm.label for arm in study.arms]
