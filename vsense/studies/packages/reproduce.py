"""Makes everything in a package again, and says what is the same: checksums first, then runs."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from vsense import __version__
from vsense.base.errors import VsenseError, failing_as
from vsense.base.files import parse_json, read_text
from vsense.config.specs import Experiment
from vsense.modes import origin
from vsense.modes.sim import fingerprint
from vsense.modes.sim.job import Job
from vsense.modes.sim.outcome import Task
from vsense.modes.sim.watch import Flag, WorkerProcess, watch
from vsense.monitor.recording import require
from vsense.run.directory import LOGGED, MEASURES_CSV, SUMMARY, TIMESTEPS_CSV, TRAJECTORY
from vsense.run.programs import shared_objects
from vsense.studies.packages import _comparing, _figures
from vsense.studies.packages._archive import Package, PackageError
from vsense.studies.packages._comparing import Claims
from vsense.studies.packages._contents import (
    CONTENTS,
    MOST_CONTENTS,
    NO_RECORDING,
    SETUP_FILE,
    PackageContents,
    PackedRun,
)
from vsense.studies.packages._places import UNTRUSTED, PackagePlaces

_FILES = (TRAJECTORY, TIMESTEPS_CSV, MEASURES_CSV, LOGGED, "shown.csv")
_NO_ORIGIN = "what it was made from is not in the package"


@dataclass(slots=True)
class PreparedRun:
    """A run that can be simulated, and where what it leaves goes."""

    run: PackedRun
    task: Task
    folder: Path


class Simulating:
    """The simulated runs of a package.

    Args:
        places: where the package is.
        claims: take what becomes of them.
        trusted: code of the package may be compiled and run.
        jobs: runs at the same time.
        interrupted: set to end it.
        show: takes what is going on.
    """

    def __init__(
        self,
        places: PackagePlaces,
        claims: Claims,
        trusted: bool,
        jobs: int,
        interrupted: Flag,
        show: Callable[[str], None],
    ) -> None:
        self._places, self._claims, self._trusted = places, claims, trusted
        self._jobs, self._interrupted, self._show = jobs, interrupted, show
        self._built: dict[str, dict[str, str]] = {}
        self._machines: dict[str, str] = {}

    def make(self, runs: Sequence[PackedRun]) -> None:
        """Simulates runs, and compares; raises `Interrupted` where `interrupted` is set."""
        prepared, by_run = [], {run: Claims() for run in runs}
        for run, claims in by_run.items():
            with claims.attempt(f"{run.title}: simulation", self._places.public):
                prepared.append(self._prepare(run))
        lost = ""
        for simulated, answer in self._answers(prepared):
            run, claims = simulated.run, by_run[simulated.run]
            try:
                self._compare(simulated, simulated.task.result(answer), claims)
            except VsenseError as error:
                lost = self._places.public(error)
                claims.judge(f"{run.title}: simulation", f"it failed: {lost}")
            except _comparing.DAMAGED_FILE as error:
                claims.judge(f"{run.title}: files", f"one is damaged: {error!r}")
        for run, claims in by_run.items():  # in the order of the package
            if not claims.claims:
                why = f"not tried: the process that simulates was lost ({lost})"
                claims.cannot(f"{run.title}: simulation", why)
            self._claims.claims += claims.claims

    def _answers(
        self, prepared: Sequence[PreparedRun]
    ) -> Iterator[tuple[PreparedRun, dict[str, Any]]]:
        workers: list[WorkerProcess[PreparedRun]] = []
        lines = ((run, run.task.job.to_line()) for run in prepared)
        done = 0

        def show(busy: Sequence[WorkerProcess[PreparedRun]]) -> None:
            self._show(f"{done} of {len(prepared)} runs simulated")

        try:
            for _ in range(min(self._jobs, len(prepared))):
                workers.append(WorkerProcess())
            for run, answer in watch(lines, workers, self._interrupted, show):
                yield run, answer
                done += 1
        finally:
            for worker in workers:
                worker.close()

    def _prepare(self, run: PackedRun) -> PreparedRun:
        """Loads and builds what a run needs; VsenseError where it cannot be had."""
        facts = self._setup(run)
        if run.seed is None:
            raise VsenseError("its seed is not in the package")
        setup = self._places.setup(facts, self._trusted)
        experiment = setup.load()
        folder = self._places.remade / run.folder if run.folder else None
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
        recording = None
        if run.recordings:
            recording = self._places.remade / run.recordings[0]
            recording.parent.mkdir(parents=True, exist_ok=True)
        job = Job(
            setup,
            run.seed,
            self._libraries(run, experiment),
            None if folder is None or not self._has(run, TRAJECTORY) else str(folder),
            None if recording is None else str(recording),
        )
        return PreparedRun(run, Task(job, experiment), folder or self._places.remade)

    def _setup(self, run: PackedRun) -> Mapping[str, Any]:
        """How a run was set up; VsenseError where the package does not say."""
        if not run.sources or not run.key:
            raise VsenseError(_NO_ORIGIN)
        path = self._places.package / run.sources / SETUP_FILE
        try:
            facts = parse_json(read_text(path, most_bytes=origin.MOST_FACTS_BYTES))
            self._note_machine(run.sources, dict(facts["machine"]))
            setup = facts["setups"][run.key]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise VsenseError(f"{run.sources}/{SETUP_FILE} is damaged: {error!r}") from None
        if not isinstance(setup, dict):
            raise VsenseError(f"{run.sources}/{SETUP_FILE} is damaged: no setup")
        return setup

    def _note_machine(self, sources: str, machine: dict[str, str]) -> None:
        """Notes once why results may differ here."""
        if sources in self._machines:
            return
        here = fingerprint.of_machine()
        other = [name for name, value in machine.items() if here.get(name, value) != value]
        self._machines[sources] = words = ", ".join(
            f"{name} was {machine[name]}, is {here[name]}" for name in other
        )
        if words:
            self._claims.notes.append(f"{sources} was made elsewhere: {words}")

    def _libraries(self, run: PackedRun, experiment: Experiment) -> dict[str, str]:
        key = f"{run.sources} {run.key}"
        if key not in self._built:
            self._show(f"building what {run.title} runs")
            built = shared_objects(experiment)
            self._built[key] = {name: str(path) for name, path in built.items()}
        return self._built[key]

    def _has(self, run: PackedRun, name: str) -> bool:
        return bool(run.folder) and os.path.isfile(self._places.package / run.folder / name)

    def _compare(self, simulated: PreparedRun, result: Mapping[str, Any], claims: Claims) -> None:
        run, places, experiment = simulated.run, self._places, simulated.task.experiment
        if run.row is not None and run.table:
            before = _comparing.row_of(places.package / run.table, run.row)
            cells = _comparing.cells(before, _cells(experiment, result))
            claims.judge(f"{run.title}: row of {run.table}", cells)
        if run.folder and self._has(run, SUMMARY):
            summary = parse_json(read_text(places.package / run.folder / SUMMARY))
            now = json.loads(json.dumps({**result["measures"]}))
            differences = _comparing.figures("measures", summary.get("measures"), now)
            claims.judge(f"{run.title}: {SUMMARY}", list(differences))
        names = [*_FILES, f"{experiment.name}.png"] if simulated.task.job.directory else []
        for name in [name for name in names if self._has(run, name)]:
            path, remade = places.package / run.folder / name, simulated.folder / name
            claims.judge(f"{run.folder}/{name}", _comparing.files(path, remade, places.scrubber))
        for name in run.recordings[:1]:
            path, remade = places.package / name, places.remade / name
            claims.judge(name, _comparing.recordings(path, remade))


def _cells(experiment: Experiment, result: Mapping[str, Any]) -> dict[str, str]:
    tags = [robot.tag for robot in experiment.robots]
    measures = {**(result["swarm"] if experiment.sources else {}), **result["measures"]}
    return {
        "duration_s": f"{float(result['timesteps'] * result['timestep_s']):.12g}",
        "robots": str(len(tags)),
        "tags": " ".join(map(str, tags)),
        **{n: "" if v is None else f"{v:.12g}" for n, v in measures.items()},
    }


_PACKAGE, _REMADE = "package", "anew"
"""Folders of what was unpacked, and of what was made again."""


@dataclass(frozen=True, slots=True)
class ReproduceOptions:
    """How a package is made again.

    Attributes:
        output: a new folder that keeps all; None: nothing stays.
        trusted: code of the package may be compiled and run.
        only_check: nothing is made again: its checksums are compared.
        jobs: simulated runs at the same time.
    """

    output: Path | None = None
    trusted: bool = False
    only_check: bool = False
    jobs: int = 1


def reproduce(
    path: Path,
    options: ReproduceOptions,
    interrupted: Flag,
    say: Callable[[str], None],
    show: Callable[[str], None],
) -> Claims:
    """Makes a package again.

    Args:
        interrupted: set to end it.
        say: takes a line that stays; `show` what is going on.

    Raises:
        DamagedPackage: something in it is not what was packed.
        PackageError: it is no package.
        VsenseError: it cannot be unpacked, or a library for its recordings is missing.
        Interrupted: `interrupted` was set.
    """
    claims = Claims()
    with Package(path) as package:
        package.verify(lambda name, share: show(f"checking {100 * share:.0f} %"))
        say(f"{path}: {len(package.names)} files are what was packed")
        contents = _contents(package)
        if options.only_check:
            claims.judge("checksums", "", f"{len(package.names)} files")
            return claims
        if any(run.recordings for run in contents.runs):
            require()
        with _folder(options.output) as folder:
            show(f"unpacking {package.size >> 20} MB")
            package.unpack(folder / _PACKAGE)
            places = PackagePlaces(folder / _PACKAGE, folder / _REMADE)
            _make_all(contents, places, claims, options, interrupted, show)
    if any(UNTRUSTED in claim.words for claim in claims.claims):
        claims.notes.append(f"some of it was left alone: {UNTRUSTED}")
    return claims


def _contents(package: Package) -> PackageContents:
    data = package.read(CONTENTS, MOST_CONTENTS)
    try:
        return PackageContents.read(data, package.names)
    except VsenseError as error:
        raise PackageError(f"{package.path}: {error}") from None


@contextmanager
def _folder(output: Path | None) -> Iterator[Path]:
    """The folder that is asked for, which is new or empty; None: one that goes in the end."""
    if output is None:
        with TemporaryDirectory(prefix="vsense-reproduce-") as folder:
            yield Path(folder).resolve()
        return
    with failing_as(PackageError, f"{output}: cannot be written"):
        output.mkdir(parents=True, exist_ok=True)
        if any(output.iterdir()):
            raise PackageError(f"{output}: is not empty: expected a new folder")
        (output / _REMADE).mkdir()
    yield output.resolve()


def _make_all(
    contents: PackageContents,
    places: PackagePlaces,
    claims: Claims,
    options: ReproduceOptions,
    interrupted: Flag,
    show: Callable[[str], None],
) -> None:
    if contents.version != __version__:
        claims.notes.append(f"vsense was {contents.version}, now {__version__}")
    places.remade.mkdir(exist_ok=True)
    simulated = [run for run in contents.runs if run.mode == "sim"]
    not_simulated = [run for run in contents.runs if run.mode != "sim"]
    trusted = options.trusted
    Simulating(places, claims, trusted, options.jobs, interrupted, show).make(simulated)
    if not any(run.recordings for run in contents.runs):
        for run in not_simulated:
            claims.cannot(f"{run.title}: readings and poses", NO_RECORDING)
    elif not_simulated:
        from vsense.studies.packages._recordings import (
            RecordedRuns,  # these need the extra `record`
        )

        recorded = RecordedRuns(places, claims, trusted, interrupted, show)
        for run in not_simulated:
            recorded.make(run)
    if contents.report:
        _make_report(contents, places, claims, show)


def _make_report(
    contents: PackageContents, places: PackagePlaces, claims: Claims, show: Callable[[str], None]
) -> None:
    if missing := _figures.cannot():
        claims.cannot(_figures.REPORT_PREFIX, missing)
        return
    before, after = places.package / _figures.REPORT_PREFIX, places.remade / _figures.REPORT_PREFIX
    with claims.attempt(_figures.REPORT_PREFIX, places.public):
        questions = _figures.from_data(contents.asked)
        files = contents.report
        _figures.make(places.package, files, questions, after, lambda text: show(f"report: {text}"))
        names = {path.name for folder in (before, after) for path in folder.iterdir()}
        for name in sorted(names):
            thing = f"{_figures.REPORT_PREFIX}/{name}"
            if not os.path.exists(before / name):
                claims.judge(thing, "it is not in the package")
            else:
                claims.judge(thing, _comparing.files(before / name, after / name, places.scrubber))
