"""The experiments of a plan's conditions, loaded and checked before the first run.

Spares of the roster are put in for robots that cannot go on.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from vsense.base.errors import ConfigError, UsageError
from vsense.base.terminal import Console
from vsense.config.casting import Casting, Pair
from vsense.config.experiment import first_robots, load
from vsense.config.specs import Experiment, Stage
from vsense.modes.sim.job import Setup
from vsense.robots.sources import CodeOptions
from vsense.run import asked
from vsense.run.cast import Cast, recast, recast_parts
from vsense.studies.series._plan import Condition, PlannedStart, SeriesPlan
from vsense.world.robot_models import MODELS_FOLDER

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
        """The experiment's file, and those of its controllers, loop functions and own models."""
        experiment, loop = self.experiment, self.experiment.loop_functions
        sources = {path for spec in experiment.controllers for path in spec.sources}
        models = {model.file for model in experiment.models.values()}
        sources |= {file for file in models if file.parent != MODELS_FOLDER}
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
        loaded = {}
        for condition in self.plan.conditions:
            try:
                loaded[condition.name] = self.load(condition)
            except (ConfigError, UsageError) as error:
                line, path = condition.line, str(self.plan.path)
                raise ConfigError(path, line, f"{condition.name}: {error}") from None
        for start in self.plan.starts:
            for name, planned in loaded.items():
                try:
                    start.places.settled(planned.experiment)
                except (ConfigError, UsageError) as error:
                    words = f"start {start.name}, {name}: {error}"
                    raise ConfigError(str(self.plan.path), start.line, words) from None
        return loaded

    def load(self, condition: Condition) -> PlannedExperiment:
        """Loads what a condition runs."""
        settings = dict(condition.settings)
        experiment = self._load(condition, settings)
        if condition.controller:
            labels = {experiment.controller_of(robot).label for robot in experiment.robots}
            if len(labels) > 1 or len(experiment.controllers) > 1:
                names = ", ".join(sorted(labels))
                raise UsageError(
                    f"controller: {experiment.file} has several ({names}): name one with"
                    ' settings, such as "ELEMENT.library" = "FILE"'
                )
            path = Path(condition.controller)
            file = str(path.absolute()) if os.path.isfile(path) else condition.controller
            settings[f"{labels.pop()}.library"] = file  # last: it renames what others may set
            experiment = self._load(condition, settings)
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

    def _load(self, condition: Condition, settings: Mapping[str, str]) -> Experiment:
        plan, stage = self.plan, STAGES[self.plan.mode]
        how = plan.duration_s, settings, stage, self.virtual_devices, self.code
        return first_robots(load(condition.experiment, *how, self.casting), plan.count)


class SeriesCast:
    """The robots of all conditions.

    Attributes:
        by_condition: what each condition runs, with who plays now.
    """

    def __init__(self, by_condition: Mapping[str, PlannedExperiment], console: Console) -> None:
        self.by_condition = dict(by_condition)
        self._console = console
        self._cast = Cast(lambda: [planned.experiment for planned in self.by_condition.values()])

    @property
    def tags(self) -> set[int]:
        """Everybody who plays in some run."""
        return {r.tag for planned in self.by_condition.values() for r in planned.experiment.robots}

    def follow(self, condition: str, casting: Casting) -> None:
        """Goes on with whom people have put in while a run of a condition waited.

        Raises:
            UsageError: an experiment cannot be played by them.
        """
        before = dict(self.by_condition[condition].experiment.casting.replaced)
        after = dict(casting.replaced)
        robots = {part: after.get(part, part) for part in before | after}
        changed = {part: tag for part, tag in robots.items() if before.get(part, part) != tag}
        for name, planned in self.by_condition.items():
            experiment = recast_parts(planned.experiment, changed)
            self.by_condition[name] = replace(planned, experiment=experiment)

    def put_in_for(self, gone: Mapping[int, str]) -> list[int]:
        """Puts a spare in for each of these robots, as far as there are spares, and says so.

        Args:
            gone: by tag, why each cannot go on.

        Returns:
            Those for whom there is no spare.

        Raises:
            UsageError: an experiment cannot be played by the spares.
        """
        spares = self._cast.substitutes(gone)
        for tag, why in gone.items():
            text = f"robot {tag} {why}; there is no spare for it"
            if tag in spares:
                text = f"robot {tag} {why}: robot {spares[tag]} has its role from now on"
            self._console.say(text, "warning")
        for pair in spares.items():
            self._recast(pair)
        return [tag for tag in gone if tag not in spares]

    def _recast(self, pair: Pair) -> None:
        """Has a robot play in the place of another in all conditions in which that one plays."""
        for name, planned in self.by_condition.items():
            if pair[0] in {robot.tag for robot in planned.experiment.robots}:
                experiment = recast(planned.experiment, pair)
                self.by_condition[name] = replace(planned, experiment=experiment)
