"""One run that is to be simulated, as it travels to the process that does it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from vsense.config.experiment import first_robots, load
from vsense.config.specs import Experiment
from vsense.errors import UsageError


@dataclass(frozen=True, slots=True)
class Setup:
    """What is run: an experiment with the command line's changes.

    Attributes:
        experiment: a shipped experiment's name, or the path of its file.
        duration_s: length of the run, None: the file's.
        robots: how many of its robots, None: all.
        blind: hold the virtual sensors at 0.
        settings: values by `ELEMENT.attribute` instead of the file's.
    """

    experiment: str
    duration_s: float | None = None
    robots: int | None = None
    blind: bool = False
    settings: Mapping[str, str] = field(default_factory=dict)

    def load(self) -> Experiment:
        """Loads the experiment.

        Raises:
            UsageError: it is not there, has no length, or not so many robots.
            ConfigError: its file is wrong.
        """
        return self.fit(load(self.experiment, self.duration_s, self.settings))

    def fit(self, experiment: Experiment) -> Experiment:
        """Takes the robots that are wanted of a loaded experiment; raises as `load`."""
        if not experiment.timesteps:
            raise UsageError(f"{experiment.file}: has no length: give one with --duration")
        return first_robots(experiment, self.robots)


@dataclass(frozen=True, slots=True)
class Job:
    """One run.

    Attributes:
        setup: what is run.
        seed: of everything that is drawn.
        library: the controller's shared object.
        directory: where trajectories and picture go, None: nobody wants them.
    """

    setup: Setup
    seed: int
    library: str
    directory: str | None = None

    def to_line(self) -> bytes:
        """The job as one line of JSON."""
        return json.dumps(asdict(self)).encode() + b"\n"

    @classmethod
    def from_line(cls, line: bytes) -> Job:
        """Reads what `to_line` gave."""
        fields: dict[str, Any] = json.loads(line)
        return cls(Setup(**fields.pop("setup")), **fields)
