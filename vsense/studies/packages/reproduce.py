"""Makes everything in a package again, and says what is the same: checksums first, then runs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from vsense import __version__
from vsense.base.errors import VsenseError, failing_as
from vsense.base.files import MOST_TABLE_BYTES, parse_json, read_text
from vsense.config.specs import Experiment
from vsense.modes.sim import fingerprint
from vsense.modes.sim.job import Job
from vsense.modes.sim.outcome import Task
from vsense.modes.sim.record import LOGGED, TRAJECTORY
from vsense.modes.sim.watch import LIMIT_S, Flag, WorkerProcess, watch
from vsense.monitor.recording import require
from vsense.run.directory import MEASURES, SUMMARY, TIMESTEPS
from vsense.run.programs import shared_objects
from vsense.studies.packages import comparing, figures
from vsense.studies.packages.archive import Package, PackageError
from vsense.studies.packages.contents import (
    CONTENTS,
    MADE,
    NO_RECORDING,
    PackageContents,
    PackedRun,
)
from vsense.studies.packages.findings import Reproduction
from vsense.studies.packages.places import UNTRUSTED, PackagePlaces

_FILES = (TRAJECTORY, TIMESTEPS, MEASURES, LOGGED, "shown.csv")
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
        findings: take what becomes of them.
        trusted: code of the package may be compiled and run.
        jobs: runs at the same time.
        interrupted: set to end it.
        show: takes what is going on.
    """

    def __init__(
        self,
        places: PackagePlaces,
        findings: Reproduction,
        trusted: bool,
        jobs: int,
        interrupted: Flag,
        show: Callable[[str], None],
    ) -> None:
        self._places, self._findings, self._trusted = places, findings, trusted
        self._jobs, self._interrupted, self._show = jobs, interrupted, show
        self._built: dict[str, dict[str, str]] = {}
        self._machines: dict[str, str] = {}

    def make(self, runs: Sequence[PackedRun]) -> None:
        """Simulates runs, and compares; raises `Interrupted` where `interrupted` is set."""
        prepared, found = [], {run: Reproduction() for run in runs}
        for run in runs:
            try:
                prepared.append(self._prepare(run))
            except (VsenseError, *comparing.DAMAGED) as error:
                found[run].cannot(f"{run.title}: simulation", self._places.public(error))
        lost = ""
        for one, answer in self._answers(prepared):
            try:
                self._compare(one, one.task.result(answer), found[one.run])
            except VsenseError as error:
                lost = self._places.public(error)
                found[one.run].differs(f"{one.run.title}: simulation", f"it failed: {lost}")
            except comparing.DAMAGED as error:
                found[one.run].differs(f"{one.run.title}: files", f"one is damaged: {error!r}")
        for run, findings in found.items():  # in the order of the package
            if not findings.each:
                why = f"not tried: the process that simulates was lost ({lost})"
                findings.cannot(f"{run.title}: simulation", why)
            self._findings.each += findings.each

    def _answers(
        self, prepared: Sequence[PreparedRun]
    ) -> Iterator[tuple[PreparedRun, dict[str, Any]]]:
        workers: list[WorkerProcess[PreparedRun]] = []
        lines = ((one, one.task.job.to_line()) for one in prepared)
        done = 0

        def show(busy: Sequence[WorkerProcess[PreparedRun]]) -> None:
            self._show(f"{done} of {len(prepared)} runs simulated")

        try:
            for _ in range(min(self._jobs, len(prepared))):
                workers.append(WorkerProcess())
            for one, answer in watch(lines, workers, self._interrupted, show, LIMIT_S):
                yield one, answer
                done += 1
        finally:
            for worker in workers:
                worker.close()

    def _prepare(self, run: PackedRun) -> PreparedRun:
        """Loads and builds what a run needs; VsenseError where it cannot be had."""
        told = self._setup(run)
        if run.seed is None:
            raise VsenseError("its seed is not in the package")
        setup = self._places.setup(told, self._trusted)
        experiment = setup.load()
        folder = self._places.anew / run.folder if run.folder else None
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
        kept = None
        if run.recordings:
            kept = self._places.anew / run.recordings[0]
            kept.parent.mkdir(parents=True, exist_ok=True)
        job = Job(
            setup,
            run.seed,
            self._libraries(run, experiment),
            None if folder is None or not self._has(run, TRAJECTORY) else str(folder),
            None if kept is None else str(kept),
        )
        return PreparedRun(run, Task(job, experiment), folder or self._places.anew)

    def _setup(self, run: PackedRun) -> Mapping[str, Any]:
        """How a run was set up; VsenseError where the package does not say."""
        if not run.sources or not run.key:
            raise VsenseError(_NO_ORIGIN)
        path = self._places.package / run.sources / MADE
        try:
            told = parse_json(read_text(path, most_bytes=MOST_TABLE_BYTES))
            self._note_machine(run.sources, dict(told["machine"]))
            found = told["setups"][run.key]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise VsenseError(f"{run.sources}/{MADE} is damaged: {error!r}") from None
        if not isinstance(found, dict):
            raise VsenseError(f"{run.sources}/{MADE} is damaged: no setup")
        return found

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
            self._findings.notes.append(f"{sources} was made elsewhere: {words}")

    def _libraries(self, run: PackedRun, experiment: Experiment) -> dict[str, str]:
        key = f"{run.sources} {run.key}"
        if key not in self._built:
            self._show(f"building what {run.title} runs")
            built = shared_objects(experiment)
            self._built[key] = {name: str(path) for name, path in built.items()}
        return self._built[key]

    def _has(self, run: PackedRun, name: str) -> bool:
        return bool(run.folder) and (self._places.package / run.folder / name).is_file()

    def _compare(self, one: PreparedRun, result: Mapping[str, Any], findings: Reproduction) -> None:
        """Compares all that a run has left."""
        run, places = one.run, self._places
        measures = self._measures(one, result)
        if run.row is not None and run.table:
            before = comparing.row_of(places.package / run.table, run.row)
            thing = f"{run.title}: row of {run.table}"
            findings.judge(thing, comparing.cells(before, self._cells(one, result, measures)))
        if run.folder and self._has(run, SUMMARY):
            told = json.loads(read_text(places.package / run.folder / SUMMARY))
            now = json.loads(json.dumps({**result["measures"]}))
            words = "" if told.get("measures") == now else f"now {now}"
            findings.judge(f"{run.title}: {SUMMARY}", words)
        names = [*_FILES, f"{one.task.experiment.name}.png"]
        for name in [name for name in names if one.task.job.directory and self._has(run, name)]:
            before_, now_ = places.package / run.folder / name, one.folder / name
            findings.judge(f"{run.folder}/{name}", comparing.files(before_, now_, places.scrubber))
        for name in run.recordings[:1]:
            pair = places.package / name, places.anew / name
            findings.judge(name, comparing.recordings(*pair))

    def _measures(self, one: PreparedRun, result: Mapping[str, Any]) -> dict[str, float | None]:
        swarm = result["swarm"] if one.task.experiment.sources else {}
        return {**swarm, **result["measures"]}

    def _cells(
        self, one: PreparedRun, result: Mapping[str, Any], measures: Mapping[str, float | None]
    ) -> dict[str, str]:
        """What a table has of the run."""
        tags = [robot.tag for robot in one.task.experiment.robots]
        duration_s = float(result["timesteps"] * result["timestep_s"])
        return {
            "duration_s": f"{duration_s:.12g}",
            "robots": str(len(tags)),
            "tags": " ".join(map(str, tags)),
            **{n: "" if v is None else f"{v:.12g}" for n, v in measures.items()},
        }


PACKAGE, ANEW = "package", "anew"
"""Folders of what was unpacked, and of what was made anew."""
_MOST_CONTENTS = 256 << 20


@dataclass(frozen=True, slots=True)
class ReproduceOptions:
    """How a package is made anew.

    Attributes:
        output: a new folder that keeps all; None: nothing stays.
        trusted: code of the package may be compiled and run.
        only_check: nothing is made anew: its checksums are compared.
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
) -> Reproduction:
    """Makes a package anew.

    Args:
        interrupted: set to end it.
        say: takes a line that stays; `show` what is going on.

    Raises:
        Damaged: something in it is not what was packed.
        PackageError: it is no package.
        VsenseError: it cannot be unpacked.
        Interrupted: `interrupted` was set.
    """
    findings = Reproduction()
    with Package(path) as package:
        package.verify(lambda name, share: show(f"checking {100 * share:.0f} %"))
        say(f"{path}: {len(package.names)} files are what was packed")
        try:
            told = PackageContents.read(package.read(CONTENTS, _MOST_CONTENTS), package.names)
        except VsenseError as error:
            raise PackageError(f"{path}: {error}") from None
        if options.only_check:
            findings.same("checksums", f"{len(package.names)} files")
            return findings
        with _folder(options.output) as folder:
            show(f"unpacking {package.size >> 20} MB")
            package.unpack(folder / PACKAGE)
            again = _Again(PackagePlaces(folder / PACKAGE, folder / ANEW), told, findings, options)
            again.make(interrupted, show)
    if any(UNTRUSTED in one.words for one in findings.each):
        findings.notes.append(f"some of it was left alone: {UNTRUSTED}")
    return findings


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
        (output / ANEW).mkdir()
    yield output.resolve()


@dataclass(frozen=True, slots=True)
class _Again:
    """A package that was unpacked, and is made anew."""

    places: PackagePlaces
    told: PackageContents
    findings: Reproduction
    options: ReproduceOptions

    def make(self, interrupted: Flag, show: Callable[[str], None]) -> None:
        """Makes runs and report."""
        told, findings, options = self.told, self.findings, self.options
        if told.version != __version__:
            findings.notes.append(f"vsense was {told.version}, now {__version__}")
        self.places.anew.mkdir(exist_ok=True)
        simulated = [run for run in told.runs if run.mode == "sim"]
        if any(run.recordings for run in simulated):
            require()
        common = self.places, findings, options.trusted, options.jobs
        Simulating(*common, interrupted, show).make(simulated)
        self._recorded(interrupted, show)
        if told.report:
            self._report(show)

    def _recorded(self, interrupted: Flag, show: Callable[[str], None]) -> None:
        """Makes anew what follows from recordings."""
        runs = [run for run in self.told.runs if run.mode != "sim"]
        if not any(run.recordings for run in self.told.runs):
            for run in runs:
                self.findings.cannot(f"{run.title}: readings and poses", NO_RECORDING)
            return
        require()
        from vsense.studies.packages.recordings import RecordedRuns  # these need the extra `record`

        recorded = RecordedRuns(self.places, self.findings, self.options.trusted, interrupted, show)
        for run in runs:
            recorded.make(run)

    def _report(self, show: Callable[[str], None]) -> None:
        """Makes the report again, and compares each of its files."""
        places, findings = self.places, self.findings
        if lacking := figures.cannot():
            findings.cannot(figures.REPORT, lacking)
            return
        into = places.anew / figures.REPORT
        try:
            asked = figures.from_data(self.told.asked)
            tell = lambda text: show(f"report: {text}")  # noqa: E731
            figures.make(places.package, self.told.report, asked, into, tell)
        except VsenseError as error:
            findings.cannot(figures.REPORT, places.public(error))
            return
        before = places.package / figures.REPORT
        names = {path.name for folder in (before, into) for path in folder.iterdir()}
        for name in sorted(names):
            thing = f"{figures.REPORT}/{name}"
            if not (before / name).exists():
                findings.differs(thing, "it is not in the package")
            else:
                findings.judge(thing, comparing.files(before / name, into / name, places.scrubber))
