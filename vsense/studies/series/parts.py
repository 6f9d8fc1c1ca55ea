"""The experiments of a plan's conditions, loaded and checked before the first run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from vsense.base.errors import ConfigError, UsageError
from vsense.config.casting import Casting
from vsense.config.experiment import first_robots, load
from vsense.config.specs import Experiment, Stage
from vsense.modes.sim.job import Setup
from vsense.robots.sources import CodeOptions
from vsense.run import asked
from vsense.studies.series.plan import Condition, PlannedStart, SeriesPlan

STAGES = {"sim": Stage.SIM, "lab": Stage.LAB, "run": Stage.RUN}


@dataclass(frozen=True, slots=True)
class PlannedExperiment:
    """What a condition runs, with what it was made from; nothing in it is placed yet.

    Attributes:
        settings: of the condition, its controller among them.
    """

    condition: Condition
    experiment: Experiment
    settings: Mapping[str, str]

    @property
    def files(self) -> set[Path]:
        """The experiment's file, and those of its controllers and loop functions."""
        experiment, loop = self.experiment, self.experiment.loop_functions
        sources = {path for spec in experiment.controllers for path in spec.sources}
        return {experiment.path, *sources, *(() if loop is None else (loop.path,))}


@dataclass(frozen=True, slots=True)
class PlanLoader:
    """Loads what conditions run.

    Attributes:
        code: where controllers' sources are.
        casting: which robots play.
        virtual_devices: as `load` has it.
        finish: completes what was loaded, as with a tracker.
        lenient: a controller may ask for what nobody offers, or be told what it does not read.
    """

    plan: SeriesPlan
    code: CodeOptions = field(default_factory=CodeOptions)
    casting: Casting = field(default_factory=Casting)
    virtual_devices: bool = False
    lenient: bool = False
    finish: Callable[[Experiment], Experiment] = lambda experiment: experiment

    def load_all(self) -> dict[str, PlannedExperiment]:
        """Loads and checks all conditions; every start has to fit every one of them.

        Raises:
            VsenseError: one cannot be loaded, or asks for what nobody offers; the message says of
                which line of the plan that is.
        """
        found = {}
        for condition in self.plan.conditions:
            try:
                found[condition.name] = self.load(condition)
            except (ConfigError, UsageError) as error:
                line, path = condition.line, str(self.plan.path)
                raise ConfigError(path, line, f"{condition.name}: {error}") from None
        for start in self.plan.starts:
            for name, planned in found.items():
                try:
                    start.places.settled(planned.experiment)
                except (ConfigError, UsageError) as error:
                    words = f"start {start.name}, {name}: {error}"
                    raise ConfigError(str(self.plan.path), start.line, words) from None
        return found

    def load(self, condition: Condition, casting: Casting | None = None) -> PlannedExperiment:
        """Loads what a condition runs, played by its `casting` or another one."""
        settings = dict(condition.settings)
        experiment = self._load(condition, settings, casting)
        if condition.controller:
            labels = {experiment.controller_of(robot).label for robot in experiment.robots}
            if len(labels) > 1 or len(experiment.controllers) > 1:
                names = ", ".join(sorted(labels))
                raise UsageError(
                    f"controller: {experiment.file} has several ({names}): name one with"
                    ' settings, such as "ELEMENT.library" = "FILE"'
                )
            path = Path(condition.controller)
            file = str(path.absolute()) if path.is_file() else condition.controller
            settings[f"{labels.pop()}.library"] = file  # last: it renames what others may set
            experiment = self._load(condition, settings, casting)
        if not experiment.timesteps:
            raise UsageError(f"{experiment.file}: has no length: add duration_s to the plan")
        if not self.lenient:
            asked.check(experiment)
        return PlannedExperiment(condition, self.finish(experiment), settings)

    def setup(self, planned: PlannedExperiment, start: PlannedStart) -> Setup:
        """What a simulated run of it is made from."""
        plan, condition = self.plan, planned.condition
        how = plan.duration_s, plan.count, condition.blind, planned.settings
        return Setup(condition.experiment, *how, self.code, self.casting, start.places)

    def _load(
        self, condition: Condition, settings: Mapping[str, str], casting: Casting | None
    ) -> Experiment:
        plan, stage = self.plan, STAGES[self.plan.mode]
        how = plan.duration_s, settings, stage, self.virtual_devices, self.code
        experiment = load(condition.experiment, *how, casting or self.casting)
        there = len(experiment.robots)
        if (plan.count or 0) > there:
            raise UsageError(f"count = {plan.count}: {experiment.file} has {there} robots")
        return first_robots(experiment, plan.count)
