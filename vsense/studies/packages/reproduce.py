"""Makes everything in a package anew, and says what is the same: checksums first, then runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from vsense import __version__
from vsense.base.errors import VsenseError, failing_as
from vsense.modes.sim.watch import Flag
from vsense.monitor.recording import require
from vsense.studies.packages import comparing, figures
from vsense.studies.packages.archive import Package, PackageError
from vsense.studies.packages.contents import CONTENTS, NO_RECORDING, PackageContents
from vsense.studies.packages.findings import Reproduction
from vsense.studies.packages.places import UNTRUSTED, PackagePlaces
from vsense.studies.packages.simulating import Simulating

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
        from vsense.studies.packages.recorded import RecordedRuns  # these need the extra `record`

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
