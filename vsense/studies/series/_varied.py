"""What is varied in a search: the values that a setting may have, and Optuna's part in it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import TYPE_CHECKING, Any

from vsense.base.errors import UsageError
from vsense.modes.sim.job import values_of

if TYPE_CHECKING:
    from optuna import Study
    from optuna.distributions import BaseDistribution

    from vsense.studies.series._trials import Objective

_RANGE = re.compile(r"\s*([^.\s]\S*?|\.\d\S*?)\.\.([^:\s]+?)(?::(\S+))?\s*")
_DIGITS = 6
"""Of a value that is not whole."""
_TRIES = 50
"""So often is asked for one that nobody has tried."""
_DRAWN = 10
"""So many trials are drawn at random before the sampler learns."""


@dataclass(frozen=True, slots=True)
class Varied:
    """A setting, and the values that it may have.

    Attributes:
        key: `ELEMENT.attribute`.
        choices: all of them; (): those between `low` and `high`.
        step: between two values; None: any.
        whole: they are whole numbers.
        log: it is searched by its logarithm.
    """

    key: str
    choices: tuple[str, ...] = ()
    low: float = 0.0
    high: float = 0.0
    step: float | None = None
    whole: bool = False
    log: bool = False

    @classmethod
    def of(cls, key: str, values: str | Sequence[str | float]) -> Varied:
        """Reads `0..1`, `0..1:0.1`, `0.001..1:log`, `a,b,c`, or a list; UsageError: it is none."""
        if not isinstance(values, (str, Sequence)):
            raise UsageError(f"vary {key}={values!r}: expected '0..1', or a list of several values")
        text = values if isinstance(values, str) else ";".join(map(str, [*values, ""]))
        found = _RANGE.fullmatch(text)
        if found is None:
            choices = values_of(f"--vary {key}", text)
            if len(choices) < 2:
                raise UsageError(f"--vary {key}={text}: expected LOW..HIGH, or several values")
            return cls(key, choices)
        low, high, how = found.groups()
        try:
            step = None if how in (None, "log") else float(how)
            varied = cls(key, (), float(low), float(high), step, log=how == "log")
            span = varied.high - varied.low
            if not 0.0 < (span if step is None else step) <= span < float("inf"):
                raise ValueError
        except ValueError:
            words = "expected LOW..HIGH, LOW..HIGH:STEP or LOW..HIGH:log, LOW below HIGH by STEP"
            raise UsageError(f"--vary {key}={text}: {words}") from None
        if varied.log and varied.low <= 0.0:
            raise UsageError(f"--vary {key}={text}: with :log both ends are above 0")
        ends = (varied.low, varied.high, step)
        return replace(varied, whole=step is not None and all(n == int(n) for n in ends if n))

    @property
    def may_be_whole(self) -> bool:
        """Whether its ends are whole, and nothing says what lies between."""
        bounds = not self.choices and self.step is None
        return bounds and self.low.is_integer() and self.high.is_integer()

    @property
    def ends(self) -> tuple[str, str]:
        """The least and the greatest value; the first and the last choice."""
        if self.choices:
            return self.choices[0], self.choices[-1]
        return self.text(self.low), self.text(self.high)

    def text(self, value: Any) -> str:
        """A value as a setting has it."""
        return str(value) if self.choices or self.whole else f"{float(value):.{_DIGITS}g}"

    def value(self, text: str) -> Any:
        """What `text` made a setting of; None: it may not be."""
        if self.choices:
            return text if text in self.choices else None
        try:
            number = int(text) if self.whole else float(text)
        except ValueError:
            return None
        return number if self.low <= number <= self.high else None

    def distribution(self) -> BaseDistribution:
        """The same for Optuna."""
        from optuna import distributions

        if self.choices:
            return distributions.CategoricalDistribution(self.choices)
        if self.whole:
            low, high, step = int(self.low), int(self.high), int(self.step or 1)
            return distributions.IntDistribution(low, high, self.log, step)
        return distributions.FloatDistribution(self.low, self.high, self.log, self.step)


@dataclass(frozen=True, slots=True)
class Trial:
    """Settings that were tried.

    Attributes:
        settings: what is varied, by `ELEMENT.attribute`.
        values: the mean of its runs for each objective.
        runs: so many.
    """

    settings: Mapping[str, str]
    values: Sequence[float]
    runs: int


def proposals(
    varied: Sequence[Varied],
    objectives: Sequence[Objective],
    trials: Sequence[Trial],
    count: int,
    seed: int,
) -> list[dict[str, str]]:
    """Settings to try next, which no trial has; fewer than `count` where there are no others.

    The same trials, of the same version of Optuna, give the same: nothing else is remembered.
    """
    space = {one.key: one.distribution() for one in varied}
    study = _study(objectives, seed + len(trials))
    for trial in trials:
        study.add_trial(_finished(varied, space, trial))
    tried = {tuple(trial.settings.items()) for trial in trials}
    new: list[dict[str, str]] = []
    for settings in islice(_asked(study, varied, space), _TRIES * count):
        if tuple(settings.items()) not in tried:
            tried.add(tuple(settings.items()))
            new.append(settings)
        if len(new) == count:
            break
    return new


def _asked(
    study: Study, varied: Sequence[Varied], space: Mapping[str, BaseDistribution]
) -> Iterator[dict[str, str]]:
    while True:
        asked = study.ask(dict(space)).params
        yield {one.key: one.text(asked[one.key]) for one in varied}


def _study(objectives: Sequence[Objective], seed: int) -> Study:
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    sampler = optuna.samplers.TPESampler(n_startup_trials=_DRAWN, seed=seed, constant_liar=True)
    sides = optuna.study.StudyDirection
    directions = [sides.MAXIMIZE if one.more else sides.MINIMIZE for one in objectives]
    return optuna.create_study(sampler=sampler, directions=directions)


def _finished(varied: Sequence[Varied], space: Mapping[str, BaseDistribution], trial: Trial) -> Any:
    from optuna.trial import create_trial

    params = {one.key: one.value(trial.settings[one.key]) for one in varied}
    return create_trial(params=params, distributions=dict(space), values=[*trial.values])
