"""What runs have left, as arrays, data frames and tables of a notebook."""

from __future__ import annotations

import base64
import csv
import html
import importlib
import io
import math
import os
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import UsageError, VsenseError, failing_as, require
from vsense.base.files import parse_json, read_text
from vsense.base.message_bus import DAMAGED
from vsense.base.terminal import spoken
from vsense.config.specs import Experiment
from vsense.run.directory import LOGGED, MEASURES_CSV, SUMMARY, TIMESTEPS_CSV, TRAJECTORY
from vsense.run.runs_csv import RUNS, RunRow, read_runs

Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class FinishedRun:
    """What a run has left in its folder: of `vsense sim`, `vsense lab` or `vsense run`.

    Attributes:
        folder: where it is.
        experiment: of which it is a run; None: it was not said.
    """

    folder: Path
    experiment: Experiment | None = field(default=None, repr=False, compare=False)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The figures: summary.json."""
        path = Path(self.folder) / SUMMARY
        with failing_as(VsenseError, f"{path}: is left by no run", DAMAGED):
            return dict(parse_json(read_text(path)).items())

    @property
    def measures(self) -> dict[str, float]:
        """The experiment's measures at the end, by name."""
        return dict(self.summary["measures" if "measures" in self.summary else "results"])

    @property
    def valid(self) -> bool:
        """Whether the run counts; `summary["why"]` says why not."""
        return not self.summary["why"]

    @property
    def recording(self) -> Path:
        """Where its recording is, if it was recorded; see `vsense.open_recording`."""
        return Path(self.folder) / f"{self.summary['experiment']}.mcap"

    @cached_property
    def _trajectory(self) -> Mapping[str, NDArray[Any]]:
        path = Path(self.folder) / TRAJECTORY
        if not os.path.exists(path) and os.path.exists(self.recording):
            return self._recorded()
        return read_arrays(path)

    def _recorded(self) -> Columns:
        """What cameras saw and robots reported, as `trajectory.npz` has it of a simulation."""
        from vsense.monitor.recording.reader import open_recording

        steps = _columns(Path(self.folder) / TIMESTEPS_CSV, ["run_timestep", "timestep"])
        rows = dict(zip(steps["timestep"].tolist(), range(len(steps["timestep"]))))
        with open_recording(self.recording) as recording:
            facts = recording.experiment
            row_by_tag = {robot["tag"]: n for n, robot in enumerate(facts["robots"])}
            poses = np.full((len(rows), len(row_by_tag), 3), np.nan)
            leds, seen_row = np.zeros(poses.shape[:2], np.uint16), -1
            for message in recording.messages({"/arena", "/robots"}):
                data = message.data.get("robots", message.data)
                if message.topic == "/arena":
                    seen_row = rows.get(message.data["timestep"], -1)
                if seen_row < 0:
                    continue
                columns = [row_by_tag[tag] for tag in data["tag"]]
                if message.topic == "/robots":
                    leds[seen_row, columns] = data["leds"]
                    continue
                values = np.column_stack([data[name] for name in ("x_m", "y_m", "yaw_rad")])
                values[~np.array(data["seen"], bool)] = np.nan
                poses[seen_row, columns] = values
        time_s = steps["run_timestep"] * facts["timestep_s"]
        return {"time_s": time_s, "tags": np.array([*row_by_tag]), "poses": poses, "leds": leds}

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
        """(t, n, 3) x and y [m] and yaw [rad] of the robots, in the arena's frame.

        In the lab and with real robots as cameras saw them, of a recorded run; NaN: not seen.
        """
        return np.asarray(self._trajectory["poses"])

    @property
    def leds(self) -> NDArray[np.uint16]:
        """(t, n) LEDs that are on: bits 0-7 ring, 8 body, 9 front."""
        return np.asarray(self._trajectory["leds"])

    @cached_property
    def measured(self) -> Columns:
        """The measures over time: `time_s`, and (t,) of each; empty where nothing is measured."""
        path = Path(self.folder) / MEASURES_CSV
        return _columns(path, ["time_s"]) if os.path.exists(path) else {"time_s": self.time_s}

    @cached_property
    def events(self) -> list[tuple[float, str]]:
        """What controllers and loop functions logged, and people were told: time [s] and words."""
        path = Path(self.folder) / LOGGED
        if not os.path.exists(path) and os.path.exists(self.recording):
            from vsense.monitor.recording.reader import open_recording

            with open_recording(self.recording) as recording:
                said = [message.data for message in recording.messages({"/event"})]
            return [(e["time_s"], e["text"]) for e in said if e["time_s"] is not None]
        with failing_as(VsenseError, f"{path}: cannot be read", DAMAGED):
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

    def play(self) -> Any:
        """The run as it plays in a notebook: a widget.

        Raises:
            UsageError: anywidget is not installed (extra `notebook`), or the experiment is not
                known.
            VsenseError: what is left of the run cannot be read.
        """
        require("play() needs", "anywidget")
        from vsense.studies._drawing import make_player

        return make_player(self.poses, self.leds, self._known(), self.summary["seed"])

    def draw(self, axes: Any, until_s: float = math.inf, **line: Any) -> None:
        """Draws the arena and the way of each robot, with a dot at its end, into Matplotlib's axes.

        Args:
            until_s: how much of the run [s].
            line: of `axes.plot`, for the ways: `color="tab:blue"`.

        Raises:
            UsageError, VsenseError: as `play`.
        """
        from vsense.studies import _drawing

        experiment = self._known()
        picture = _drawing.empty_arena(experiment, self.summary["seed"], 2 * _drawing.PICTURE_PX)
        extent = _drawing.corners(experiment).T.ravel()
        axes.imshow(picture[:, :, ::-1], extent=extent, zorder=0)
        _drawing.draw_ways(axes, self.poses[self.time_s <= until_s], line)

    def _known(self) -> Experiment:
        if self.experiment is None:
            words = "expected a run that simulate(), lab() or run() gave, or"
            raise UsageError(f"{self.folder}: {words} FinishedRun(folder, experiment)")
        return self.experiment

    def _repr_html_(self) -> str:
        words = {"seed": self.summary["seed"], "robots": self.summary["robots"]}
        words["verdict"] = "valid" if self.valid else f"invalid: {self.summary['why']}"
        words |= {spoken(name): f"{value:g}" for name, value in self.measures.items()}
        table = _table_html(["", self.summary["experiment"]], words.items())
        if not os.path.exists(self.picture):
            return table
        # Notebooks show either HTML or a picture: the one holds the other.
        data = base64.b64encode(self.picture.read_bytes()).decode()
        return f'{table}<img style="max-width: 100%" src="data:image/png;base64,{data}">'


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


def unpack(package: str | Path, folder: str | Path) -> list[RunTable]:
    """Unpacks a package of `vsense pack` into a new folder; gives its tables of runs.

    Recordings lie in the folder, too; see `vsense.open_recording`. Nothing of it is run.

    Raises:
        VsenseError: it is no package, a file differs from its checksum, or the folder is not empty.
    """
    from vsense.studies.packages._archive import Package  # reading a run waits for no archives

    with Package(Path(package)) as archive:
        archive.verify()
        archive.unpack(Path(folder))
    return [RunTable(path) for path in sorted(Path(folder).rglob(RUNS))]


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


def read_arrays(path: Path) -> Columns:
    """Reads a file of arrays that a run left, none compressed; VsenseError: it is none.

    What its arrays and its ZIP file say of their sizes is believed as far as the file is large.
    """
    damage = (*DAMAGED, zipfile.BadZipFile, zlib.error, EOFError, RuntimeError)
    cannot = failing_as(VsenseError, f"{path}: cannot be read", damage)
    with cannot, zipfile.ZipFile(path) as archive:
        infos = archive.infolist()
        size, most = sum(info.file_size for info in infos), path.stat().st_size + (32 << 20)
        if size > most or len(infos) > len(set(archive.namelist())):
            raise ValueError(f"unfolds to {size} bytes, or names an array twice")
        for info in infos:
            with archive.open(info) as file:
                np.lib.format.read_magic(file)
                shape, _, dtype = np.lib.format.read_array_header_1_0(file)
            if math.prod(shape) * max(dtype.itemsize, 1) > info.file_size:
                raise ValueError(f"{info.filename} has {info.file_size} bytes, not {shape}")
        with np.load(path, allow_pickle=False) as arrays:
            return dict(arrays)


def _columns(path: Path, first: Sequence[str]) -> Columns:
    """The columns of a table of numbers, but for the count of timesteps."""
    with failing_as(VsenseError, f"{path}: cannot be read", DAMAGED):
        rows = list(csv.DictReader(io.StringIO(read_text(path))))
        more = (n for n in (rows[0] if rows else ()) if n not in (*first, "run_timestep"))
        return {n: np.array([float(row[n] or "nan") for row in rows]) for n in [*first, *more]}


def _frame(columns: Columns) -> Any:
    require("to_pandas() needs", "pandas")
    return importlib.import_module("pandas").DataFrame(columns)


def _table_html(heads: Sequence[str], rows: Any) -> str:
    def line(kind: str, cells: Any) -> str:
        return "".join(f"<{kind}>{html.escape(str(cell))}</{kind}>" for cell in cells)

    body = "".join(f"<tr>{line('td', row)}</tr>" for row in rows)
    return f"<table><thead><tr>{line('th', heads)}</tr></thead><tbody>{body}</tbody></table>"
