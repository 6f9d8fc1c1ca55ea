"""Experiments from Python: load one, change it, simulate it, and take what is left as arrays.

    foraging = vsense.load("foraging", duration_s=60)
    run = foraging.simulate(seed=1)
    run.poses[:, :, :2]                                # (timesteps, robots, 2): x and y [m]
    runs = foraging.simulate_many(range(1, 11), {"foraging.release": [0, 0.3, 1]}, "release.csv")
    runs.to_pandas().groupby("foraging.release")["items_home"].median()

It does what `vsense sim` does, in the same way and with the same files. Nothing is printed, unless
`progress` is asked for; what would be on the terminal is in the results or raised.
"""

from __future__ import annotations

import html
import io
import math
import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsense.base.errors import Interrupted, UsageError, require
from vsense.base.interruption import Interruption, interruption
from vsense.base.terminal import Console
from vsense.config.description import describe
from vsense.config.experiment import shipped
from vsense.config.specs import Experiment, Stage
from vsense.modes.options import ExperimentOptions
from vsense.modes.sim import experiment as single
from vsense.modes.sim.job import SimOptions, Sweep, setup_of
from vsense.run import directory
from vsense.run.environment import MOST_SEED
from vsense.studies.report import FORMATS
from vsense.studies.results import FinishedRun, RunTable

if TYPE_CHECKING:
    from vsense.modes.sim.engine import JobExecutor
    from vsense.modes.sim.stepping import Reward
    from vsense.studies._parallel import SwarmEnvironment
    from vsense.studies.live_run import LiveRun
    from vsense.studies.series.campaign import Campaign

Setting = str | float


def load_experiment(
    experiment: str | Path,
    settings: Mapping[str, Setting] | None = None,
    robots: int | None = None,
    duration_s: float | None = None,
    blind: bool = False,
) -> LoadedExperiment:
    """Loads an experiment: a shipped one by name, an `.argos` file, or the folder of one.

    Args:
        settings: values by `ELEMENT.attribute` in place of the file's, as `--set` has them.
        robots: so many of them; None: as in the file.
        duration_s: length of a run [s]; None: the file's.
        blind: virtual sensors are held at 0, the control.

    Raises:
        UsageError: there is no such experiment, or a setting fits nothing in it.
        ConfigError: the file is wrong; the message names file, line and what was expected.
    """
    name = str(experiment)
    if name not in shipped() and os.path.exists(name):
        name = os.path.abspath(name)  # also when the current folder is another one
    options = ExperimentOptions(name, Stage.SIM, blind=blind)
    return LoadedExperiment(options).changed(settings, robots, duration_s)


def parallel_env(
    experiment: str | Path,
    settings: Mapping[str, Setting] | None = None,
    robots: int | None = None,
    duration_s: float | None = None,
    reward: str | Reward | None = None,
    actuators: Mapping[str, tuple[float, float]] | None = None,
    leds: bool = False,
    render_mode: str | None = None,
    controller: str = "",
) -> SwarmEnvironment:
    """Makes an environment; see `vsense.load` for the first four.

    Observations are float32, sensor after sensor in the order of the file, then "proximity", the
    robot's own or a virtual one, where the file has it: the numbers that a controller reads, 0
    where they are not known yet. Actions are in -1..1: left and right wheel, 1 is 1000 steps/s
    (12.9 cm/s); then one for each of `actuators`; then one for the LEDs, which are on where it is
    above 0. A learnt policy (`.onnx`) observes and acts the same way.

    Args:
        reward: name of a measure of the experiment, whose increase in a step every robot is given;
            "-light_distance_m": its decrease; or a function. None: the first measure's increase.
        actuators: virtual actuators by name, and what -1 and 1 stand for of their first number.
        leds: robots have red LEDs to switch.
        render_mode: "rgb_array", "human" (a window, extra `report`), or None.
        controller: whose robots the agents are, by its id, where the experiment has several; the
            others do what their own controllers say.

    Raises:
        UsageError: PettingZoo is not installed (extra `learn`); the experiment has several
            controllers, and none was named; there is no such controller, measure or actuator.
        VsenseError: as `vsense.load`.
    """
    require("parallel_env() needs", "pettingzoo")
    from vsense.studies._parallel import SwarmEnvironment

    loaded = load_experiment(experiment, settings, robots, duration_s).experiment
    return SwarmEnvironment(loaded, reward, dict(actuators or {}), leds, render_mode, controller)


@dataclass(frozen=True)
class LoadedExperiment:
    """An experiment as it will be simulated; changing it makes another one.

    Attributes:
        options: what is asked for, as the command line has it.
    """

    options: ExperimentOptions

    @cached_property
    def experiment(self) -> Experiment:
        """What the file holds, with the changes: robots, arena, controllers, sensors."""
        return setup_of(self.options).fit(self.options.load())

    def changed(
        self,
        settings: Mapping[str, Setting] | None = None,
        robots: int | None = None,
        duration_s: float | None = None,
    ) -> LoadedExperiment:
        """The same with other settings, which are added to those it has; raises as `load`."""
        robots = checked("robots", robots, int, 1)
        duration_s = checked("duration_s", duration_s, float, 0.0)
        added = {key: str(value) for key, value in dict(settings or {}).items()}
        changed = LoadedExperiment(
            replace(
                self.options,
                settings={**self.options.settings, **added},
                robots=self.options.robots if robots is None else robots,
                duration=self.options.duration if duration_s is None else duration_s,
            )
        )
        _ = changed.experiment  # what is wrong is said here
        return changed

    def simulate(
        self,
        seed: int | None = None,
        output: str | Path | None = None,
        record: bool = False,
        progress: bool = False,
    ) -> FinishedRun:
        """Simulates it once.

        Args:
            seed: of everything that is drawn; None: the file's.
            output: a new folder for what the run leaves; None: one in runs/.
            record: leaves a recording, too.
            progress: says on standard error what `vsense sim` says.

        Raises:
            KeyboardInterrupt: Ctrl-C; what there is of the run is in its folder.
            VsenseError: it cannot be simulated, or has failed.
        """
        seed = checked("seed", seed, int, 0, MOST_SEED)
        folder = None if output is None else Path(output)
        options = replace(self.options, seed=seed, output=folder)
        with interruptible() as interrupted:
            asked = SimOptions(options, record=record)
            _, folder = single.simulate(asked, console_of(progress), interrupted)
        return FinishedRun(folder, self.experiment)

    def simulate_many(
        self,
        seeds: Sequence[int],
        settings: Mapping[str, Sequence[Setting]] | None = None,
        output: str | Path = "results.csv",
        jobs: int | None = None,
        on: str | JobExecutor | None = None,
        progress: bool = False,
    ) -> RunTable:
        """Simulates every combination of settings with every seed: a campaign.

        Args:
            seeds: of the runs.
            settings: values by `ELEMENT.attribute`.
            output: the table, a .csv file. Runs that are in it are not made again.
            jobs: runs at the same time; None: one for each processor.
            on: what does the runs instead of this computer: a `concurrent.futures.Executor`, or the
                address of a Dask scheduler (extra `cluster`).

        Raises:
            KeyboardInterrupt: Ctrl-C; the same call goes on from there.
            VsenseError: a run cannot be made; or the table is of another campaign.
        """
        from vsense.modes.sim.engine import Engine
        from vsense.studies.series import campaign
        from vsense.studies.series._simulated import check_simulator

        executor = None if isinstance(on, str) else on
        if not (executor is None or hasattr(executor, "submit")):
            raise UsageError(f"on={on!r}: expected HOST:PORT, or an executor, which has submit()")
        jobs, address = checked("jobs", jobs, int, 1), on if isinstance(on, str) else None
        check_simulator(address, jobs, record=False)
        varied = {k: tuple(map(str, listed(k, given))) for k, given in (settings or {}).items()}
        table = self._campaign(listed("seeds", seeds), varied, output)
        engine = None if executor is None else Engine(type(executor).__name__, executor)
        with interruptible() as interrupted:
            wanted = replace(table, how=campaign.CampaignOptions(jobs=jobs, on=address))
            campaign.run(wanted, console_of(progress), interrupted, engine)
        return RunTable(table.output)

    def _campaign(
        self, seeds: Sequence[int], varied: Mapping[str, tuple[str, ...]], output: str | Path
    ) -> Campaign:
        from vsense.studies.series.campaign import Campaign

        fixed = {key: (value,) for key, value in self.options.settings.items()}
        wanted = tuple(checked("seeds", seed, int, 1, MOST_SEED) for seed in seeds)
        path = Path(os.path.abspath(output)).with_suffix(".csv")
        picture = path.with_suffix(f".{FORMATS[0]}")
        return Campaign(Sweep({**fixed, **varied}, wanted), setup_of(self.options), path, picture)

    def lab(
        self,
        seed: int | None = None,
        output: str | Path | None = None,
        progress: bool = False,
        **options: Any,
    ) -> LiveRun:
        """Starts it in the lab: `vsense lab`, in a process of its own.

        Args:
            seed: of everything that is drawn; None: the file's.
            output: a new folder for what its runs leave; None: one in runs/.
            progress: what the command says is printed on standard error.
            options: those of `vsense lab --help all`, with underscores: `web=8080, pace=0.5`. It is
                recorded, unless `record=False`.

        Raises:
            UsageError: an option is wrong, or something does not go together.
            VsenseError: it cannot begin.
        """
        return self._start("lab", seed, output, progress, options)

    def run(
        self,
        seed: int | None = None,
        output: str | Path | None = None,
        progress: bool = False,
        **options: Any,
    ) -> LiveRun:
        """Starts it with real robots: `vsense run`, in a process of its own; as `lab`.

        `tracking=("resources.xml", "session.xml"), roster="robots.toml"`: options of
        `vsense run --help all`. All robots stop when the `with` block ends, or this process.
        """
        return self._start("run", seed, output, progress, options)

    def _start(
        self,
        command: str,
        seed: int | None,
        output: str | Path | None,
        progress: bool,
        options: Mapping[str, Any],
    ) -> LiveRun:
        from vsense.studies.live_run import LiveRun, options_as_words

        seed = checked("seed", seed, int, 0, MOST_SEED)
        own = self.options
        settings = [word for item in own.settings.items() for word in ("--set", "=".join(item))]
        given = {"robots": own.robots, "duration": own.duration, "blind": own.blind, "seed": seed}
        words = options_as_words({"record": True, **given, **options})
        wanted = None if output is None else Path(output)
        folder = directory.make(wanted, self.experiment.name, seed)
        words = (command, own.experiment, *settings, *words)
        return LiveRun(words, folder, progress, self.experiment)

    def __str__(self) -> str:
        """What it holds, as `--dry` prints it."""
        return describe(self.experiment)

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"


def checked(name: str, value: Any, kind: type[Any], least: float, most: float = math.inf) -> Any:
    """The value as a plain number; UsageError: it is none, or beyond its bounds. None stays."""
    if value is None:
        return None
    try:
        number = kind(value)
        if (
            isinstance(value, (str, bool))
            or number != value
            or not least <= number <= most
            or number == math.inf
        ):
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        kinds = "a whole number" if kind is int else "a number"
        upper = f"to {most:.0f}" if most < math.inf else "or more"
        raise UsageError(f"{name}={value!r}: expected {kinds}, {least:g} {upper}") from None
    return number


def listed(name: str, values: Any) -> list[Any]:
    """What a list holds, each once; UsageError: it is no list, is empty, or has something twice."""
    try:
        items = [] if isinstance(values, (str, bytes)) else list(values)
    except TypeError:
        items = []
    if not items or None in items or len(set(map(str, items))) < len(items):
        raise UsageError(f"{name}={values!r}: expected a list of one or more, each once")
    return items


def console_of(progress: bool) -> Console:
    """Standard error, or where nobody reads."""
    return Console() if progress else Console(io.StringIO())


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Ctrl-C as a flag while a run goes on, and as Python's own exception after it."""
    if threading.current_thread() is not threading.main_thread():
        yield Interruption()
        return
    try:
        with interruption() as interrupted:
            yield interrupted
    except Interrupted:
        raise KeyboardInterrupt(interrupted.code) from None
