"""What is to be packed: series, campaigns and single runs, as they lie on the disk."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from vsense.base.errors import UsageError, failing_as
from vsense.base.files import parse_json, read_text
from vsense.modes import origin
from vsense.monitor.recording import MCAP
from vsense.run.directory import SUMMARY
from vsense.run.runs_csv import RUNS, RunRow, read_runs
from vsense.studies.packages._archive import PackageError

_MOST_SUMMARY = 64 << 20


@dataclass(frozen=True, slots=True)
class FoundRun:
    """A run.

    Attributes:
        name: as its table has it.
        row: its number in the table, None: there is no table, or no row.
        facts: its row.
        folder: with its files, None: it has left none.
        files: others that are of it, by name in the package.
    """

    name: str
    row: int | None
    facts: RunRow
    folder: Path | None
    files: Mapping[str, Path]

    @property
    def recordings(self) -> list[Path]:
        """Its recordings."""
        there = [] if self.folder is None else sorted(self.folder.glob(f"*{MCAP}"))
        return [*there, *(path for path in self.files.values() if path.suffix == MCAP)]

    def key_in(self, run_origin: origin.RunOrigin) -> str:
        """The key of a simulated run's setup; "": it has none."""
        row = self.facts
        keys = [origin.key_of(row.condition, row.start), origin.key_of(row.condition)]
        if self.row is None:
            keys.append(origin.key_of())
        return next((key for key in keys if key in run_origin.setups), "")


@dataclass(frozen=True, slots=True)
class FoundSeries:
    """Runs that lie together: a series, a campaign, one call of `lab` or `run`, a single run.

    Attributes:
        name: of its folder in the package.
        folder: where it is.
        table: its runs.csv, None: there is none.
        files: of all runs together, in `folder`.
        origins: what `origin.kept_in` found.
    """

    name: str
    folder: Path
    table: Path | None
    runs: Sequence[FoundRun]
    files: Sequence[Path]
    origins: Sequence[tuple[int, Path]]

    def origin_of(self, run: FoundRun) -> Path | None:
        """What a run was made from, None: nobody kept it."""
        paths = [path for begin, path in self.origins if begin <= (run.row or 0)]
        return paths[-1] if paths else None

    def is_of_other(self, path: Path, run: FoundRun) -> bool:
        """Whether a file is in the folder of another run."""
        folders = {other.folder for other in self.runs} - {run.folder, None}
        return any(path.is_relative_to(other) for other in folders if other is not None)


def gather(paths: Sequence[Path]) -> list[FoundSeries]:
    """Finds all runs that paths mean.

    Raises:
        UsageError: one is neither a table of runs, nor a folder of runs; or is there twice.
        PackageError: something cannot be read.
    """
    gathered: list[FoundSeries] = []
    taken: dict[str, Path] = {}
    for path in paths:
        with failing_as(PackageError, f"{path}: cannot be read"):
            series = _of_table(path) if path.suffix == ".csv" else _of_folder(path)
        place = (series.table or series.folder).resolve()
        if place in taken.values():
            raise UsageError(f"{path}: is named twice")
        name = series.name
        number = 2
        while name in taken or name == "report":
            name, number = f"{series.name}-{number}", number + 1
        taken[name] = place
        gathered.append(replace(series, name=name))
    return gathered


def _of_folder(folder: Path) -> FoundSeries:
    if not os.path.isdir(folder):
        raise UsageError(
            f"{folder}: expected the folder of a series or of runs, or their table (.csv)"
        )
    table = folder / RUNS
    name, origins = _plain(folder.resolve().name), origin.kept_in(folder)
    files = sorted(path for path in folder.iterdir() if os.path.isfile(path))
    if os.path.isfile(table):
        if origin.kept_beside(table):
            return _of_table(table)
        rows = read_runs(table)
        runs = [_run(folder, n, row, len(rows) == 1) for n, row in enumerate(rows)]
        return FoundSeries(name, folder, table, runs, files, origins)
    inner = sorted(path.parent for path in folder.glob(f"*/{SUMMARY}"))
    folders = [folder] if os.path.isfile(folder / SUMMARY) else inner
    if not folders:
        raise UsageError(f"{folder}: holds no runs: neither {RUNS} nor {SUMMARY}")
    runs = []
    for run_folder in folders:
        facts = _row(run_folder)
        label = name if run_folder == folder else run_folder.name
        runs.append(FoundRun(_plain(label), None, facts, run_folder, {}))
    series = FoundSeries(name, folder, None, runs, files, origins)
    if origins or len(folders) < 1:
        return series
    # Runs of a folder that have each kept their own.
    own = [record for run_folder in folders for record in origin.kept_in(run_folder)]
    return FoundSeries(name, folder, None, runs, files, own[:1])


def _of_table(table: Path) -> FoundSeries:
    """A campaign's table, with the recordings beside it; or that of a folder."""
    if not os.path.isfile(table):
        raise UsageError(f"{table}: there is no such file")
    folder, stem, origins = table.parent, table.stem, origin.kept_beside(table)
    # A campaign's table may have the name of a series', too.
    if table.name == RUNS and not origins:
        return _of_folder(folder)
    recordings = folder / f"{stem}-recordings"
    by_seed: dict[str, list[Path]] = {}
    for path in sorted(recordings.glob(f"*{MCAP}")) if os.path.isdir(recordings) else ():
        number = re.search(r"seed(\d+)$", path.stem)
        by_seed.setdefault(number[1] if number else "", []).append(path)
    runs = []
    for n, row in enumerate(read_runs(table)):
        mine = by_seed.get(str(row.seed), [])
        # Of several settings each has its own: which one, only the rows' order tells.
        files = {f"{recordings.name}/{path.name}": path for path in mine if len(mine) == 1}
        runs.append(FoundRun(row.run or f"row-{n + 1}", n, row, None, files))
    beside = [table, *(path for path in [table.with_suffix(".png")] if os.path.isfile(path))]
    return FoundSeries(_plain(stem), folder, table, runs, beside, origins)


def _run(folder: Path, number: int, row: RunRow, only: bool) -> FoundRun:
    """A run of a table, in a folder of its own or, the only one, in that of the table."""
    named = folder / row.run
    inside = row.run and "/" not in row.run and os.path.isdir(named)
    where = named if inside else folder if only else None
    return FoundRun(row.run or f"row-{number + 1}", number, row, where, {})


def _row(folder: Path) -> RunRow:
    path = folder / SUMMARY
    try:
        summary = parse_json(read_text(path, most_bytes=_MOST_SUMMARY))
        swarm = {k: v for k, v in summary.get("swarm", {}).items() if v is not None}
        return RunRow(
            run=folder.name,
            mode="sim" if "speedup" in summary else "run" if "per_robot" in summary else "lab",
            experiment=str(summary["experiment"]),
            condition="",
            seed=int(summary["seed"]),
            duration_s=float(summary["duration_s"]),
            robots=int(summary["robots"]),
            measures={**swarm, **summary.get("measures", summary.get("results", {}))},
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"{path}: is no {SUMMARY} of a run: {error!r}") from None


def _plain(name: str) -> str:
    """A name that every file system has."""
    return re.sub(r"[^\w.+=,-]", "_", name)[:100].strip(".") or "runs"
