"""Searches for the settings of an experiment that are best by its measures, with Optuna.

A trial is a condition of a campaign: its runs have the same seeds as those of every other trial, so
that trials differ by their settings alone. Nothing is kept but the table of runs: what Optuna knows
is made of it again before it is asked for the next trials.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vsense.base.errors import ConfigError, UsageError, require
from vsense.base.terminal import Console, aligned, spoken
from vsense.modes.options import say_warnings
from vsense.run.runs_csv import condition_of
from vsense.studies.notebook import checked, console_of, interruptible
from vsense.studies.report import _plot
from vsense.studies.series._parts import PlannedExperiment
from vsense.studies.series._plan import Condition
from vsense.studies.series._trials import GrowingRuns, Objective, TrialOptions
from vsense.studies.series._varied import Trial, Varied, proposals

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from vsense.base.arena import Floats

RUNS, TRIALS, BATCH = 5, 50, 4
_HEIGHT_IN = 2.4
_MOST_VARIED = 5
"""Settings that have a panel."""
_DOTS: Mapping[str, Any] = {"markersize": 3.5, "markeredgewidth": 0.0, "alpha": 0.85}


@dataclass(frozen=True, slots=True)
class _Asked:
    """What is searched for.

    Attributes:
        experiment: a shipped one's name, or the path of a file.
        varied: the settings, and the values that they may have.
        objectives: one, or several at once.
        runs: of each trial.
        trials: at most so many.
        batch: so many trials are asked for at a time.
        how: runs are made; its settings are those of all trials.
    """

    experiment: str
    varied: Sequence[Varied]
    objectives: Sequence[Objective]
    runs: int
    trials: int
    batch: int
    how: TrialOptions

    def check(self) -> None:
        """Raises UsageError where something is missing, or said twice."""
        if not self.varied or not self.objectives:
            raise UsageError("expected a setting to vary, and a measure to maximize or minimize")
        keys = [*self.how.settings, *(one.key for one in self.varied)]
        measures = [objective.measure for objective in self.objectives]
        for what, names in (("setting", keys), ("measure", measures)):
            if twice := [name for name in names if names.count(name) > 1]:
                raise UsageError(f"{what} {twice[0]}: given twice")

    def condition(self, settings: Mapping[str, str]) -> Condition:
        """The condition of a trial."""
        together = {**self.how.settings, **settings}
        return Condition(condition_of(False, together), self.experiment, settings=together)

    def settings_of(self, condition: str) -> dict[str, str] | None:
        """What is varied in a condition; None: it is not one of this search."""
        given = [re.escape(f"{key}={text}") for key, text in self.how.settings.items()]
        sought = [re.escape(f"{one.key}=") + "(.*)" for one in self.varied]
        found = re.fullmatch(", ".join([*given, *sought]), condition)
        if found is None:
            return None
        settings = dict(zip((one.key for one in self.varied), found.groups()))
        return settings if all(v.value(settings[v.key]) is not None for v in self.varied) else None


@dataclass(frozen=True)
class Optimum:
    """What a search has found.

    Attributes:
        trials: all of them, in their order.
        objectives: what they are judged by.
        varied: what they differ in.
        table: the runs.
        picture: of the search; None: Matplotlib is not there.
    """

    trials: Sequence[Trial]
    objectives: Sequence[Objective]
    varied: Sequence[Varied]
    table: Path
    picture: Path | None = None

    @property
    def front(self) -> list[Trial]:
        """The trials that no other one beats: of one objective the best, of several the Pareto
        front, the best in the first objective first."""
        gains = np.array([self.gains(trial) for trial in self.trials])
        beaten = [
            bool(((gains >= gain).all(axis=1) & (gains > gain).any(axis=1)).any()) for gain in gains
        ]
        best = [trial for trial, is_beaten in zip(self.trials, beaten) if not is_beaten]
        best = best if len(self.objectives) > 1 else best[:1]
        return sorted(best, key=self.gains, reverse=True)

    @property
    def best(self) -> Trial:
        """The best trial; of several objectives, in the first one."""
        return self.front[0]

    def gains(self, trial: Trial) -> tuple[float, ...]:
        """Its values, turned so that more is better."""
        signs = (1.0 if objective.more else -1.0 for objective in self.objectives)
        return tuple(sign * value for sign, value in zip(signs, trial.values))

    def facts(self) -> dict[str, Any]:
        """All of it, for programs."""
        names = [objective.measure for objective in self.objectives]
        words = {True: "maximize", False: "minimize"}

        def facts_of(trial: Trial) -> dict[str, Any]:
            means = dict(zip(names, trial.values))
            return {"settings": dict(trial.settings), "means": means, "runs": trial.runs}

        return {
            "objectives": {o.measure: words[o.more] for o in self.objectives},
            "best": [facts_of(trial) for trial in self.front],
            "trials": [facts_of(trial) for trial in self.trials],
            "table": str(self.table),
            "picture": None if self.picture is None else str(self.picture),
        }

    def lines(self) -> list[str]:
        """The best trials as a table, for people."""
        names = [one.key for one in self.varied]
        heads = [*names, *(spoken(objective.measure) for objective in self.objectives), "runs"]
        rows = [
            [*(t.settings[n] for n in names), *(f"{v:.4g}" for v in t.values), str(t.runs)]
            for t in self.front
        ]
        return aligned([heads, *rows], left=0)


def optimize(
    experiment: str | Path,
    vary: Mapping[str, str | Sequence[str | float]],
    *,
    maximize: str | Sequence[str] = (),
    minimize: str | Sequence[str] = (),
    runs: int = RUNS,
    trials: int = TRIALS,
    batch: int = BATCH,
    progress: bool = False,
    **how: Any,
) -> Optimum:
    """Searches for the settings that are best by measures, with Optuna (extra `optimize`).

    Args:
        vary: by `ELEMENT.attribute` text as `--vary` has it, such as "0..1", or a list of choices.
        maximize, minimize: a measure, or several at once.
        runs: of every trial, with the same seeds in each.
        trials: with those that are in the table.
        batch: so many are chosen at a time.
        progress: says on standard error how it goes.
        how: runs are made, see `TrialOptions`: settings, robots, duration_s, seed, output, ...

    Raises:
        KeyboardInterrupt: Ctrl-C; the same call goes on from there.
        VsenseError: there is no such setting or measure, or a run has failed.
    """
    require("a search needs", "optuna")
    goals = [Objective(name, True) for name in _names(maximize)]
    goals += [Objective(name, False) for name in _names(minimize)]
    varied = [Varied.of(key, values) for key, values in vary.items()]
    counts = {"runs": runs, "trials": trials, "batch": batch}
    whole = {name: checked(name, count, int, 1) for name, count in counts.items()}
    asked = _Asked(str(experiment), varied, goals, **whole, how=TrialOptions.of(how))
    asked.check()
    return _search(asked, console_of(progress))


def _names(given: str | Sequence[str]) -> list[str]:
    return [given] if isinstance(given, str) else list(given)


def _search(asked: _Asked, console: Console) -> Optimum:
    """Makes trial after trial; raises as `optimize`."""
    asked, first = _settled(asked)
    say_warnings(first.experiment, console)
    name, digests = f"optimize-{first.experiment.name}", [asked.how.digest(first)]
    with (
        interruptible() as interrupted,
        GrowingRuns(asked.how, name, digests, console, interrupted) as making,
    ):
        trials = _Search(asked, making, console).run()
    found = Optimum(trials, asked.objectives, asked.varied, making.path)
    return replace(found, picture=making.draw(partial(_draw, found)))


def _settled(asked: _Asked) -> tuple[_Asked, PlannedExperiment]:
    """What is asked, in which what takes whole numbers only has no others; and what is run at the
    low ends of all ranges. Raises as `TrialOptions.planned`, also of the high ends."""

    def planned(ends: Sequence[str]) -> PlannedExperiment:
        keys = (one.key for one in asked.varied)
        return asked.how.planned(asked.condition(dict(zip(keys, ends))))

    lows, highs = zip(*(one.ends for one in asked.varied))
    first, _ = planned(lows), planned(highs)
    varied = list(asked.varied)
    for place, one in enumerate(varied):
        if one.may_be_whole:
            between = f"{one.low + 0.5:g}"
            try:
                planned([*lows[:place], between, *lows[place + 1 :]])
            except (ConfigError, UsageError):
                varied[place] = replace(one, whole=True)
    return replace(asked, varied=varied), first


class _Search:
    """The trials of a search."""

    def __init__(self, asked: _Asked, making: GrowingRuns, console: Console) -> None:
        self._asked, self._making, self._console = asked, making, console
        self._seeds = asked.how.seeds(asked.runs)
        self._said: Sequence[Trial] = ()

    def run(self) -> list[Trial]:
        """Completes what was begun, then tries more; raises as `optimize`."""
        asked, begun = self._asked, self._begun()
        trials: list[Trial] = []
        while True:
            # What was interrupted in the middle is asked for again, with the others of its batch.
            batch = begun[len(trials) :][: asked.batch]
            count = min(asked.batch, asked.trials - len(trials))
            if count > len(batch):
                drawn = proposals(asked.varied, asked.objectives, trials, count, asked.how.seed)
                batch += [settings for settings in drawn if settings not in batch]
            batch = batch[: max(count, len(batch) if len(trials) < len(begun) else 0)]
            if not batch:
                return trials
            trials += self._complete(batch, len(trials) + len(batch))
            self._say(trials)

    def _begun(self) -> list[dict[str, str]]:
        """What the table has, in its order."""
        names = dict.fromkeys(row.condition for row in self._making.table.rows if row.valid)
        return [s for s in map(self._asked.settings_of, names) if s is not None]

    def _complete(self, batch: Sequence[dict[str, str]], number: int) -> list[Trial]:
        """Makes the runs of some trials that are missing; with them there are `number` trials."""
        asked, making, seeds = self._asked, self._making, self._seeds
        lacking = {}
        for condition in map(asked.condition, batch):
            if len(making.rows(condition.name, seeds)) < len(seeds):
                lacking[condition.name] = asked.how.planned(condition)
        goal = f"to {number} of {asked.trials} trials"
        if lacking and number <= len(batch):  # after one run a wrong measure is known
            name, planned = next(iter(lacking.items()))
            making.complete({name: planned}, seeds[:1], goal)
            self._trial(batch[0], seeds[:1])
        if lacking:
            making.complete(lacking, seeds, goal)
        return [self._trial(settings, seeds) for settings in batch]

    def _trial(self, settings: dict[str, str], seeds: Sequence[int]) -> Trial:
        rows = self._making.rows(self._asked.condition(settings).name, seeds)
        means = [float(np.mean([o.of(row) for row in rows])) for o in self._asked.objectives]
        return Trial(settings, means, len(rows))

    def _say(self, trials: Sequence[Trial]) -> None:
        """Says what the best ones are, where they are others than before."""
        asked = self._asked
        front = Optimum(trials, asked.objectives, asked.varied, Path()).front
        if front != self._said:
            self._said, best = front, front[0]
            words = [f"{spoken(o.measure)} {v:.4g}" for o, v in zip(asked.objectives, best.values)]
            words += [f"{key}={text}" for key, text in best.settings.items()]
            of = f" ({len(front)} are not beaten)" if len(asked.objectives) > 1 else ""
            self._console.say(f"{len(trials):4} trials: {', '.join(words)}{of}")


def _draw(found: Optimum) -> Figure:
    """A row for each objective: its trials in their order, and by the value of each setting.

    In place of their order the second and further ones show the values against the first one's.
    """
    columns = 1 + min(len(found.varied), _MOST_VARIED)
    rows = len(found.objectives)
    figure = _plot.new_figure(_plot.width_of(wide=True), _HEIGHT_IN * rows)
    panels = figure.subplots(rows, columns, squeeze=False, sharey="row")
    figure.suptitle(_plot.label(f"{len(found.trials)} trials of {found.trials[0].runs} runs each"))
    values = np.array([trial.values for trial in found.trials]).T
    best = [found.trials.index(trial) for trial in found.front]
    for row, (objective, heights) in enumerate(zip(found.objectives, values)):
        panels[row, 0].set_ylabel(f"{_plot.measure_label(objective.measure)}, mean")
        if row == 0:
            _draw_history(panels[row, 0], heights, objective.more)
        else:
            _draw_dots(panels[row, 0], values[0], heights, best)
            panels[row, 0].set_xlabel(f"{_plot.measure_label(found.objectives[0].measure)}, mean")
        for axes, one in zip(panels[row, 1:], found.varied):
            texts = [trial.settings[one.key] for trial in found.trials]
            places = [float(one.choices.index(t) if one.choices else t) for t in texts]
            _draw_dots(axes, np.array(places), heights, best)
            axes.set_xlabel(_plot.label(one.key))
            if one.choices:
                axes.set_xticks(range(len(one.choices)), list(map(_plot.label, one.choices)))
            elif one.log and one.high >= 10.0 * one.low:  # one tick at least
                axes.set_xscale("log")
                axes.xaxis.set_major_formatter("{x:g}")
                axes.xaxis.set_minor_formatter("")
            elif one.whole:
                axes.locator_params("x", integer=True)
    return figure


def _draw_dots(axes: Axes, places: Floats, heights: Floats, best: Sequence[int]) -> None:
    """All trials, and the best of them in another colour."""
    axes.plot(places, heights, "o", color="C0", **_DOTS)
    axes.plot(places[best], heights[best], "o", color="C1", **{**_DOTS, "alpha": 1.0})
    axes.margins(x=0.06)


def _draw_history(axes: Axes, values: Floats, more: bool) -> None:
    """The trials in their order, and the best until then."""
    numbers = np.arange(1, len(values) + 1)
    best = np.maximum.accumulate(values) if more else np.minimum.accumulate(values)
    axes.plot(numbers, values, "o", color="C0", **_DOTS)
    axes.step(numbers, best, color="C1", where="post")
    axes.margins(x=0.06)
    axes.set_xlabel("trial (line: the best so far)")
    axes.locator_params("x", integer=True)
