"""What every mode begins with: an experiment as somebody asks for it, its seed, its folder."""

from __future__ import annotations

import json
import secrets
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vsense.base.terminal import Console
from vsense.config.casting import Casting
from vsense.config.description import as_json, describe, tag_confusion
from vsense.config.experiment import first_robots, load
from vsense.config.placement import settle
from vsense.config.roster import SPARE
from vsense.config.specs import Experiment, Stage
from vsense.robots.sources import CodeOptions
from vsense.run import directory


@dataclass(frozen=True, slots=True)
class ExperimentOptions:
    """Which experiment runs, and with what in place of what its file says.

    Attributes:
        experiment: a shipped experiment's name, or the path of a file.
        stage: where it runs.
        duration: length of a run [s]; None: the file's.
        robots: only the first so many play; None: all.
        seed: of everything that is drawn; 0 draws a fresh one, None: the file's.
        blind: virtual sensors are held at 0.
        settings: values by `ELEMENT.attribute`.
        code: where controllers' sources are.
        casting: which robots play.
        virtual_devices: as `load` has it.
        strict: a file in which anything is not supported is refused.
        lenient: a controller may ask for what nobody offers, or be told what it does not read.
        output: a new folder for all runs; None: one in runs/.
    """

    experiment: str
    stage: Stage
    duration: float | None = None
    robots: int | None = None
    seed: int | None = None
    blind: bool = False
    settings: Mapping[str, str] = field(default_factory=dict)
    code: CodeOptions = field(default_factory=CodeOptions)
    casting: Casting = field(default_factory=Casting)
    virtual_devices: bool = False
    strict: bool = False
    lenient: bool = False
    output: Path | None = None

    def load(self) -> Experiment:
        """Loads the experiment.

        Raises:
            UsageError: there is no such experiment, or a setting fits nothing in it.
            ConfigError: the file is wrong, or is not fully supported and `strict`; or a controller
                asks for what nobody offers, or is told what it does not read, and not `lenient`.
        """
        experiment = self._read()
        if self.strict:
            experiment.refuse_warnings()
        if not self.lenient:
            from vsense.run import asked  # what is only described is not tried

            asked.check(experiment)
        return experiment

    def described(self, in_json: bool) -> Iterator[str]:
        """What the experiment holds, for people or as JSON; then raises as its run would.

        Raises:
            UsageError: as `prepare`.
            ConfigError: as `prepare`; or as `load` if `strict`.
        """
        experiment = first_robots(self._read(), self.robots)
        yield json.dumps(as_json(experiment), indent=2) if in_json else describe(experiment)
        settle(experiment, choose_seed(self.seed, experiment), self.stage is not Stage.RUN)
        if self.strict:
            experiment.refuse_warnings()

    def _read(self) -> Experiment:
        how = self.duration, self.settings, self.stage, self.virtual_devices, self.code
        return load(self.experiment, *how, self.casting)

    def prepare(self, experiment: Experiment, real: bool = True) -> tuple[Experiment, int, Path]:
        """Takes the robots that are wanted and settles their places; for `real` see `settle`.

        Returns:
            The experiment, the seed of its first run, and the new directory of all runs.

        Raises:
            UsageError: there are not so many robots.
            ConfigError: there is no place for all.
            DirectoryError: the directory cannot be made, or is not empty.
        """
        seed = choose_seed(self.seed, experiment)
        experiment = settle(first_robots(experiment, self.robots), seed, real)
        return experiment, seed, directory.make(self.output, experiment.name, seed)

    def made_of(self, experiment: Experiment, seed: int) -> dict[str, Any]:
        """How an experiment was loaded and prepared, for recordings."""
        code = self.code.absolute(Path.cwd())
        return {
            "path": str(experiment.path.absolute()),
            "stage": experiment.stage.value,
            "length_s": self.duration,
            "settings": dict(self.settings),
            "virtual_devices": self.virtual_devices,
            "robots": self.robots,
            "seed": seed,
            "code": {"sources": dict(code.sources), "includes": list(code.includes)},
        }


def choose_seed(seed: int | None, experiment: Experiment) -> int:
    """The seed of a run: `seed`, where it is None the file's; for 0 a fresh one."""
    seed = experiment.seed if seed is None else seed
    return seed or secrets.randbelow(2**32 - 1) + 1


def say_warnings(experiment: Experiment, console: Console) -> None:
    """Says what of the experiment's file is not supported, and who plays for whom."""
    for warning in experiment.warnings:
        console.say(f"vsense: {warning}")
    if words := tag_confusion(experiment):
        console.say(f"vsense: {experiment.file}: {words}", "warning")
    for text in _casting_notes(experiment):
        console.say(text)


def _casting_notes(experiment: Experiment) -> Iterator[str]:
    """Who was taken out of a roster, who plays for whom, and who of them is out of order."""
    casting = experiment.casting
    playing = {robot.tag for robot in experiment.robots}
    taken = [tag for tag in experiment.taken if tag in playing]
    reasons = dict(casting.others)
    if taken:
        left = [f"{tag} is {why}" for tag, why in reasons.items() if tag not in playing]
        less = f"; not taken: {', '.join(left)}" if left else ""
        yield f"{casting.roster}: robots {' '.join(map(str, taken))} take part{less}"
    for out, new in casting.replaced:
        yield f"robot {new} takes the role of {out}"
    for tag, why in reasons.items():
        if tag in playing and why != SPARE:
            yield f"robot {tag} is {why}: --replace {tag}=TAG gives another its role"
