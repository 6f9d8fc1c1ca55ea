"""Makes a package: gathers runs, leaves out who and where, makes the report, describes it all."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from vsense import __version__
from vsense.base.errors import UsageError, VsenseError, failing_as
from vsense.base.files import read_bytes
from vsense.base.terminal import counted
from vsense.modes import origin
from vsense.monitor.recording import MCAP, megabytes, require
from vsense.run.runs_csv import utc
from vsense.studies.packages import _archive, _crate, _figures, _kinds
from vsense.studies.packages import _contents as contents
from vsense.studies.packages._archive import MANIFEST, PackageError
from vsense.studies.packages._contents import CONTENTS, PackageContents, PackedRun
from vsense.studies.packages._crate import Described, Person, Title
from vsense.studies.packages._gathering import FoundRun, FoundSeries, gather
from vsense.studies.packages._kinds import FileKind
from vsense.studies.packages._places import OWN_FOLDERS, PACKAGE_MARK, Scrubber, folders_of
from vsense.studies.report import Questions

README = "README.md"
_MOST_TEXT = 1 << 30
_TEXTS = ("text", "paths", "roster")


@dataclass(frozen=True, slots=True)
class PackOptions:
    """What is packed, and what is said of it.

    Attributes:
        output: the package, a new file whose name ends in .zip; None: called after the first runs.
        name, about: of the package, for people; "": made of its runs.
        authors, license: who made it, and the licence's address; "": not said.
        date: its day, as ISO 8601; "": that of its last run.
        pictures: the cameras' pictures go in, painted over outside of the arena.
        unmasked: they go in as they are, and with them what cannot be painted over, as videos.
        asked: what the report asks of tables; None: there is no report.
    """

    output: Path | None = None
    name: str = ""
    about: str = ""
    authors: Sequence[Person] = ()
    license: str = ""
    date: str = ""
    pictures: bool = False
    unmasked: bool = False
    asked: Questions | None = field(default_factory=Questions)

    author = staticmethod(_crate.person)
    """Reads "NAME" or "NAME <ORCID>"; raises as `crate.person`."""
    license_of = staticmethod(_crate.license_of)
    """The address of a licence; raises as `crate.license_of`."""

    def target(self, runs: Path) -> Path:
        """The package of runs; UsageError: its name does not end in .zip."""
        stem = runs.stem if runs.suffix == ".csv" else runs.resolve().name
        target = self.output or Path(f"{stem}.zip")
        if target.suffix != ".zip":
            raise UsageError(f"-o {target}: expected a name that ends in .zip")
        return target


@dataclass(slots=True)
class PackedFiles:
    """What was packed.

    Attributes:
        package: the file.
        runs, files, size: how many, and their bytes, unpacked.
        lacks: what cannot be made again, and why.
        left_out: what was replaced or left out, and how often.
        pictures_bytes: of what pictures would add.
    """

    package: Path
    runs: int
    files: int
    size: int
    lacks: Sequence[str]
    left_out: dict[str, int]
    pictures_bytes: int

    def as_json(self) -> dict[str, Any]:
        """All of it, for scripts."""
        file = {"package": str(self.package), "bytes": self.package.stat().st_size}
        return {**file, **asdict(self), **file}

    def lines(self) -> Iterator[str]:
        """What was packed, and what was left out, for people."""
        size = megabytes(self.package.stat().st_size)
        yield f"{self.package}: {counted(self.runs, 'run')}, {self.files} files, {size}"
        for what, count in self.left_out.items():
            yield f"left out or replaced: {what} ({count})"
        if self.pictures_bytes > 0:
            yield f"--pictures would add about {megabytes(self.pictures_bytes)}"


def pack(
    paths: Sequence[Path],
    options: PackOptions,
    show: Callable[[str], None] = lambda text: None,
) -> PackedFiles:
    """Makes a package of runs.

    Args:
        paths: folders of series and of runs, tables of runs.
        show: takes what is going on.

    Raises:
        UsageError: as `PackOptions.target`.
        VsenseError: something is no run, cannot be read or written, or there is a file already.
    """
    if os.path.exists(target := options.target(paths[0])):
        raise PackageError(f"{target}: is there already; expected a new file")
    all_series = gather(paths)
    with TemporaryDirectory(prefix="vsense-pack-") as folder:
        packing = Packing(Path(folder), options, all_series, show)
        packing.add_all()
        _archive.write(target, packing.entries, lambda name, share: show(f"writing {name}"))
        return packing.result(target)


class Packing:
    """A package that is being made; `entries` are its files."""

    def __init__(
        self,
        stage: Path,
        options: PackOptions,
        all_series: Sequence[FoundSeries],
        show: Callable[[str], None],
    ) -> None:
        self.entries: dict[str, bytes | Path] = {}
        self._stage, self._options, self._series, self._show = stage, options, all_series, show
        self._origins: dict[Path, tuple[str, origin.RunOrigin]] = {}
        self._described: list[Described] = []
        self._lacks: list[str] = []
        self._out = Counter[str]()
        self._pictures_bytes = 0
        self._runs: list[PackedRun] = []
        self._title = _title(options, all_series)
        self._scrubber = Scrubber(self._moved())

    def add_all(self) -> None:
        """Adds everything."""
        for path, (name, source) in self._origins.items():
            self._add_origin(path, name, source)
        for series in self._series:
            self._add_series(series)
        report = self._add_report()
        counts = {**self._scrubber.counts, **+self._out}
        contents = PackageContents(
            __version__,
            self._runs,
            report,
            {} if self._options.asked is None else _figures.to_data(self._options.asked),
            self._lacks,
            counts,
        )
        self._put(CONTENTS, contents.to_bytes(), "Contents", "What vsense reproduces.", _kinds.JSON)
        text = _crate.readme(self._title.name, contents, self._series)
        self._put(README, text.encode(), "Read me", "What this is.", "text/markdown")
        self._describe()

    def result(self, package: Path) -> PackedFiles:
        """What was packed into a file."""
        size = sum(
            len(source) if isinstance(source, bytes) else source.stat().st_size
            for source in self.entries.values()
        )
        out = {**self._scrubber.counts, **+self._out}
        runs, files, more = len(self._runs), len(self.entries), self._pictures_bytes
        return PackedFiles(package, runs, files, size, self._lacks, out, more)

    def _moved(self) -> list[tuple[str, str]]:
        """Paths, and what they are in the package; reads what runs were made from."""
        pairs = [(str(path), name) for name, path in OWN_FOLDERS.items()]
        for series in self._series:
            for _, path in series.origins:
                if path not in self._origins:
                    source = origin.read(path)
                    name = f"{series.name}/sources-{origin.digest(source.files)}"
                    self._origins[path] = name, source
            pairs.append((str(series.folder.resolve()), f"{PACKAGE_MARK}/{series.name}"))
        for name, source in self._origins.values():
            users = [n for n in source.files if not n.startswith(origin.PACKAGE_PREFIX)]
            named = ((f"{PACKAGE_MARK}/{name}/{n}", source.paths[n]) for n in users)
            pairs += folders_of(named).items()
        return pairs

    def _add_origin(self, path: Path, name: str, source: origin.RunOrigin) -> None:
        for file, data in source.files.items():
            packed_name = f"{name}/{file}"
            self._add(packed_name, data, _kinds.of_source(file), packed_name.rpartition("/")[0])
        facts = {
            "mode": source.mode,
            "machine": dict(source.machine),
            "about": dict(source.about),
            "setups": self._scrubber.setup(dict(source.setups)),
        }
        text = f"{json.dumps(facts, indent=1)}\n".encode()
        about = "How runs were set up, and by which versions and machine."
        self._put(f"{name}/{contents.SETUP_FILE}", text, "Set-up", about, _kinds.JSON)

    def _add_series(self, series: FoundSeries) -> None:
        folders = {run.folder for run in series.runs}
        if series.folder not in folders:
            self._add_files(series, series.files)
        for run in series.runs:
            self._add_run(series, run)
        if not series.origins:
            self._lacks.append(
                f"{series.name}: what its runs were made from was not kept"
                " (by a vsense before packages): simulated runs cannot be made again"
            )

    def _add_run(self, series: FoundSeries, run: FoundRun) -> None:
        where = "" if run.folder is None else self._place(series, run)
        if run.folder is not None:
            files = sorted(path for path in run.folder.rglob("*") if os.path.isfile(path))
            inner = [path for path in files if not series.is_of_other(path, run)]
            self._add_files(series, inner, where, run.folder, run.facts.mode == "run")
        for name, path in run.files.items():
            self._add(f"{series.name}/{name}", path, _kind(name), "")
        recordings = [self._name(series, run, path) for path in run.recordings]
        origin_path = series.origin_of(run)
        name, source = self._origins[origin_path] if origin_path is not None else ("", None)
        packed = PackedRun(
            series=series.name,
            name=run.name,
            mode=run.facts.mode,
            seed=run.facts.seed,
            table=f"{series.name}/{series.table.name}" if series.table is not None else "",
            row=run.row,
            folder=where,
            sources=name,
            key="" if source is None else run.key_in(source),
            recordings=tuple(name for name in recordings if name in self.entries),
        )
        self._runs.append(packed)
        if run.facts.mode != "sim" and not packed.recordings:
            self._lacks.append(f"{packed.title}: no recording (--record)")
        if run.facts.mode == "sim" and source is not None and not packed.key:
            self._lacks.append(f"{packed.title}: its settings were not kept")

    def _place(self, series: FoundSeries, run: FoundRun) -> str:
        assert run.folder is not None
        inside = run.folder.relative_to(series.folder).as_posix()
        return series.name if inside == "." else f"{series.name}/{inside}"

    def _name(self, series: FoundSeries, run: FoundRun, path: Path) -> str:
        for name, file in run.files.items():
            if file == path:
                return f"{series.name}/{name}"
        return f"{self._place(series, run)}/{path.name}"

    def _add_files(
        self,
        series: FoundSeries,
        files: Sequence[Path],
        where: str = "",
        folder: Path | None = None,
        real: bool = False,
    ) -> None:
        """Adds files of several runs, or of the run in `folder`; a `real` one's PNG show people."""
        base, place = folder or series.folder, where or series.name
        for path in files:
            name = path.relative_to(base).as_posix()
            kind = _kinds.of_runs(name) if base == series.folder else _kinds.of_run(name)
            if path == series.table:
                kind = _kinds.table(name)
            packed_name = f"{place}/{name}"
            if kind is None or path.is_symlink() or _archive.wrong_name(packed_name):
                if not _kinds.is_passed_over(name):
                    self._leave_out("files of other kinds, such as keys and robots' logs")
            elif (kind.large or (real and kind.media == _kinds.PNG)) and not self._options.unmasked:
                self._leave_out("videos, and pictures of real runs (--unmasked)")
            else:
                self._add(packed_name, path, kind, place)

    def _add(self, name: str, source: bytes | Path, kind: FileKind, beside: str) -> None:
        """Adds a file as its kind has it; texts relative to the folder `beside`."""
        if name in self.entries:
            return
        with failing_as(PackageError, f"{source if isinstance(source, Path) else name}"):
            if kind.scrub == "recording":
                assert isinstance(source, Path)
                source = self._copied(name, source)
            elif kind.scrub in _TEXTS:
                data = source if isinstance(source, bytes) else read_bytes(source, _MOST_TEXT)
                source = self._cleaned(data, kind, beside)
        self._put(name, source, kind.name, kind.about, kind.media)

    def _cleaned(self, data: bytes, kind: FileKind, beside: str) -> bytes:
        text = data.decode("utf-8", "surrogateescape")
        if kind.scrub == "roster":
            text = self._scrubber.roster(text)
        elif kind.scrub == "paths":
            text = self._scrubber.paths(text)
        else:
            text = self._scrubber.text(text, beside if kind.media == _kinds.XML else "")
        return text.encode("utf-8", "surrogateescape")

    def _copied(self, name: str, path: Path) -> Path:
        require()
        from vsense.studies.packages import _recordings as recordings

        into = self._stage / f"{len(self.entries)}{MCAP}"
        show = lambda share: self._show(f"copying {path}: {100 * share:.0f} %")  # noqa: E731
        kept = self._options.pictures, not self._options.unmasked
        copied = recordings.copy(path, into, self._scrubber, kept, show)
        self._leave_out("pictures, painted over outside of the arena (--unmasked)", copied.painted)
        if copied.left_out:
            self._leave_out("recordings' pictures (--pictures)")
            self._pictures_bytes += path.stat().st_size - into.stat().st_size
        self._lacks += [f"{name}: {words}" for words in copied.lacks]
        return into

    def _add_report(self) -> list[str]:
        """Makes the report of what is packed; gives the names of what it is of."""
        asked = self._options.asked
        tables = list(dict.fromkeys(run.table for run in self._runs if run.table))
        files = [*tables, *(name for run in self._runs for name in run.recordings)]
        if asked is None or not files:
            return []
        if missing := _figures.cannot():
            self._lacks.append(f"report: {missing}")
            return []
        root = self._stage / "package"
        for name in files:
            path, source = root / name, self.entries[name]
            path.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(source, Path):
                path.symlink_to(source)
            else:
                path.write_bytes(source)
        try:
            show = lambda text: self._show(f"report: {text}")  # noqa: E731
            drawn = _figures.make(root, files, asked, self._stage / _figures.REPORT_PREFIX, show)
        except VsenseError as error:
            self._lacks.append(f"report: {error}".replace(f"{root}/", ""))
            return []
        for path in drawn:
            name, media = _kinds.REPORT_KINDS.get(path.suffix, ("Figure", _kinds.BINARY))
            about = "Made of the package's own tables and recordings."
            self._put(f"{_figures.REPORT_PREFIX}/{path.name}", path, name, about, media)
        return files

    def _describe(self) -> None:
        sums = _archive.entries_digests((d.name, self.entries[d.name]) for d in self._described)
        described = [
            replace(d, sha256=sums[d.name][0], size=sums[d.name][1]) for d in self._described
        ]
        data = _crate.describe(self._title, described, dict(self._origins.values()), self._series)
        self.entries[_crate.METADATA] = data
        digests = {name: sum for name, (sum, _) in sums.items()}
        digests[_crate.METADATA] = _archive.digest_of(data)[0]
        self.entries[MANIFEST] = _archive.manifest_of(digests)

    def _put(self, name: str, source: bytes | Path, title: str, about: str, media: str) -> None:
        self.entries[name] = source
        self._described.append(Described(name, title, about, media))

    def _leave_out(self, what: str, count: int = 1) -> None:
        self._out[what] += count


def _title(options: PackOptions, all_series: Sequence[FoundSeries]) -> Title:
    """What is said of the package, as far as nobody says it: names and numbers of its runs."""
    names = ", ".join(series.name for series in all_series)
    facts = [run.facts for series in all_series for run in series.runs]
    experiments = ", ".join(sorted({row.experiment for row in facts if row.experiment}))
    about = f"{counted(len(facts), 'run')} of {experiments}, with all that they were made from."
    began = max((row.began for row in facts), default="")
    files = [path for series in all_series for path in (series.table, *series.files) if path]
    newest_s = max((path.stat().st_mtime for path in files), default=0.0)
    date = options.date or (began or utc(newest_s))[:10]
    return Title(options.name or names, options.about or about, options.authors,
                 options.license, date)  # fmt: skip


def _kind(name: str) -> FileKind:
    kind = _kinds.of_run(name.rpartition("/")[2])
    assert kind is not None
    return kind
