"""Makes a report: reads recordings one after the other, draws, and writes the page and charts."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError, failing_as
from vsense.base.terminal import Console
from vsense.monitor import recording
from vsense.monitor.recording.form import RecordingError
from vsense.studies.report import (
    Questions,
    _charts,
    _compare,
    _maps,
    _plot,
    can_draw,
    lacking,
    lacking_tests,
)
from vsense.studies.report import _findings as findings
from vsense.studies.report._compare import CampaignRuns, campaign_runs
from vsense.studies.report._findings import Findings, read_findings
from vsense.studies.report._markup import PageFigure
from vsense.studies.report._page import Chapter, ComparedRuns, Studied, page
from vsense.studies.report.study import _results, _section, _words
from vsense.studies.report.study._collect import TABLE_SUFFIX, TableOfRuns, files_of, read_tables
from vsense.studies.report.study._results import StudyResult

REPORT_PAGE = "report.html"
PAGE_PX_PER_IN = 128
"""A column of 3.5 inches takes half of the page."""
_MAKERS: Sequence[Callable[[Findings], _plot.Drawing | None]] = (
    _maps.ways,
    _maps.occupancy,
    _charts.measures,
    _charts.robots,
    _charts.latencies,
    _charts.latency_over_time,
)


@dataclass(frozen=True, slots=True)
class Report:
    """The written files, the page first, and the findings of each recording.

    `missing` says why there are no charts, or no tests; `notes` what is to be said of tables.
    """

    files: Sequence[Path]
    findings: Sequence[Findings]
    missing: Sequence[str]
    tables: Sequence[TableOfRuns] = ()
    studied: Studied | None = None

    @property
    def notes(self) -> Sequence[str]:
        """What is to be said of the tables themselves."""
        return () if self.studied is None else self.studied.notes

    def warnings(self) -> Iterator[str]:
        """What is missing, and what is to be said of tables and of damaged recordings."""
        yield from self.missing
        yield from self.notes
        for run in self.findings:
            yield from run.lacking
            if run.only_tracked:
                yield f"{run.path}: {run.only_tracked}"
            if not run.gathered.ran:
                yield f"{run.path} holds no run: all of it is shown"

    def in_words(self) -> str:
        """Where it is, for people."""
        return f"{self.files[0]}: {len(self.files) - 1} charts beside it"

    def as_json(self) -> dict[str, Any]:
        """The figures, for scripts."""
        groups = _compared(self.findings, self.tables)
        data: dict[str, Any] = {
            "files": [str(path) for path in self.files],
            "recordings": [findings.as_json(run) for run in self.findings],
            "comparison": _compare.as_json(groups),
        }
        if self.studied is not None:
            studies = [result for result, _ in self.studied.studies]
            data["seed"] = self.studied.asked.seed
            data["told"] = [*self.missing, *self.notes]
            data["studies"] = [_results.as_json(result) for result in studies]
            data["methods"] = _words.methods(studies, self.studied.asked)
        return data


@dataclass(frozen=True, slots=True)
class ReportOptions:
    """How a report is made.

    Attributes:
        output: its folder; None: beside the file with -report, of several files: report.
        form, style: as `form` and `sheet` of `make_report`.
        asked: what is asked of tables of runs.
        for_tables: options that were named and that only tables of runs understand.
    """

    output: Path | None = None
    form: str = "png"
    style: str | None = None
    asked: Questions | None = None
    for_tables: Sequence[str] = ()


def report(paths: Sequence[Path], options: ReportOptions, console: Console) -> Report:
    """Makes the report of recordings, tables of runs, and of folders that hold some.

    Says on the console what it does, and the report's warnings.

    Raises:
        UsageError: a folder holds none, something is asked of tables and there are none, or a
            package is missing; else as `make_report`, as which it raises what else there is.
    """
    files = [file for path in paths for file in files_of(path)]
    if options.for_tables and not any(file.suffix == TABLE_SUFFIX for file in files):
        named = ", ".join(options.for_tables)
        raise UsageError(f"{named}: tables of runs (.csv) only, and none is named")
    if any(file.suffix != TABLE_SUFFIX for file in files):
        recording.require()
    alone = files[0].with_name(f"{files[0].stem}-report")
    written = make_report(
        files,
        options.output or (alone if len(files) == 1 else Path("report")),
        lambda path, share: console.progress(f"reading {path}: {100 * share:.0f} %"),
        options.form,
        options.style,
        options.asked,
        lambda text: console.progress(f"computing {text}"),
    )
    console.end_progress()
    for text in written.warnings():
        console.say(f"vsense: {text}")
    return written


def make_report(
    paths: Sequence[Path],
    folder: Path,
    progress: Callable[[Path, float], None] = lambda path, share: None,
    form: str = "png",
    sheet: str | None = None,
    asked: Questions | None = None,
    show: Callable[[str], None] = lambda text: None,
) -> Report:
    """Makes a report of recordings; without Matplotlib, one without charts.

    Args:
        paths: the recordings, and tables of runs, one at least; several are compared.
        folder: where to; made if need be, must be empty.
        progress, show: take which share of a recording was read, 0..1, and what is computed.
        form: of the charts' files, one of `FORMATS`; the page holds PNG.
        sheet: the user's style sheet, see `plot.styled`.
        asked: what is asked of the tables' runs; None: what is always asked.

    Raises:
        RecordingError: one is no recording that can be read, the folder is not empty, or something
            cannot be written.
        UsageError: a style sheet or a table cannot be used, or has not what is asked of it.
        VsenseError: the charts cannot be drawn in this style.
    """
    require_empty(folder)
    _plot.require_sheet(sheet)
    tables = read_tables(path for path in paths if path.suffix == TABLE_SUFFIX)
    rows = [row for table in tables for row in table.rows]
    asked = replace(asked or Questions(), tests=not lacking_tests())
    studies = _results.results_of(rows, asked, show), asked
    read = [
        read_findings(path, lambda share, path=path: progress(path, share))  # type: ignore[misc]
        for path in paths
        if path.suffix != TABLE_SUFFIX
    ]
    with charts_in(folder, form, sheet) as charts:
        return _write(read, tables, studies, charts)


def require_empty(folder: Path) -> None:
    """Raises RecordingError if a report cannot be put into a folder."""
    with failing_as(RecordingError, f"{folder}: cannot be read"):
        taken = os.path.exists(folder) and (not os.path.isdir(folder) or any(folder.iterdir()))
    if taken:
        raise RecordingError(f"{folder}: is there already; expected a new or an empty folder")


class Charts:
    """Writes charts of a form into a folder; "": there are no charts. `files` are all written."""

    def __init__(self, folder: Path, form: str) -> None:
        self.folder, self.form = folder, form
        self.files: list[Path] = []

    def keep(self, prefix: str, drawings: Iterable[_plot.Drawing]) -> list[PageFigure]:
        """Writes charts, and gives them for the page; none without a form."""
        return [self._keep(prefix, drawing) for drawing in drawings] if self.form else []

    def _keep(self, prefix: str, drawing: _plot.Drawing) -> PageFigure:
        png = _plot.encode(drawing.figure, "png")
        path = self.folder / f"{prefix}{drawing.name}.{self.form}"
        path.write_bytes(png if self.form == "png" else _plot.encode(drawing.figure, self.form))
        self.files.append(path)
        width_px = round(drawing.figure.get_size_inches()[0] * PAGE_PX_PER_IN)
        return PageFigure(drawing.title, drawing.caption, png, width_px, drawing.wide)


@contextmanager
def charts_in(folder: Path, form: str = "png", sheet: str | None = None) -> Iterator[Charts]:
    """Makes a report's folder if need be, and draws in a style as far as Matplotlib is there.

    Raises:
        RecordingError: something cannot be written.
    """
    with failing_as(RecordingError, f"{folder}: cannot be written"):
        folder.mkdir(parents=True, exist_ok=True)
        with _plot.styled(sheet) if can_draw() else nullcontext():
            yield Charts(folder, form if can_draw() else "")


def _compared(read: Sequence[Findings], tables: Sequence[TableOfRuns]) -> list[_compare.Group]:
    """Recordings beside each other, and beside tables; tables alone are studies.

    A run of which both its recording and its row are here is one run, and none if it is void.
    """
    recorded = {run.path.absolute().parent for run in read}
    remaining, void = [], set[Path]()
    for table in tables:
        folder = table.path.absolute().parent
        remaining.append(
            replace(table, rows=[r for r in table.rows if folder / r.run not in recorded])
        )
        void |= {folder / row.run for row in table.rows if not row.valid}
    read = [run for run in read if run.path.absolute().parent not in void]
    if not read or len(read) + sum(bool(table.rows) for table in remaining) < 2:
        return []
    campaigns: list[CampaignRuns] = [runs for table in remaining for runs in campaign_runs(table)]
    return _compare.groups(read, campaigns)


def _write(
    read: Sequence[Findings],
    tables: Sequence[TableOfRuns],
    studies: tuple[Sequence[StudyResult], Questions],
    charts: Charts,
) -> Report:
    studied = _studied(tables, *studies, charts) if tables else None
    comparisons = []
    experiments = _compare.by_experiment(_compared(read, tables)).values()
    for place, members in enumerate(experiments, start=1):
        prefix = "compared-" if len(experiments) == 1 else f"compared-{place}-"
        comparisons.append(ComparedRuns(members, charts.keep(prefix, _charts.compared(members))))
    chapters = []
    for place, run in enumerate(read, start=1):
        prefix = f"{place:02d}-{run.path.stem}-" if comparisons else ""
        figures = (make(run) for make in _MAKERS)
        chapters.append(Chapter(run, charts.keep(prefix, (figure for figure in figures if figure))))
    told = lacking(), lacking_tests() if studied is not None else ""
    missing = [text for text in told if text]
    path = charts.folder / REPORT_PAGE
    text = page(chapters, comparisons, missing, studied)
    path.write_text(text, encoding="utf-8", errors="replace")
    return Report([path, *charts.files], read, missing, tables, studied)


def _studied(
    tables: Sequence[TableOfRuns], results: Sequence[StudyResult], asked: Questions, charts: Charts
) -> Studied:
    drawn = []
    for place, result in enumerate(results, start=1):
        prefix = "runs-" if len(results) == 1 else f"runs-{place}-"
        drawn.append((result, charts.keep("", _section.boxes(result, prefix))))
    repeated = [table for table in tables if table.repeated]
    notes = [
        f"{table.repeated} of the runs in {table.path} are named twice, and count once."
        for table in repeated
    ]
    return Studied(asked, drawn, notes)
