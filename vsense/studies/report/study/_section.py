"""The part of a report's page that shows a study."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from html import escape

from vsense.base.terminal import spoken
from vsense.studies.report import Questions, _plot
from vsense.studies.report._markup import DASH, Counter, PageFigure, note, share_of
from vsense.studies.report._plot import Drawing
from vsense.studies.report.study import _words as words
from vsense.studies.report.study._results import MeasureResult, StudyResult
from vsense.studies.report.study._words import interval, n_of, number, p_of, statistic

_LETTERS = 30


def boxes(result: StudyResult, prefix: str) -> Iterator[Drawing]:
    """Draws each measure of a study; `prefix` begins the files' names."""
    arms = [arm.label for arm in result.study.arms]
    for place, outcome in enumerate(result.measures, start=1):
        groups = list(zip(arms, (values.tolist() for values in outcome.values)))
        figure = _plot.runs_figure(outcome.measure, groups, _LETTERS)
        file = f"{prefix}{place:02d}-{_plot.file_words(outcome.measure)}"
        title = f"{spoken(outcome.measure)} of each run".capitalize()
        yield Drawing(file, title, caption(result, outcome), figure)


def caption(result: StudyResult, outcome: MeasureResult) -> str:
    """What a figure shows, with the number of runs and of void ones."""
    arms = result.study.arms
    words = f"{result.study.title}. {_plot.RUNS_LEGEND.capitalize()}"
    few = [a.label for a, v in zip(arms, outcome.values) if len(v) < _plot.FEWEST_BOXED]
    if few:
        words += f"; no box of fewer than {_plot.FEWEST_BOXED} runs ({', '.join(few)})"
    counts = [
        f"{arm.label} {len(values)} (invalid: {len(arm.voids)})"
        for arm, values in zip(arms, outcome.values)
    ]
    return f"{words}. n: {', '.join(counts)}. Invalid runs are not drawn."


MOST_VOID_RUNS = 200
"""Void runs that are listed."""


def section(
    result: StudyResult, pictures: Sequence[PageFigure], counter: Counter, number_: int, tests: bool
) -> str:
    """The section of a study, which is the page's `number_`-th, from 0."""
    study = result.study
    first = " class=first" if number_ == 0 else ""
    what = " against ".join(arm.label for arm in study.arms) if len(study.arms) < 4 else ""
    what = what or f"{len(study.arms)} conditions"
    return "".join(
        [
            f'<h2 id="study-{number_}"{first}>{escape(study.title)}: {escape(what)}</h2>\n',
            f"<p>{escape(_introduction(result))}</p>\n",
            *_warnings(result),
            counter.figures(pictures),
            f"<h3>Run-to-run spread</h3>\n{_spreads(result, counter)}" if result.measures else "",
            *(_comparisons(result, counter, tests) if result.measures and study.arms[1:] else ()),
            _voids(result, counter),
        ]
    )


def _introduction(result: StudyResult) -> str:
    study = result.study
    text = (
        f"The run is the unit: each valid run gives one value of a measure. Runs: {result.counts}."
    )
    if len(study.arms) < 2:
        return f"{text} There is one condition only: nothing is compared."
    if study.keyed:
        names = [name for name in study.keyed if name != "series"]
        return f"{text} Runs with the same {', '.join(names)} are compared with each other."
    return f"{text} Runs are compared as independent ones: {study.why_independent}."


def _warnings(result: StudyResult) -> Iterator[str]:
    """What else runs differ in: it may be the cause as well."""
    labels = [arm.label for arm in result.study.arms]
    for name, texts in result.study.differences():
        if len(set(texts)) > 1:
            values = "; ".join(f"{label}: {text}" for label, text in zip(labels, texts))
            yield note(f"The conditions differ in {name}, too: {values}.", "warning")
        else:
            yield note(f"Runs of one condition differ in {name}: {texts[0]}.", "warning")
    for arm in result.study.arms:
        if not arm.runs:
            yield note(f"{arm.label} has no valid run.", "warning")
    if not result.measures:
        yield note("No valid run has a measure: nothing is drawn or compared.", "warning")


def _spreads(result: StudyResult, counter: Counter) -> str:
    rows = []
    for outcome in result.measures:
        for arm, spread in zip(result.study.arms, outcome.spreads):
            name = spoken(outcome.measure)
            if spread is None:
                rows.append([name, arm.label, "0", str(len(arm.voids)), *[DASH] * 7])
                continue
            quartiles = " to ".join(number(value) for value in spread.quartiles)
            rows.append(
                [
                    name,
                    arm.label,
                    str(spread.n),
                    str(len(arm.voids)),
                    number(spread.median),
                    quartiles,
                    number(spread.mean),
                    number(spread.sd),
                    share_of(spread.cv),
                    number(spread.least),
                    number(spread.greatest),
                ]
            )
    heads = (
        "measure", "condition", "n", "invalid", "median", "quartiles", "mean", "SD", "CV [%]",
        "least", "greatest",
    )  # fmt: skip
    caption = (
        "One value of each valid run. SD: sample standard deviation over the runs; CV: coefficient"
        f" of variation, SD over the mean's size; {DASH}: of one run, or of a mean of 0, there is"
        " none."
    )
    return counter.table("Spread of the runs", caption, heads, rows, texts=(0, 1))


def _comparisons(result: StudyResult, counter: Counter, tests: bool) -> Iterator[str]:
    yield "<h3>Comparisons</h3>\n"
    several = any(len(outcome.pairs) > 1 for outcome in result.measures)
    rows = [row for outcome in result.measures for row in _rows(outcome, several, tests)]
    if rows:
        yield counter.table(*_table(several, tests), rows, texts=(0, 1))
    for outcome in result.measures:
        said = "".join(f"<li>{escape(text)}</li>\n" for text in words.sentences(result, outcome))
        yield f"<h4>{escape(spoken(outcome.measure).capitalize())}</h4>\n"
        yield f'<ul class="said">{said}</ul>\n'


def _table(several: bool, tests: bool) -> tuple[str, str, list[str]]:
    tested = ["n", "statistic", "p", *(["p, Holm"] if several else [])] if tests else ["n"]
    caption = (
        "A12: how often a run of the first condition gives more than one of the second, ties"
        " counted half; shift: by how much, Hodges-Lehmann; both with bootstrapped 95 % intervals."
    )
    if tests:
        caption += " p is two-sided."
    if several and tests:
        caption += " Holm: adjusted over the pairs of a measure."
    return "Pairs of conditions", caption, ["measure", "pair", *tested, "A12", "shift"]


def _rows(outcome: MeasureResult, several: bool, tests: bool) -> Iterable[list[str]]:
    for pair in outcome.pairs:
        test, effect = pair.test, pair.effect
        cells = [n_of(pair.n, outcome.paired)]
        if tests and test is not None:
            cells += [statistic(test), p_of(test.p), *([p_of(pair.adjusted)] if several else [])]
        if effect is None:
            cells += [DASH, DASH]
        else:
            cells.append(interval(effect.a12, effect.a12_low, effect.a12_high, False))
            cells.append(interval(effect.shift, effect.shift_low, effect.shift_high, True))
        yield [spoken(outcome.measure), f"{pair.first} – {pair.second}", *cells]


def _voids(result: StudyResult, counter: Counter) -> str:
    rows = [
        [run.run, arm.label, run.series or DASH, run.why or "no reason is given"]
        for arm in result.study.arms
        for run in arm.voids
    ]
    if not rows:
        return "<p>No run is invalid.</p>\n"
    caption = "They count nowhere."
    if len(rows) > MOST_VOID_RUNS:
        caption += f" The first {MOST_VOID_RUNS} of {len(rows)}."
    heads = ("run", "condition", "series", "why")
    return counter.table("Invalid runs", caption, heads, rows[:MOST_VOID_RUNS], texts=(0, 1, 2, 3))


def methods(results: Sequence[StudyResult], asked: Questions) -> str:
    """The paragraph for a paper; a click chooses all of it."""
    return (
        '<h2 id="methods">For the methods of a paper</h2>\n'
        f'<p class="methods">{escape(words.methods(results, asked))}</p>\n'
    )
