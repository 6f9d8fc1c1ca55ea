"""A new controller against an old one: paired simulated runs until a verdict is clear.

Both sides run with the same seeds. After some pairs is looked (`_sequential.py`), and as soon as
the interval of the difference says that the new side is better, worse, or not worse by more than a
margin, no other run is made.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vsense.base.arena import Floats
from vsense.base.errors import UsageError
from vsense.base.terminal import Console, spoken
from vsense.studies.notebook import checked, console_of, interruptible
from vsense.studies.report import _plot
from vsense.studies.series import _sequential, _sides
from vsense.studies.series._parts import PlannedExperiment
from vsense.studies.series._sequential import BETTER, NOT_CLEAR, NOT_WORSE, WORSE, Shift
from vsense.studies.series._sides import NEW, OLD
from vsense.studies.series._trials import GrowingRuns, Objective, TrialOptions

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAIRS = FEWEST_PAIRS, MOST_PAIRS = _sequential.LOOKS[0], _sequential.LOOKS[-1]
_HEIGHT_IN = 2.4
_EXIT_CODES = {BETTER: 0, NOT_WORSE: 0, WORSE: 1, NOT_CLEAR: 3}


@dataclass(frozen=True, slots=True)
class Margin:
    """So much worse is accepted: a share of the old mean, or a number in the measure's unit."""

    value: float = 0.1
    relative: bool = True

    @classmethod
    def of(cls, text: str) -> Margin:
        """Reads `10%`, or a number; UsageError: it is none."""
        number = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*(%?)\s*", text)
        if number is None or (number[2] and float(number[1]) >= 100.0):
            words = "expected a share of the old mean such as 10%, or a number"
            raise UsageError(f"margin {text!r}: {words}")
        return cls(float(number[1]) / (100.0 if number[2] else 1.0), bool(number[2]))

    def __str__(self) -> str:
        return f"{100 * self.value:g} %" if self.relative else f"{self.value:g}"


@dataclass(frozen=True)
class Comparison:
    """What the runs of two sides say.

    Attributes:
        verdict: "better", "not worse" (by more than the margin), "worse" or "not clear".
        objective: what they are judged by.
        margin: so much worse is accepted.
        old, new: (pairs,) the measure in the runs of each side; runs at one place are a pair.
        looks: the number of pairs and the shift at each look; the last one decides.
        table: the runs.
        picture: of the looks and runs; None: Matplotlib is not there.
    """

    verdict: str
    objective: Objective
    margin: Margin
    old: Floats
    new: Floats
    looks: Sequence[tuple[int, Shift]]
    table: Path
    picture: Path | None = None

    @property
    def passed(self) -> bool:
        """Whether it is better, or not worse by more than the margin."""
        return self.exit_code == 0

    @property
    def exit_code(self) -> int:
        """That of `vsense compare`."""
        return _EXIT_CODES[self.verdict]

    @property
    def pairs(self) -> int:
        """So many were needed."""
        return len(self.old)

    @property
    def effect(self) -> float:
        """New mean minus old mean; where the margin is a share, as a share of the old mean."""
        return self.looks[-1][1].value

    @property
    def interval(self) -> tuple[float, float]:
        """The effect's 95 % interval; infinite where nothing is known."""
        shift = self.looks[-1][1]
        return shift.low, shift.high

    @property
    def fewest_to_pass(self) -> int:
        """After fewer pairs nothing is better or not worse, unless both sides are the same."""
        return _sequential.fewest_to_pass(self.margin.value, self.margin.relative)

    @property
    def words(self) -> str:
        """The verdict with what it means."""
        return self.verdict + f" by more than {self.margin}" * (self.verdict == NOT_WORSE)

    def facts(self) -> dict[str, Any]:
        """All of it but the runs, for programs."""
        looks = [{"pairs": pairs, **_facts_of(shift)} for pairs, shift in self.looks]
        return {
            "verdict": self.verdict,
            "passed": self.passed,
            "measure": self.objective.measure,
            "better": "more" if self.objective.more else "less",
            "margin": self.margin.value,
            "relative": self.margin.relative,
            "old_mean": float(self.old.mean()),
            "new_mean": float(self.new.mean()),
            **looks[-1],
            "looks": looks,
            "table": str(self.table),
            "picture": None if self.picture is None else str(self.picture),
        }

    def __str__(self) -> str:
        """The verdict in a sentence."""
        means = f"{self.new.mean():.4g} instead of {self.old.mean():.4g}"
        text = f"{self.words}: {spoken(self.objective.measure)} {means}"
        text += f", {shift_words(self.looks[-1][1])}, in {self.pairs} pairs of runs"
        if self.verdict in (WORSE, NOT_CLEAR):
            text += f"; accepted: {self.margin} {'less' if self.objective.more else 'more'}"
        if self.verdict == NOT_CLEAR and self.pairs < self.fewest_to_pass:
            text += (
                f"; nothing passes before {self.fewest_to_pass} pairs: what is seldom needs time"
            )
        return text


def shift_words(shift: Shift) -> str:
    """A shift with its interval, for people."""
    if shift.value == 0.0 and shift.low in (0.0, -math.inf):
        return "the same in every pair" + (" so far" if not shift.known else "")
    scale, unit = (100.0, " %") if shift.relative else (1.0, "")
    value, low, high = (f"{scale * n:+.3g}{unit}" for n in (shift.value, shift.low, shift.high))
    return f"{value} (95 %: {f'{low} to {high}' if shift.known else 'not known'})"


def _facts_of(shift: Shift) -> dict[str, float | None]:
    names = {"effect": shift.value, "low": shift.low, "high": shift.high}
    return {name: n if math.isfinite(n) else None for name, n in names.items()}


def compare(
    old: str | Path,
    new: str | Path,
    *,
    maximize: str | None = None,
    minimize: str | None = None,
    margin: str | float = "10%",
    pairs: int = MOST_PAIRS,
    progress: bool = False,
    **how: Any,
) -> Comparison:
    """Simulates pairs of runs until it is clear whether the new side is as good as the old one.

    Args:
        old, new: experiments or controllers' files, also of a revision of Git: `main:`.
        maximize, minimize: the measure; one of the two.
        margin: so much worse is accepted: a share of the old mean, or a number in its unit.
        pairs: at most so many.
        progress: says on standard error how it goes.
        how: runs are made, see `TrialOptions`: settings, robots, duration_s, seed, output, ...

    Raises:
        KeyboardInterrupt: Ctrl-C; the same call goes on from there.
        VsenseError: there is no such side or measure, or a run has failed.
    """
    if (maximize is None) == (minimize is None):
        raise UsageError("expected one of maximize and minimize: the measure's name")
    objective = Objective(maximize or minimize or "", maximize is not None)
    asked = _Looks(objective, Margin.of(str(margin)), checked("pairs", pairs, int, *PAIRS))
    options, console = TrialOptions.of(how), console_of(progress)
    options.seeds(pairs)
    sides = _sides.conditions(str(old), str(new), options.settings)
    with interruptible() as interrupted, sides as conditions:
        both = {side.name: options.planned(side) for side in conditions}
        digests = [options.digest(planned) for planned in both.values()]
        alike = 0 if len(set(digests)) == 1 else _sequential.FEWEST_ALIKE  # 0: nothing differs
        stem = f"compare-{both[NEW].experiment.name}"
        with GrowingRuns(options, stem, digests, console, interrupted) as making:
            answer = asked.take(making, both, console, alike)
    return replace(answer, picture=making.draw(partial(_draw, answer)))


def _check_alike(both: Mapping[str, PlannedExperiment]) -> None:
    """UsageError: runs of one side are longer, or have more robots."""
    old, new = (both[side].experiment for side in (OLD, NEW))
    for what, sizes, option in (
        ("s a run", (old.length_s, new.length_s), "--duration"),
        ("robots", (len(old.robots), len(new.robots)), "--robots"),
    ):
        if sizes[0] != sizes[1]:
            words = f"old has {sizes[0]:g} {what}, new {sizes[1]:g}"
            raise UsageError(f"{words}: no measure tells them apart; {option} makes them alike")


@dataclass(frozen=True)
class _Looks:
    """What runs are judged by, and at most so many pairs of them."""

    objective: Objective
    margin: Margin
    pairs: int

    def take(
        self,
        making: GrowingRuns,
        both: Mapping[str, PlannedExperiment],
        console: Console,
        alike: int,
    ) -> Comparison:
        """Makes pairs, and looks at them again and again; raises as `GrowingRuns.complete`."""
        _check_alike(both)
        looks: list[tuple[int, Shift]] = []
        measure, margin = spoken(self.objective.measure), self.margin
        fewest = _sequential.fewest_to_pass(margin.value, margin.relative) if alike else 0
        for pairs in (1, *_sequential.looks(self.pairs)):  # after one a wrong measure is known
            seeds = making.how.seeds(pairs)
            making.complete(both, seeds, f"to {pairs} of {self.pairs} pairs")
            old, new = (
                np.array([self.objective.of(row) for row in making.rows(side, seeds)])
                for side in (OLD, NEW)
            )
            if pairs > 1:
                self._check_margin(old)
                shift = _sequential.shift_of(old, new, margin.relative, alike)
                looks.append((pairs, shift))
                console.say(f"{pairs:4} pairs: {measure} {shift_words(shift)}")
                verdict = _sequential.verdict_of(shift, margin.value, self.objective.more)
                if verdict in (BETTER, NOT_WORSE) and pairs < fewest:
                    verdict = NOT_CLEAR
                if verdict != NOT_CLEAR:
                    self._check_measured(old, new)
                    break
        return Comparison(verdict, self.objective, margin, old, new, looks, making.path)

    def _check_measured(self, old: Floats, new: Floats) -> None:
        if self.objective.more and not (old.any() or new.any()):
            words = f"{spoken(self.objective.measure)}: 0 in every run of both sides"
            raise UsageError(f"{words}: nothing can be told by it; are the runs too short?")

    def _check_margin(self, old: Floats) -> None:
        mean, margin = float(old.mean()), self.margin
        if self.objective.more and not margin.relative and 0.0 < mean <= margin.value:
            words = (
                f"margin {margin}: the old mean is {mean:.4g}, so that who does nothing would pass"
            )
            raise UsageError(f"{words}; is '{margin}%' meant?")


def _draw(answer: Comparison) -> Figure:
    """The interval at each look, and the runs of both sides."""
    figure = _plot.new_figure(_plot.width_of(wide=True), _HEIGHT_IN)
    at_looks, runs = figure.subplots(1, 2, width_ratios=(3, 2))
    title = f"{answer.words}, after {answer.pairs} pairs of runs"
    figure.suptitle(_plot.label(title[0].upper() + title[1:]))
    _draw_looks(at_looks, answer)
    groups = [answer.old.tolist(), answer.new.tolist()]
    _plot.draw_runs(runs, answer.objective.measure, groups, ("C0", "C1"))
    runs.set_yticks((0, 1), (OLD, NEW))
    return figure


def _draw_looks(axes: Axes, answer: Comparison) -> None:
    relative = answer.margin.relative
    scale = 100.0 if relative else 1.0
    known = [(pairs, shift) for pairs, shift in answer.looks if shift.known]
    pairs = [pairs for pairs, _ in known]
    bounds = np.array([(s.low, s.value, s.high) for _, s in known]).reshape(-1, 3)
    low, value, high = scale * bounds.T
    accepted = scale * answer.margin.value * (-1.0 if answer.objective.more else 1.0)
    axes.axhline(0.0, color=_plot.setting("text.color"), linewidth=0.6)
    axes.axhline(accepted, color="C1", linewidth=0.8, linestyle="--", label="margin")
    bars = (value - low, high - value)
    axes.errorbar(pairs, value, bars, fmt="o", color="C0", markersize=3.5, label="95 %")
    if not pairs:
        words = "too few pairs differ:\nno bounds are known"
        axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="bottom")
    axes.set_xscale("log", base=2)
    axes.margins(x=0.06)
    axes.set_xticks(pairs, list(map(str, pairs)))
    axes.minorticks_off()
    unit = " [% of the old mean]" if relative else ""
    what = _plot.measure_label(answer.objective.measure)
    axes.set(xlabel="pairs of runs", ylabel=f"{what}:\nnew - old{unit}")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
