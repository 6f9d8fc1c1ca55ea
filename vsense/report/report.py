"""Makes a report: reads recordings one after the other, draws, and writes the page and charts."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vsense.errors import failing_as
from vsense.recording.form import RecordingError
from vsense.report import campaigns, can_draw, charts, compare, findings, lacking, maps, plot
from vsense.report.campaigns import CampaignRuns
from vsense.report.findings import Findings, read_findings
from vsense.report.markup import Shown
from vsense.report.page import Chapter, ComparedRuns, page

PAGE = "report.html"
PAGE_PX_PER_IN = 128
"""A column of 3.5 inches takes half of the page."""
_MAKERS: Sequence[Callable[[Findings], plot.Drawing | None]] = (
    maps.ways,
    maps.occupancy,
    charts.measures,
    charts.robots,
    charts.latencies,
    charts.latency_over_time,
)


@dataclass(frozen=True, slots=True)
class Report:
    """The written files, the page first, and the findings of each recording.

    `lacking` says why there are no charts, "" where there are.
    """

    files: Sequence[Path]
    findings: Sequence[Findings]
    lacking: str
    campaigns: Sequence[CampaignRuns] = ()

    def as_json(self) -> dict[str, Any]:
        """The figures, for scripts."""
        several = len(self.findings) > 1 or self.campaigns
        groups = compare.groups(self.findings, self.campaigns) if several else []
        return {
            "files": [str(path) for path in self.files],
            "recordings": [findings.as_json(one) for one in self.findings],
            "comparison": compare.as_json(groups),
        }


def make_report(
    paths: Sequence[Path],
    folder: Path,
    progress: Callable[[Path, float], None] = lambda path, share: None,
    form: str = "png",
    sheet: str | None = None,
) -> Report:
    """Makes a report of recordings; without Matplotlib, one without charts.

    Args:
        paths: the recordings, and tables of campaigns, one at least; several are compared.
        folder: where to; made if need be, must be empty.
        progress: takes now and then which share of a recording was read, 0..1.
        form: of the charts' files, one of `FORMATS`; the page holds PNG.
        sheet: the user's style sheet, see `plot.styled`.

    Raises:
        RecordingError: one is no recording that can be read, the folder is not empty, or something
            cannot be written.
        UsageError: there is no such style sheet, or it cannot be used.
        VsenseError: the charts cannot be drawn in this style.
    """
    require_empty(folder)
    if sheet is not None and can_draw():
        plot.require_sheet(sheet)
    # A table that is named twice has no more runs.
    tables = {os.path.realpath(path): path for path in paths if path.suffix == campaigns.SUFFIX}
    simulated = [some for path in tables.values() for some in campaigns.read_campaign(path)]
    read = [
        read_findings(path, lambda share, path=path: progress(path, share))  # type: ignore[misc]
        for path in paths
        if path.suffix != campaigns.SUFFIX
    ]
    with failing_as(RecordingError, f"{folder}: cannot be written"):
        folder.mkdir(parents=True, exist_ok=True)
        if not can_draw():
            return _write(read, simulated, _Charts(folder, ""))
        with plot.styled(sheet):
            return _write(read, simulated, _Charts(folder, form))


def require_empty(folder: Path) -> None:
    """Raises RecordingError if a report cannot be put into a folder."""
    with failing_as(RecordingError, f"{folder}: cannot be read"):
        taken = folder.exists() and (not folder.is_dir() or any(folder.iterdir()))
    if taken:
        raise RecordingError(f"{folder}: is there already; expected a new or an empty folder")


class _Charts:
    """Writes charts of a form into a folder; "": there are no charts. `files` are all written."""

    def __init__(self, folder: Path, form: str) -> None:
        self.folder, self.form = folder, form
        self.files: list[Path] = []

    def keep(self, prefix: str, drawings: Iterable[plot.Drawing]) -> list[Shown]:
        """Writes charts, and gives them for the page; none without a form."""
        return [self._keep(prefix, each) for each in drawings] if self.form else []

    def _keep(self, prefix: str, drawing: plot.Drawing) -> Shown:
        png = plot.encode(drawing.figure, "png")
        path = self.folder / f"{prefix}{drawing.name}.{self.form}"
        path.write_bytes(png if self.form == "png" else plot.encode(drawing.figure, self.form))
        self.files.append(path)
        width_px = round(drawing.figure.get_size_inches()[0] * PAGE_PX_PER_IN)
        return Shown(drawing.title, drawing.caption, png, width_px, drawing.wide)


def _write(read: Sequence[Findings], simulated: Sequence[CampaignRuns], kept: _Charts) -> Report:
    comparisons = []
    if len(read) > 1 or simulated:
        experiments = compare.by_experiment(compare.groups(read, simulated)).values()
        for place, members in enumerate(experiments, start=1):
            prefix = "compared-" if len(experiments) == 1 else f"compared-{place}-"
            comparisons.append(ComparedRuns(members, kept.keep(prefix, charts.compared(members))))
    chapters = []
    for place, one in enumerate(read, start=1):
        prefix = f"{place:02d}-{one.path.stem}-" if comparisons else ""
        made = (make(one) for make in _MAKERS)
        chapters.append(Chapter(one, kept.keep(prefix, (each for each in made if each))))
    why_none = "" if kept.form else lacking()
    path = kept.folder / PAGE
    path.write_text(page(chapters, comparisons, why_none), encoding="utf-8", errors="replace")
    return Report([path, *kept.files], read, why_none, simulated)
