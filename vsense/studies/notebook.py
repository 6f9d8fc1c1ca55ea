"""Experiments from Python: load one, change it, simulate it, and take what is left as arrays.

    foraging = vsense.load("foraging", duration_s=60)
    run = foraging.simulate(seed=1)
    run.poses["x_m"]                                   # (timesteps, robots)
    runs = foraging.simulate_many(range(1, 11), {"foraging.release": [0, 0.3, 1]}, "release.csv")
    runs.to_pandas().groupby("foraging.release")["items_home"].median()

It does what `vsense sim` does, in the same way and with the same files. Nothing is printed, unless
`progress` is asked for; what would be on the terminal is in the results or raised.
"""

from __future__ import annotations

import csv
import html
import importlib
import io
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import Interrupted, VsenseError, failing_as, require
from vsense.base.files import parse_json, read_text
from vsense.base.terminal import Console, Interruption, interruption, spoken
from vsense.config.description import describe
from vsense.config.specs import Experiment, Stage
from vsense.modes.options import ExperimentOptions
from vsense.modes.sim import experiment as single
from vsense.modes.sim.job import SimOptions, Sweep, setup_of
from vsense.run.directory import LOGGED, SUMMARY, TRAJECTORY
from vsense.run.runs_csv import RunRow, read_runs
from vsense.studies.report import FORMATS

if TYPE_CHECKING:
    from vsense.modes.sim.stepping import Reward
    from vsense.studies._parallel import SwarmEnvironment

Setting = str | float
Columns = dict[str, NDArray[Any]]


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
    options = ExperimentOptions(str(experiment), Stage.SIM, blind=blind)
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
) -> SwarmEnvironment:
    """Makes an environment; see `vsense.load` for the first four.

    Observations are float32, sensor after sensor in the order of the file, then the robot's own
    ring where the file has `<epuck_proximity>`: the numbers that a controller reads, 0 where they
    are not known yet. Actions are in -1..1: left and right wheel, 1 is 1000 steps/s (12.9 cm/s);
    then one for each of `actuators`; then one for the LEDs, which are on where it is above 0.

    Args:
        reward: name of a measure of the experiment, whose increase in a step every robot is given;
            or a function. None: the experiment's first measure.
        actuators: virtual actuators by name, and what -1 and 1 stand for of their first number.
        leds: robots have red LEDs to switch.
        render_mode: "rgb_array", "human" (a window, extra `report`), or None.

    Raises:
        UsageError: PettingZoo is not installed (extra `learn`); the experiment has several
            controllers; there is no such measure or actuator.
        VsenseError: as `vsense.load`.
    """
    require("parallel_env() needs", "pettingzoo")
    from vsense.studies._parallel import SwarmEnvironment

    loaded = load_experiment(experiment, settings, robots, duration_s).experiment
    return SwarmEnvironment(loaded, reward, dict(actuators or {}), leds, render_mode)


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
        added = {key: str(value) for key, value in (settings or {}).items()}
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
    ) -> SimulatedRun:
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
        folder = None if output is None else Path(output)
        options = replace(self.options, seed=seed, output=folder)
        with _interruptible() as interrupted:
            asked = SimOptions(options, record=record)
            _, folder = single.simulate(asked, _console(progress), interrupted)
        return SimulatedRun(folder)

    def simulate_many(
        self,
        seeds: Sequence[int],
        settings: Mapping[str, Sequence[Setting]] | None = None,
        output: str | Path = "results.csv",
        jobs: int | None = None,
        progress: bool = False,
    ) -> RunTable:
        """Simulates every combination of settings with every seed: a campaign.

        Args:
            seeds: of the runs.
            settings: values by `ELEMENT.attribute`.
            output: the table, a .csv file. Runs that are in it are not made again.
            jobs: runs at the same time; None: one for each processor.

        Raises:
            KeyboardInterrupt: Ctrl-C; the same call goes on from there.
            VsenseError: a run cannot be made; or the table is of another campaign.
        """
        from vsense.studies.series import campaign

        fixed = {key: (value,) for key, value in self.options.settings.items()}
        varied = {key: tuple(map(str, values)) for key, values in (settings or {}).items()}
        path = Path(output).with_suffix(".csv")
        table = campaign.Campaign(
            Sweep({**fixed, **varied}, tuple(seeds)),
            setup_of(self.options),
            path,
            path.with_suffix(f".{FORMATS[0]}"),
            jobs=jobs,
        )
        with _interruptible() as interrupted:
            campaign.run(table, _console(progress), interrupted)
        return RunTable(path)

    def __str__(self) -> str:
        """What it holds, as `--dry` prints it."""
        return describe(self.experiment)

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"


@dataclass(frozen=True)
class SimulatedRun:
    """What a run of `vsense sim` has left in its folder.

    Attributes:
        folder: where it is.
    """

    folder: Path

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The figures: summary.json."""
        path = Path(self.folder) / SUMMARY
        with failing_as(VsenseError, f"{path}: is no run of vsense sim"):
            summary: dict[str, Any] = parse_json(read_text(path))
        return summary

    @property
    def measures(self) -> dict[str, float]:
        """The experiment's measures at the end, by name."""
        return dict(self.summary["measures"])

    @property
    def valid(self) -> bool:
        """Whether the run counts; `summary["why"]` says why not."""
        return not self.summary["why"]

    @cached_property
    def _trajectory(self) -> Mapping[str, NDArray[Any]]:
        path = Path(self.folder) / TRAJECTORY
        cannot = failing_as(VsenseError, f"{path}: cannot be read")
        with cannot, np.load(path, allow_pickle=False) as arrays:
            return dict(arrays)

    @property
    def time_s(self) -> NDArray[np.float64]:
        """(t,) time of each timestep [s]."""
        return np.asarray(self._trajectory["time_s"])

    @property
    def tags(self) -> NDArray[np.int64]:
        """(n,) the robots."""
        return np.asarray(self._trajectory["tags"])

    @property
    def poses(self) -> NDArray[np.float64]:
        """(t, n, 3) x and y [m] and yaw [rad] of the robots, in the arena's frame."""
        return np.asarray(self._trajectory["poses"])

    @property
    def leds(self) -> NDArray[np.uint16]:
        """(t, n) LEDs that are on: bits 0-7 ring, 8 body, 9 front."""
        return np.asarray(self._trajectory["leds"])

    @cached_property
    def measured(self) -> Columns:
        """The measures over time: `time_s`, and (t,) of each; empty where nothing is measured."""
        path = Path(self.folder) / "measures.csv"
        return _columns(path, ["time_s"]) if path.exists() else {"time_s": self.time_s}

    @cached_property
    def events(self) -> list[tuple[float, str]]:
        """What controllers and loop functions logged: time [s] and words."""
        path = Path(self.folder) / LOGGED
        rows = csv.DictReader(io.StringIO(read_text(path)))
        return [(float(row["time_s"]), row["text"]) for row in rows]

    def columns(self) -> Columns:
        """One row for each timestep and robot: time_s, tag, x_m, y_m, yaw_rad, leds."""
        timesteps, robots = self.poses.shape[:2]
        given = {"time_s": np.repeat(self.time_s, robots), "tag": np.tile(self.tags, timesteps)}
        poses = self.poses.reshape(-1, 3)
        given |= {name: poses[:, k] for k, name in enumerate(("x_m", "y_m", "yaw_rad"))}
        return {**given, "leds": self.leds.reshape(-1)}

    def to_pandas(self) -> Any:
        """`columns` as a `pandas.DataFrame`; UsageError: pandas is not installed."""
        return _frame(self.columns())

    @property
    def picture(self) -> Path:
        """The run in one picture, a PNG file."""
        return Path(self.folder) / f"{self.summary['experiment']}.png"

    def _repr_png_(self) -> bytes:
        return self.picture.read_bytes()

    def _repr_html_(self) -> str:
        words = {"seed": self.summary["seed"], "robots": self.summary["robots"]}
        words["verdict"] = "valid" if self.valid else f"invalid: {self.summary['why']}"
        words |= {spoken(name): f"{value:g}" for name, value in self.measures.items()}
        return _table_html(["", self.summary["experiment"]], words.items())


@dataclass(frozen=True)
class RunTable:
    """A runs.csv: a row for each run, of a campaign, a series, or runs in the lab or with robots.

    Attributes:
        path: the file.
    """

    path: Path

    @cached_property
    def rows(self) -> list[RunRow]:
        """All of them, valid or not; VsenseError: it is no such table."""
        with failing_as(VsenseError, f"{self.path}: cannot be read"):
            return read_runs(Path(self.path))

    def columns(self) -> Columns:
        """One row for each valid run: run, condition, start, seed, what varied, and measures."""
        rows = [row for row in self.rows if row.valid]
        names = "run", "condition", "start", "seed"
        given: dict[str, list[Any]] = {n: [getattr(row, n) for row in rows] for n in names}
        settings = [_settings_of(row.condition) for row in rows]
        for name in dict.fromkeys(key for row in settings for key in row):
            given[name] = [_number(row.get(name, "")) for row in settings]
        for name in dict.fromkeys(name for row in rows for name in row.measures):
            given[name] = [_measure(row.measures.get(name)) for row in rows]
        return {name: np.array(values) for name, values in given.items()}

    def to_pandas(self) -> Any:
        """`columns` as a `pandas.DataFrame`; UsageError: pandas is not installed."""
        return _frame(self.columns())

    def _repr_html_(self) -> str:
        columns = self.columns()
        rows = zip(*columns.values())
        return _table_html(list(columns), rows)


def _settings_of(condition: str) -> dict[str, str]:
    """The settings that a campaign's condition names: a=1, b=2."""
    parts = (part.partition("=") for part in condition.split(", "))
    return {name: value for name, equals, value in parts if equals}


def _number(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text


def _measure(value: float | None) -> float:
    return float("nan") if value is None else value


def _columns(path: Path, first: Sequence[str]) -> Columns:
    """The columns of a table of numbers, but for the count of timesteps."""
    rows = list(csv.DictReader(io.StringIO(read_text(path))))
    names = [*first, *(n for n in (rows[0] if rows else ()) if n not in (*first, "run_timestep"))]
    return {n: np.array([float(row[n] or "nan") for row in rows]) for n in names}


def _frame(columns: Columns) -> Any:
    require("to_pandas() needs", "pandas")
    return importlib.import_module("pandas").DataFrame(columns)


def _table_html(heads: Sequence[str], rows: Any) -> str:
    def line(kind: str, cells: Any) -> str:
        return "".join(f"<{kind}>{html.escape(str(cell))}</{kind}>" for cell in cells)

    body = "".join(f"<tr>{line('td', row)}</tr>" for row in rows)
    return f"<table><thead><tr>{line('th', heads)}</tr></thead><tbody>{body}</tbody></table>"


def _console(progress: bool) -> Console:
    return Console() if progress else Console(io.StringIO())


@contextmanager
def _interruptible() -> Iterator[Interruption]:
    """Ctrl-C as a flag while a run goes on, and as Python's own exception after it."""
    if threading.current_thread() is not threading.main_thread():
        yield Interruption()
        return
    try:
        with interruption() as interrupted:
            yield interrupted
    except Interrupted:
        raise KeyboardInterrupt from None
