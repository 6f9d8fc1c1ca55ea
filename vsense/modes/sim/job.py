"""What is simulated, and how: one run as it travels to its process, and a campaign's sweep."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any

from vsense.base.errors import UsageError
from vsense.config.casting import Casting
from vsense.config.experiment import first_robots, load
from vsense.config.placement import StartPlaces
from vsense.config.specs import Experiment, Stage
from vsense.modes.options import ExperimentOptions
from vsense.monitor import recording
from vsense.robots.sources import CodeOptions

if TYPE_CHECKING:
    from vsense.monitor.ui.access import FoxgloveAddress, WebAddress
    from vsense.monitor.ui.room import RoomOptions


@dataclass(frozen=True, slots=True)
class Setup:
    """What is run: an experiment with the command line's changes.

    Attributes:
        experiment: a shipped experiment's name, or the path of its file.
        duration_s: length of the run, None: the file's.
        robots: how many of its robots, None: all.
        blind: hold the virtual sensors at 0.
        settings: values by `ELEMENT.attribute` instead of the file's.
        code: where the controllers' sources are.
        casting: which robots play.
        start: where everything is when the run begins; None: where the run's seed has it.
    """

    experiment: str
    duration_s: float | None = None
    robots: int | None = None
    blind: bool = False
    settings: Mapping[str, str] = field(default_factory=dict)
    code: CodeOptions = field(default_factory=CodeOptions)
    casting: Casting = field(default_factory=Casting)
    start: StartPlaces | None = None

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> Setup:
        """Reads what `dataclasses.asdict` made, also from JSON; UsageError: no such length."""
        for name, most in (("duration_s", 86_400.0), ("robots", 10_000)):
            if (value := data.get(name)) is not None and not 0 < value <= most:
                raise UsageError(f"{name}: {value!r}, expected more than 0 and at most {most}")
        fields, start = dict(data), data["start"]
        fields["code"] = CodeOptions(**fields["code"])
        fields["casting"] = Casting.read(fields["casting"])
        fields["start"] = None if start is None else StartPlaces.read(start)
        return cls(**fields)

    def load(self) -> Experiment:
        """Loads the experiment.

        Raises:
            UsageError: it is not there, has no length, or not so many robots.
            ConfigError: its file is wrong.
        """
        how = self.duration_s, self.settings, Stage.SIM
        return self.fit(load(self.experiment, *how, code=self.code, casting=self.casting))

    def fit(self, experiment: Experiment) -> Experiment:
        """Reduces a loaded experiment to its wanted robots; raises as `load`."""
        if not experiment.timesteps:
            raise UsageError(f"{experiment.file}: has no length: give one with --duration")
        experiment = first_robots(experiment, self.robots)
        return experiment if self.start is None else self.start.settled(experiment)


def setup_of(options: ExperimentOptions) -> Setup:
    """What runs of an experiment are made from."""
    return Setup(
        options.experiment,
        options.duration,
        options.robots,
        options.blind,
        options.settings,
        options.code,
        options.casting,
    )


@dataclass(frozen=True, slots=True)
class SimOptions:
    """How an experiment is simulated.

    Attributes:
        experiment: which, and how it is read.
        web: where a page shows the run; None: nowhere.
        foxglove: where Foxglove does, too.
        speed: times real time, at which a page's run begins; None: 1.
        hold: it begins paused.
        locked: nobody may change the world on the page.
        record: every run has a recording.
        json: the figures are printed on standard output.
    """

    experiment: ExperimentOptions
    web: WebAddress | None = None
    foxglove: FoxgloveAddress | None = None
    speed: float | None = None
    hold: bool = False
    locked: bool = False
    record: bool = False
    json: bool = False

    @property
    def room(self) -> RoomOptions:
        """How a page shows it."""
        from vsense.monitor.ui.room import RoomOptions  # a run without a page begins sooner

        return RoomOptions(self.web, self.foxglove, hold=self.hold, locked=self.locked)

    def check(self) -> None:
        """Raises UsageError where something is missing that the run needs."""
        if self.record:
            recording.require()
        if self.web is not None:
            self.room.check()


@dataclass(frozen=True, slots=True)
class JobOrigin:
    """Where a job comes from that another machine shall do, and what it finds there.

    Attributes:
        host: the machine's name.
        folder: that relative paths are taken from.
        cxxflags: what the user wants a C++ compiler to be told; None: nothing.
        files: SHA-256 of all files that the user has given, by absolute path.
    """

    host: str
    folder: str
    cxxflags: str | None
    files: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Job:
    """One run.

    Attributes:
        libraries: the shared object of each controller, by its id.
        directory: where trajectories and picture go; None: they are not kept.
        recording: file of the recording; None: there is none.
        origin: where it comes from, and there are no `libraries` yet; None: from this machine.
    """

    setup: Setup
    seed: int
    libraries: Mapping[str, str]
    directory: str | None = None
    recording: str | None = None
    origin: JobOrigin | None = None

    def to_line(self) -> bytes:
        """The job as one line of JSON."""
        return json.dumps(asdict(self)).encode() + b"\n"

    @classmethod
    def from_line(cls, line: bytes) -> Job:
        """Reads what `to_line` gave."""
        fields: dict[str, Any] = json.loads(line)
        setup = Setup.read(fields.pop("setup"))
        if fields["origin"] is not None:
            fields["origin"] = JobOrigin(**fields["origin"])
        return cls(setup, **fields)


@dataclass(frozen=True, slots=True)
class Sweep:
    """The settings and seeds of a campaign.

    Attributes:
        values: by setting its values, in the order of the command line.
        seeds: seeds of the runs of every combination; None: there is no campaign, but one run.
    """

    values: dict[str, tuple[str, ...]]
    seeds: tuple[int, ...] | None

    @classmethod
    def of(
        cls, settings: Sequence[tuple[str, str]], runs: int | None, seeds: Sequence[int] | None
    ) -> Sweep:
        """Reads the command line: settings, runs of every combination, and their seeds.

        The values of a setting are separated by commas, or by semicolons where one holds a comma.

        Raises:
            UsageError: a setting or a value is there twice, a value is empty, or there are not
                as many seeds as runs.
        """
        values: dict[str, tuple[str, ...]] = {}
        for key, text in settings:
            if key in values:
                raise UsageError(f"--set {key}: given twice; give all values in one")
            values[key] = values_of(f"--set {key}", text)
        if runs is not None and seeds is not None and len(seeds) != runs:
            raise UsageError(f"--runs {runs}: --seeds names {len(seeds)}")
        if runs is None and seeds is None and all(len(texts) == 1 for texts in values.values()):
            return cls(values, None)
        return cls(values, tuple(seeds) if seeds is not None else tuple(range(1, (runs or 1) + 1)))

    @property
    def first(self) -> dict[str, str]:
        """The first combination."""
        return {key: texts[0] for key, texts in self.values.items()}

    def combinations(self) -> Iterator[dict[str, str]]:
        """All combinations; the last setting changes fastest."""
        for texts in product(*self.values.values()):
            yield dict(zip(self.values, texts))


def values_of(option: str, text: str) -> tuple[str, ...]:
    """Values that commas separate, or semicolons where one holds a comma.

    UsageError, which begins with `option`: one is empty, or there twice.
    """
    parts = text.removesuffix(";").split(";") if ";" in text else text.split(",")
    values = tuple(part.strip() for part in parts)
    if "" in values:
        raise UsageError(f"{option}={text}: expected values between the separators")
    if len(set(values)) < len(values):
        raise UsageError(f"{option}={text}: expected every value once")
    return values
