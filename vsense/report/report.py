"""Makes a report: reads recordings one after the other, draws, and writes the page and pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vsense.recording.form import RecordingError
from vsense.report import (
    compare,
    compare_pictures,
    findings,
    occupancy_picture,
    time_pictures,
    way_picture,
)
from vsense.report.findings import Findings, read_findings
from vsense.report.markup import encode
from vsense.report.page import Chapter, ComparedRuns, Drawn, page
from vsense.report.picture import Figure

PAGE = "report.html"
_MAKERS: Sequence[Callable[[Findings], Figure | None]] = (
    way_picture.ways,
    occupancy_picture.occupancy,
    time_pictures.measures,
    time_pictures.robots,
    time_pictures.latencies,
    time_pictures.latency_over_time,
)


@dataclass(frozen=True, slots=True)
class Report:
    """What was made.

    Attributes:
        files: everything written, the page first.
        findings: what each recording says.
    """

    files: Sequence[Path]
    findings: Sequence[Findings]

    def as_json(self) -> dict[str, Any]:
        """The figures, for scripts."""
        groups = compare.groups(self.findings) if len(self.findings) > 1 else []
        return {
            "files": [str(path) for path in self.files],
            "recordings": [findings.as_json(one) for one in self.findings],
            "comparison": compare.as_json(groups),
        }


def make_report(
    paths: Sequence[Path],
    folder: Path,
    progress: Callable[[Path, float], None] = lambda path, share: None,
) -> Report:
    """Makes a report of recordings.

    Args:
        paths: the recordings, one at least; several are compared.
        folder: where to; made if need be, must be empty.
        progress: is told now and then which share of a recording was read, 0..1.

    Raises:
        RecordingError: one is no recording that can be read, the folder is not empty, or something
            cannot be written.
    """
    require_empty(folder)
    read = [
        read_findings(path, lambda share, path=path: progress(path, share))  # type: ignore[misc]
        for path in paths
    ]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return _write(read, folder)
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be written: {error.strerror}") from None


def require_empty(folder: Path) -> None:
    """Looks whether a report can be put into a folder.

    Raises:
        RecordingError: something is there already.
    """
    try:
        taken = folder.exists() and (not folder.is_dir() or any(folder.iterdir()))
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be read: {error.strerror}") from None
    if taken:
        raise RecordingError(f"{folder}: is there already; expected a new or an empty folder")


def _write(read: Sequence[Findings], folder: Path) -> Report:
    files = [folder / PAGE]

    def keep(prefix: str, pictures: Iterable[Figure]) -> list[Drawn]:
        drawn = [(picture, encode(picture)) for picture in pictures]
        for picture, png in drawn:
            path = folder / f"{prefix}{picture.name}.png"
            path.write_bytes(png)
            files.append(path)
        return drawn

    comparisons = []
    if len(read) > 1:
        experiments = compare.by_experiment(compare.groups(read)).values()
        for place, members in enumerate(experiments, start=1):
            prefix = "compared-" if len(experiments) == 1 else f"compared-{place}-"
            drawn = keep(prefix, compare_pictures.draw(members))
            comparisons.append(ComparedRuns(members, drawn))
    chapters = []
    for place, one in enumerate(read, start=1):
        prefix = f"{place:02d}-{one.path.stem}-" if len(read) > 1 else ""
        made = (make(one) for make in _MAKERS)
        pictures = [picture for picture in made if picture is not None]
        chapters.append(Chapter(one, keep(prefix, pictures)))
    files[0].write_text(page(chapters, comparisons), encoding="utf-8", errors="replace")
    return Report(files, read)
