"""The benchmark of a lab: planned, carried out, reported; results checked and compared."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, aligned, spoken
from vsense.config.roster import Roster, find_roster, require_roster
from vsense.studies.benchmark import _checking, _comparing, _definition, _page, _result
from vsense.studies.benchmark._definition import Definition
from vsense.studies.benchmark._result import Benchmark, LabSetup
from vsense.studies.report import lacking_tests
from vsense.studies.report.report import require_empty
from vsense.studies.series import _plan as plans
from vsense.studies.series._plan import SeriesPlan
from vsense.studies.series.run import PlannedSeries, SeriesOptions

FEWEST_ROBOTS = 5
"""Robots without which the missions are others."""
MEASURED = {
    "sim": "wheels; scores of missions. Latency and accuracy are ideal here: a baseline",
    "lab": "latency from exposure to wheels, poses against the truth, wheels, noise; scores",
    "run": "latency from exposure to readings sent, what calibrate check has found, wheels, noise;"
    " scores",
}
"""What is told of the lab itself, by mode."""


@dataclass(frozen=True, slots=True)
class BenchmarkOptions:
    """What of the benchmark is carried out.

    Attributes:
        mode: where, of `MODES`.
        quick: a first look, comparable with nothing.
        robots: so many; None: as the definition has it.
        site: what results call this lab; None: the machine's name.
        output: folder of the runs and of the result; None: one here.
        wheel_errors, marker_errors: what robots of the lab differ in, as results have it.
        series: how runs are made; the output is taken from here.
    """

    mode: str = "sim"
    quick: bool = False
    robots: int | None = None
    site: str | None = None
    output: Path | None = None
    wheel_errors: float = 0.0
    marker_errors: tuple[float, float] = (0.0, 0.0)
    series: SeriesOptions = field(default_factory=SeriesOptions)


@dataclass(frozen=True, slots=True)
class BenchmarkAnswer:
    """What a benchmark, a check or a comparison gives: for scripts, and for people."""

    facts: Mapping[str, Any]
    lines: Sequence[str]
    exit_code: int = 0


class PlannedBenchmark:
    """A benchmark whose missions are loaded and checked."""

    def __init__(self, options: BenchmarkOptions) -> None:
        """Loads everything.

        Raises:
            UsageError: options do not go together, or a real lab has too few robots.
            VsenseError: something cannot be loaded, or is not as the definition has it.
        """
        self._options = options
        self._definition = definition = _definition.load()
        plan = _plan(options, definition)
        self._roster = _require_robots(options, plan, definition)
        path = options.output or Path(f"{plan.name}-{plan.mode}")
        how = replace(options.series, output=path, command="benchmark")
        self._series = PlannedSeries(plan, how)
        if plan.mode != "run":
            self._series.silence()  # of the tags that its robots are given
        self._benchmark = Benchmark(
            definition, plan, self._series.by_condition, path, options.quick
        )
        definition.require(self._benchmark.files.values())

    def described(self) -> BenchmarkAnswer:
        """What is measured with which missions, and the runs that follow."""
        benchmark, definition, forecast = self._benchmark, self._definition, self._series.forecast()
        facts = {
            "benchmark": definition.name,
            "definition_sha256": definition.sha256,
            "robots": benchmark.robots,
            "deviations": benchmark.deviations,
            "missions": [asdict(mission) for mission in definition.missions],
        }
        rows = [("mission", "score of a run", "unit", "better")]
        rows += [(m.name, spoken(m.measure), m.unit, m.better) for m in definition.missions]
        words = "; ".join(benchmark.deviations)
        lines = [
            f"{definition.name}, definition {definition.sha256}{f' ({words})' if words else ''}",
            f"{benchmark.robots} robots; of the same runs: {MEASURED[benchmark.plan.mode]}",
            "",
            *aligned(rows, left=4),
            "",
            forecast.table(),
        ]
        return BenchmarkAnswer(facts | forecast.facts(), lines)

    def carry_out(self) -> BenchmarkAnswer | int:
        """Makes the runs that are missing, then the result of all.

        Returns:
            The result; where runs are still missing only the exit code, as
            `PlannedSeries.carry_out`.
        """
        console = Console()
        for words in self._benchmark.deviations:
            console.say(f"{self._definition.name}: {words}", "warning")
        return self._series.carry_out() or self._finish(console)

    def _finish(self, console: Console) -> BenchmarkAnswer:
        """Makes the result of all runs, and says where it is."""
        options, benchmark = self._options, self._benchmark
        with interruption() as interrupted, interrupted.at_once():
            lab = LabSetup(options.site or socket.gethostname(), _setup(options))
            facts = _result.make(benchmark, lab, self._roster, console.progress)
            path = _result.write(benchmark, facts)
            console.progress("drawing the report")
            tests = not lacking_tests()
            studies = _result.studies_of(benchmark.definition, benchmark.rows(), tests)
            report, *_ = _page.write(facts, studies, benchmark.folder / _page.REPORT_FOLDER)
            console.end_progress()
        console.say(f"result: {path}")
        console.say(f"report: {report}")
        console.say(f"anyone who has this folder can check it: vsense benchmark check {path}")
        return BenchmarkAnswer(facts, list(_summary(facts)))


def check(path: Path) -> BenchmarkAnswer:
    """Checks a result against its runs; exit code 1 where it does not hold.

    Raises:
        UsageError: there is no result that can be read.
        VsenseError: the missions of this vsense cannot be loaded.
        CutShort: it was interrupted.
    """
    console = Console()
    with interruption() as interrupted, interrupted.at_once():
        claims = _checking.check(path, console.progress)
    console.end_progress()
    lines = list(_checking.lines(claims))
    return BenchmarkAnswer(_checking.as_json(claims), lines, claims.exit_code)


def compare(
    first: Path, second: Path, unpaired: bool = False, report: Path | None = None
) -> BenchmarkAnswer:
    """Compares two results.

    Args:
        unpaired: runs with the same start are taken for independent ones.
        report: an empty folder for a page with figures; None: there is none.

    Raises:
        UsageError: one cannot be read, or they cannot be compared.
        RecordingError: the report cannot be written.
    """
    if report is not None:
        require_empty(report)
    console, lacks = Console(), lacking_tests()
    compared = _comparing.compare((first, second), unpaired, not lacks)
    if lacks:
        console.say(f"vsense: {lacks}")
    if report is not None:
        console.say(f"report: {_page.write_comparison(compared, report)[0]}")
    return BenchmarkAnswer(compared.as_json(), list(compared.lines()))


def _plan(options: BenchmarkOptions, definition: Definition) -> SeriesPlan:
    """The plan of the runs, with as many robots as were asked for."""
    plan, count = plans.read(definition.plan(options.quick), options.mode), options.robots
    if options.quick and count is not None:
        raise UsageError("--robots: --quick has four")
    if count is None or count == definition.robots:
        return plan
    if not FEWEST_ROBOTS <= count <= definition.robots:
        raise UsageError(f"--robots {count}: expected {FEWEST_ROBOTS} to {definition.robots}")
    return replace(plan, count=count)


def _require_robots(
    options: BenchmarkOptions, plan: SeriesPlan, definition: Definition
) -> Roster | None:
    """Reads the roster; UsageError where a real lab has too few robots, before anything starts."""
    path, real = options.series.roster, plan.mode == "run"
    roster = require_roster(path) if real else find_roster(path, here=False)
    if roster is None:
        return None
    count = definition.robots if plan.count is None else plan.count
    ready = sum(robot.is_ready for robot in roster.robots)
    if ready < count:
        fewer = f"; --robots {ready} makes it with these" if ready >= FEWEST_ROBOTS else ""
        unready = [f"{robot} is {robot.why_not}" for robot in roster.robots if robot.why_not]
        left = f" ({', '.join(unready)})" if unready else ""
        raise UsageError(
            f"{roster.path} has {ready} robots that can play{left}, the missions want"
            f" {count}{fewer if not options.quick else ''}"
        )
    return roster


def _setup(options: BenchmarkOptions) -> dict[str, Any]:
    """How the lab was made, or where arena states came from."""
    if options.mode == "sim":
        return {}
    lab, tracker = options.series.lab, options.series.link.tracker
    if options.mode == "run":
        return {"tracking": "own cameras" if tracker is None else str(tracker)}
    values = {name: getattr(lab, name) for name in ("base", "cameras", "calibrate", "pace")}
    values |= {name: getattr(options, name) for name in ("wheel_errors", "marker_errors")}
    return {name: value for name, value in values.items() if value not in (None, False)}


def _summary(facts: Mapping[str, Any]) -> Iterator[str]:
    """The result in some lines."""
    counts = facts["counts"]
    yield (
        f"{facts['benchmark']}, {facts['site']} ({facts['mode']}): {counts['valid']} runs,"
        f" {counts['void']} invalid"
    )
    rows = [("mission", "score", "unit", "with sensors", "without", "with is better")]
    for mission in facts["missions"]:
        medians = (f"{mission[arm]['median']:.4g}" for arm in ("sighted", "blind"))
        share = f"{100 * mission['sighted_better']:.0f} %"
        name = spoken(mission["measure"])
        rows.append((mission["mission"], name, mission["unit"], *medians, share))
    yield from aligned(rows, left=3)
    figures = _comparing.own_figures(facts)
    yield from aligned(
        [(name, words) for name, words, value in figures if value is not None], left=1
    )
