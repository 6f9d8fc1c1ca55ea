"""The page of a report: one HTML file that holds everything it shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

from vsense.studies.report import Questions, _tables
from vsense.studies.report._charts import few
from vsense.studies.report._compare import Group
from vsense.studies.report._findings import Findings
from vsense.studies.report._markup import Counter, PageFigure, document, note, share_of, tiles, warn
from vsense.studies.report.study import _section
from vsense.studies.report.study._results import StudyResult


@dataclass(frozen=True, slots=True)
class Chapter:
    """One recording: its findings and pictures."""

    findings: Findings
    pictures: Sequence[PageFigure]


@dataclass(frozen=True, slots=True)
class ComparedRuns:
    """The runs of one experiment: their groups, and the pictures."""

    groups: Sequence[Group]
    pictures: Sequence[PageFigure]


@dataclass(frozen=True, slots=True)
class Studied:
    """What tables of runs gave: each study's result and pictures, and what was asked.

    `notes` are sentences about the tables themselves.
    """

    asked: Questions
    studies: Sequence[tuple[StudyResult, Sequence[PageFigure]]]
    notes: Sequence[str] = ()

    @property
    def counts(self) -> tuple[int, int]:
        """How many runs are valid, and how many are not."""
        arms = [arm for result, _ in self.studies for arm in result.study.arms]
        return sum(len(arm.runs) for arm in arms), sum(len(arm.voids) for arm in arms)


def page(
    chapters: Sequence[Chapter],
    comparisons: Sequence[ComparedRuns],
    missing: Sequence[str] = (),
    studied: Studied | None = None,
) -> str:
    """Makes the page of recordings, of comparisons of each experiment's runs, and of studies.

    `missing` says why there are no charts, or no tests.
    """
    counter = Counter()
    many = bool(comparisons) or studied is not None
    voids, count = 0, sum(group.count for comparison in comparisons for group in comparison.groups)
    if studied is not None and not comparisons:
        valid, voids = studied.counts
        count = valid + len(chapters)
    name = _counted(count, voids) if many else chapters[0].findings.label
    parts = [warn(text) for text in missing]
    if many:
        parts.append(_contents(chapters, comparisons, studied))
    if studied is not None:
        parts += _studied(studied, counter)
    for place, comparison in enumerate(comparisons):
        parts.append(_compared(comparison, place, counter))
    for place, chapter in enumerate(chapters):
        if many:
            parts.append(f'<h2 id="run-{place}">{escape(chapter.findings.label)}</h2>\n')
        parts += _run(chapter, counter)
    lead = (
        f"What {'recordings' if chapters else 'runs'} of vsense say. Times are in seconds since a"
        " run began, lengths in metres in the arena's frame."
    )
    return document(name, lead, "".join(parts), "report")


def _counted(count: int, voids: int) -> str:
    if not count:
        return f"{voids} {'run' if voids == 1 else 'runs'}, none is valid"
    words = f"{count} {'run' if count == 1 else 'runs'} compared"
    return f"{words}, {voids} invalid" if voids else words


def _studied(studied: Studied, counter: Counter) -> Iterator[str]:
    for text in studied.notes:
        yield note(text, "warning")
    for place, (result, pictures) in enumerate(studied.studies):
        yield _section.section(result, pictures, counter, place, studied.asked.tests)
    yield _section.methods([result for result, _ in studied.studies], studied.asked)


def _contents(
    chapters: Sequence[Chapter], comparisons: Sequence[ComparedRuns], studied: Studied | None
) -> str:
    links = []
    if studied is not None:
        titles = (result.study.title for result, _ in studied.studies)
        links += [(f"study-{place}", title) for place, title in enumerate(titles)]
        links.append(("methods", "For the methods of a paper"))
    links += [(f"compared-{place}", _title(part.groups)) for place, part in enumerate(comparisons)]
    links += [
        (f"run-{place}", f"{chapter.findings.label} ({chapter.findings.path})")
        for place, chapter in enumerate(chapters)
    ]
    rows = "".join(f'<li><a href="#{to}">{escape(words)}</a></li>' for to, words in links)
    return f"<nav><ul>{rows}</ul></nav>\n"


def _title(groups: Sequence[Group]) -> str:
    kinds = list(dict.fromkeys(group.kind or "runs of unknown kind" for group in groups))
    what = f"{', '.join(kinds[:-1])} and {kinds[-1]}"
    if len(kinds) == 1:
        what = f"runs ({groups[0].kind})" if groups[0].kind else "runs"
    return f"{groups[0].experiment}: {what} compared"


def _compared(comparison: ComparedRuns, place: int, counter: Counter) -> str:
    groups = comparison.groups
    conditions = ", ".join(f"{g.count} {g.condition}" for g in groups)
    title = _title(groups)
    first = " class=first" if place == 0 else ""
    return (
        f'<h2 id="compared-{place}"{first}>{escape(title)}</h2>\n'
        f"<p>Runs: {escape(conditions)}. A run is one value, whatever its robots and timesteps."
        f"{escape(few(groups))}</p>\n{counter.figures(comparison.pictures)}"
        f"<h3>End values</h3>\n{_tables.statistics(groups, counter)}"
        f"<h3>Runs</h3>\n{_tables.runs(groups, counter)}"
    )


def _run(chapter: Chapter, counter: Counter) -> Iterator[str]:
    findings = chapter.findings
    begun = findings.begun
    when = f", recorded {begun:%Y-%m-%d %H:%M} UTC" if begun is not None else ""
    file = f"{findings.path} (vsense {findings.version}{when})"
    yield f'<p class="soft">{escape(file)}</p>\n'
    if findings.gathered.facts.calibration:
        yield f'<p class="soft">Cameras: {escape(findings.gathered.facts.calibration)}.</p>\n'
    yield from _notes(findings)
    yield tiles(_tiles(findings))
    yield counter.figures(chapter.pictures)
    if findings.measures:
        yield f"<h3>Measures</h3>\n{_tables.measures(findings, counter)}"
    if findings.robots:
        yield f"<h3>Robots</h3>\n{_tables.robots(findings, counter)}"
    yield _tables.parts(findings, counter)
    yield f"<h3>Loss and gaps</h3>\n{_tables.incidents(findings, counter)}"
    yield f"<h3>Events</h3>\n{_tables.events(findings, counter)}"
    text = findings.gathered.facts.file_text
    if text:
        yield "<details><summary>The experiment's file</summary>"
        yield f"<pre>{escape(text)}</pre></details>\n"


def _notes(findings: Findings) -> Iterator[str]:
    gathered = findings.gathered
    for words in findings.lacking:
        yield note(f"{words}.", "warning")
    if gathered.odd:
        yield note(f"{gathered.odd} messages could not be understood and are left out.", "warning")
    if gathered.flow.lived and not gathered.ran:
        words = "This recording holds no run: everything shown is from the whole recording."
        yield note(words, "warning")
    if gathered.changes:
        words = (
            f"The world was changed by hand while it ran, {gathered.changes} in all (see Events)"
        )
        yield note(f"{words}: this is not the run of its file alone.", "warning")
    if findings.only_tracked:
        yield note(f"In this recording {findings.only_tracked}.", "warning")
    elif findings.lacks:
        yield note(f"Not in this recording: {', '.join(findings.lacks)}.", "warning")


def _tiles(findings: Findings) -> Iterator[tuple[str, str]]:
    gathered, latency = findings.gathered, findings.latency
    seen = [row.seen for row in findings.robots]
    linked = [row.connected for row in findings.robots if row.connected is not None]
    wanted_s = gathered.facts.length_s
    length = f"{findings.run_s:.1f}" + (
        f" of {wanted_s:g} s" if wanted_s and gathered.ran else " s"
    )
    yield ("run" if gathered.ran else "recorded"), length
    yield "robots", str(len(findings.robots))
    if gathered.flow.lived:
        yield "seen", f"{share_of(sum(seen) / len(seen) if seen else None)} %"
    if linked and not gathered.facts.simulated:
        yield "connected", f"{share_of(sum(linked) / len(linked))} %"
    if latency:
        yield "latency, median", f"{latency['p50_ms']:.3g} ms"
        yield "latency, 99 %", f"{latency['p99_ms']:.3g} ms"
    total = gathered.flow.lived + gathered.flow.missed
    if total and gathered.ran:
        yield "timesteps missed", f"{gathered.flow.missed} of {total}"
    if gathered.late is not None:
        yield "timesteps late", str(gathered.late)
