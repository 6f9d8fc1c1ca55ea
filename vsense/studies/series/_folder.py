"""The folder of a series: its plan as it was begun with, its table of runs, a folder for each run.
And the table of a campaign, with the recordings beside it.

What is done stands in the table and nowhere else. A run's folder without a row is of a run that was
cut off.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from vsense import __version__
from vsense.base.errors import UsageError, VsenseError, failing_as
from vsense.base.files import parse_json, read_text, replace_text, stamp_of
from vsense.modes.sim.fingerprint import of_file, software
from vsense.monitor.recording import MCAP
from vsense.run.directory import SERIES, TIMESTEPS_CSV, DirectoryError, make_new
from vsense.run.runs_csv import RUNS, RunRow, RunsFile, utc, versions
from vsense.studies.series._order import PlannedRun
from vsense.studies.series._plan import SeriesPlan

PLAN = "plan.toml"
"""A copy of the plan as it is now."""

_LOCK = ".lock"
_FREE = ("again", "repetitions", "robots")
"""What may change while a series goes on; of repetitions there may be more."""
_MOST_LETTERS = 120
"""Of the settings in a recording's name."""


class SeriesFolder:
    """The folder, which one process at a time has; a context that gives it back.

    Attributes:
        path: where it is.
        table: its runs.csv.
        plan_changes: what has changed in the plan that may change.
        upgrade: which vsense began the series and which goes on with it, in words; "": the same.
        allows_upgrade: rows may be added with another vsense, or with files that have changed.
    """

    table: RunsFile

    def __init__(
        self, path: Path, plan: SeriesPlan, files: Sequence[Path], allows_upgrade: bool = False
    ) -> None:
        """`files` are those of users that results depend on."""
        self.path, self._plan = path, plan
        self.upgrade, self.allows_upgrade = "", allows_upgrade
        self._files = {plan.beside(str(file)): file for file in files}
        self._stamps = {name: stamp_of(file) for name, file in self._files.items()}
        self._digests = {name: _digest(file) for name, file in self._files.items()}
        self._begun = self._digests
        self.plan_changes: list[str] = []
        self._stack = ExitStack()

    def __enter__(self) -> SeriesFolder:
        """Takes the folder, and makes it where there is none.

        Raises:
            UsageError: it is that of another plan, or another process has it; or another vsense
                began it, or files have changed since, and that is not allowed.
            VsenseError: it cannot be written.
        """
        try:
            with failing_as(DirectoryError, f"cannot write to {self.path}"):
                self._refuse_others()
                self.path.mkdir(parents=True, exist_ok=True)
                self._lock()
            self._compare()
            self.table = RunsFile(self.path / RUNS)
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    @property
    def rows(self) -> Sequence[RunRow]:
        """The runs so far."""
        return self.table.rows

    @property
    def changed(self) -> list[str]:
        """Files that were others when the series began, as they were looked at last."""
        return [
            str(self._files[name])
            for name, digest in self._digests.items()
            if self._begun.get(name, digest) != digest
        ]

    def check_files(self) -> list[str]:
        """Looks at the files again; gives those of `changed` that were not among them before."""
        before = self.changed
        stamps = {name: stamp_of(file) for name, file in self._files.items()}
        new = {n: _digest(f) for n, f in self._files.items() if stamps[n] != self._stamps[n]}
        self._stamps, self._digests = stamps, self._digests | new
        return [file for file in self.changed if file not in before]

    def of_run(self, run: PlannedRun) -> Path:
        """Makes the folder of a run; DirectoryError where it cannot be made."""
        folder = self.path / run.name
        with failing_as(DirectoryError, f"cannot make {folder}"):
            if os.path.isdir(folder) and not self.is_cut_off(run):
                shutil.rmtree(folder)  # of a run that was waited for, and never began
            return make_new(folder)

    def recording(self, run: PlannedRun, name: str) -> Path:
        """The recording of a simulated run of an experiment's name; raises as `of_run`."""
        return self.of_run(run) / f"{name}{MCAP}"

    def append(self, row: RunRow) -> None:
        """Adds a run; raises as `RunsFile.append`."""
        self.table.append(row)

    def is_cut_off(self, run: PlannedRun) -> bool:
        """Whether a run of this name began, and nobody wrote down how it ended."""
        return os.path.exists(self.path / run.name / TIMESTEPS_CSV)

    def _lock(self) -> None:
        # Without a buffer: what a full disk refuses is not written once more when it is closed.
        file = self._stack.enter_context((self.path / _LOCK).open("a+b", buffering=0))
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            who = file.read(40).decode(errors="replace").strip()
            raise UsageError(
                f"{self.path}: process {who} carries this series out already"
            ) from None
        file.truncate(0)
        file.write(b"%d" % os.getpid())

    def _refuse_others(self) -> None:
        """Leaves folders alone that are of something else."""
        if not os.path.isdir(self.path) or os.path.exists(self.path / SERIES):
            return
        # What it was killed in, or a full disk, has left of its first file is its own.
        own = (_LOCK, f".{SERIES}.")
        if any(not entry.name.startswith(own) for entry in self.path.iterdir()):
            raise UsageError(f"{self.path}: is not empty, and of no series: choose a new folder")

    def _compare(self) -> None:
        """Compares the plan with that of before, or keeps it."""
        now, before = self._plan.facts(), read_notes(self.path)
        if before is None:
            begun = {"plan": now, "files": self._digests, "version": __version__}
            self._write({**begun, "software": software()})
            return
        self.plan_changes = allowed_changes(self._plan, self.path)
        self._begun = before["files"]
        self.upgrade = _upgrade(before)
        if not self.allows_upgrade and (self.upgrade or self.changed):
            raise UsageError(changed_words(str(self.path), [self.upgrade, *self.changed]))
        # One of vsense 0.1 says no more than a version: from here on it is known.
        facts: dict[str, Any] = {"software": software(), **before}
        if self.plan_changes:
            change: dict[str, Any] = {"when": utc(time.time()), "what": self.plan_changes}
            facts |= {"plan": now, "changes": [*before.get("changes", ()), change]}
        if facts != before:
            self._write(facts)

    def _write(self, facts: Mapping[str, Any]) -> None:
        with failing_as(DirectoryError, f"cannot write to {self.path}"):
            replace_text(self.path / SERIES, f"{json.dumps(facts, indent=2)}\n")
            replace_text(self.path / PLAN, read_text(self._plan.path))


def changed_words(series: str, changes: Sequence[str]) -> str:
    """What to say where a series does not go on because something has changed since it began."""
    return (
        f"{series}: changed since this series began: {', '.join(filter(None, changes))}. Runs would"
        " differ by more than their conditions: change it back, begin another series with -o, or"
        " go on with --allow-upgrade, which the rows note"
    )


def _upgrade(begun: Mapping[str, Any]) -> str:
    """Which vsense began a series, and which goes on; "": the same. For its notes in series.json.

    Those of vsense 0.1 have a version only.
    """
    before, now = begun.get("software", {"vsense": begun.get("version", "")}), software()
    if all(before.get(name) in (None, now[name]) for name in ("vsense", "sources")):
        return ""
    words = (
        f"vsense {facts.get('vsense')} ({facts.get('commit') or facts.get('sources')})"
        for facts in (before, now)
    )
    return " became ".join(words)


class CampaignTable:
    """The table of a campaign: it serves simulated runs as `SeriesFolder` does.

    All its rows are of one campaign, whose plan's name they have as `series`. A simulation has no
    time of day: the same campaign gives the same bytes.

    Attributes:
        path: the folder of recordings, beside the table.
        table: the file.
    """

    plan_changes: Sequence[str] = ()
    changed: Sequence[str] = ()
    upgrade, allows_upgrade = "", True

    def __init__(self, table: RunsFile, plan: SeriesPlan, mixed: bool = False) -> None:
        """Takes the table; UsageError: it holds something else.

        `mixed`: runs of different experiments may have different measures.
        """
        self._mixed = mixed
        self.path = table.path.with_name(f"{table.path.stem}-recordings")
        self.table = table
        self._stems = _stems(plan)
        for line, row in enumerate(self.rows, 2):
            if row.series != plan.name:
                name = row.series or "without a name"
                raise UsageError(
                    f"{table.path}:{line}: a row of campaign {name}, this is"
                    f" {plan.name}: the experiment, its controller, the options or the names of"
                    " settings have changed; give another file with -o"
                )

    @property
    def rows(self) -> Sequence[RunRow]:
        """The runs so far."""
        return self.table.rows

    def check_files(self) -> Sequence[str]:
        """Files that have changed: the campaign's name is a digest of them, taken once."""
        return ()

    def is_cut_off(self, run: PlannedRun) -> bool:
        """Of a run that was cut off there is no trace."""
        return False

    def recording(self, run: PlannedRun, name: str) -> Path:
        """The recording of a run; VsenseError if its folder cannot be made."""
        with failing_as(VsenseError, f"{self.path}: cannot be written"):
            self.path.mkdir(parents=True, exist_ok=True)
        attempt = f"attempt{run.attempt}-" if run.attempt > 1 else ""
        stem = self._stems[run.cell.condition]
        return self.path / f"{stem}{attempt}seed{run.cell.seed}{MCAP}"

    def append(self, row: RunRow) -> None:
        """Adds a run.

        VsenseError: its measures are not those of the rows before, or the file cannot be written.
        """
        before = self.table.measures
        if self.rows and list(row.measures) != before and not self._mixed:
            raise VsenseError(
                f"{self.table.path}: seed {row.seed} gave the measures"
                f" {', '.join(row.measures) or 'none'}; the rows before have"
                f" {', '.join(before) or 'none'}"
            )
        # Which programs were run is in the campaign's name.
        self.table.append(replace(row, versions=versions()))


def _stems(plan: SeriesPlan) -> dict[str, str]:
    """How the names of recordings begin, by condition."""
    stems = {}
    for number, condition in enumerate(plan.conditions, 1):
        words = ",".join(f"{key}={value}" for key, value in condition.settings.items())
        safe = re.sub(r"[^A-Za-z0-9_.=,+-]+", "_", words)[:_MOST_LETTERS]
        stems[condition.name] = f"{number:02d}-{safe}-" if words else ""
    return stems


def read_notes(folder: Path) -> dict[str, Any] | None:
    """What the folder of a series has of its plan and files; None: no series has begun there.

    Raises:
        UsageError: it is of something else.
        VsenseError: it cannot be read.
    """
    path = folder / SERIES
    try:
        notes: dict[str, Any] = parse_json(read_text(path))
        plan, files = notes["plan"], notes["files"]
        if not isinstance(plan, dict) or not isinstance(files, dict):
            raise KeyError("plan")
        if not isinstance(notes.get("software", {}), dict):
            raise KeyError("software")
        if type(plan.get("repetitions", 0)) is not int:
            raise ValueError(f"repetitions is {plan['repetitions']!r}")
    except FileNotFoundError:
        return None
    except (KeyError, TypeError):
        raise UsageError(f"{folder}: is of no series by a plan: choose a new folder") from None
    except OSError as error:
        raise VsenseError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise VsenseError(f"{path}: is damaged: {error}") from None
    return notes


def allowed_changes(plan: SeriesPlan, folder: Path) -> list[str]:
    """What has changed in the plan since the series in a folder began, in words.

    UsageError where that may not change; otherwise as `read_notes`.
    """
    before, now = read_notes(folder), plan.facts()
    if before is None:
        return []
    written = before["plan"]
    refused = differences(_binding(written), _binding(now))
    if not refused and now["repetitions"] < written.get("repetitions", 0):
        refused = differences(written["repetitions"], now["repetitions"], "repetitions")
    if refused:
        raise UsageError(
            f"{plan.path}: the plan has changed since the series in {folder} began:"
            f" {'; '.join(refused)}. Change it back, or begin another series with -o"
        )
    return differences(written, now)


def _binding(plan: Mapping[str, Any]) -> dict[str, Any]:
    """What of a plan has to stay: neither how often is tried, nor what becomes of robots."""
    return {name: value for name, value in plan.items() if name not in _FREE}


def differences(before: Any, now: Any, name: str = "") -> list[str]:
    """What is not the same in two plans, in words."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        texts = []
        for key in dict.fromkeys((*before, *now)):
            inner = f"{name}.{key}" if name else str(key)
            texts += differences(before.get(key), now.get(key), inner)
        return texts
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        return [text for n, pair in enumerate(zip(before, now), 1)
                for text in differences(*pair, f"{name} {n}")]  # fmt: skip
    if before == now:
        return []
    if isinstance(before, list) and isinstance(now, list):
        return [f"{name}: {len(before)} before, now {len(now)}"]
    return [f"{name}: {before!r} before, now {now!r}"]


def _digest(file: Path) -> str:
    """The SHA-256 of a file; "": it cannot be read, which whoever needs it will say."""
    with suppress(VsenseError):
        return of_file(file)
    return ""
