"""`vsense benchmark`: three fixed missions that qualify a lab, rendered or real."""

from __future__ import annotations

import argparse
import json
import socket
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsense.base.errors import UsageError
from vsense.base.terminal import Console, aligned, interruption, print_data
from vsense.commands import arguments, rosters, series
from vsense.config.roster import Roster
from vsense.monitor import recording
from vsense.monitor.pictures.run_figure import spoken
from vsense.run.runs_csv import MODES
from vsense.studies.benchmark import definition
from vsense.studies.benchmark.definition import Definition
from vsense.studies.report import lacking_tests
from vsense.studies.series import plan as plans
from vsense.studies.series.order import Forecast
from vsense.studies.series.parts import PlannedExperiment
from vsense.studies.series.plan import SeriesPlan

if TYPE_CHECKING:
    from vsense.studies.benchmark.result import Benchmark

DESCRIPTION = (
    "Qualifies a lab, simulated, rendered or real, by three missions that are the same everywhere:"
    " aggregation, foraging and phototaxis, each sighted and blind, in random order and with"
    " repetitions, as `vsense series` makes runs. From these runs it tells latency, how true poses"
    " are, what wheels do and how noisy everything is, and how well each mission went:"
    " benchmark.json and a report. Ctrl-C costs the run that goes on; the same command goes on"
    " from there."
)

_FEWEST = 5
"""Robots without which the missions are others."""
MEASURED = {
    "sim": "wheels; scores of missions. Latency and accuracy are ideal here: a baseline",
    "lab": "latency from exposure to wheels, poses against the truth, wheels, noise; scores",
    "run": "latency from exposure to readings sent, what calibrate check has found, wheels, noise;"
    " scores",
}
"""What is told of the lab itself, by mode."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("--mode", choices=MODES, default="sim", help="where (default: sim)")
    arguments.flag(
        parser, "--dry", "only say what is measured, which runs follow, how long it takes"
    )
    arguments.flag(
        parser, "--quick", "six runs of 6 s with four robots: a first look, comparable with nothing"
    )
    text = f"with so many robots, {_FEWEST} or more: comparable with results of as many"
    arguments.option(parser, "--robots", arguments.positive, "N", f"{text} (default: 15)")
    parser.add_argument(
        "--site", metavar="NAME", help="what results call this lab (default: this machine's name)"
    )
    text = "folder of the runs and of the result (default: vsense-benchmark-1-MODE here)"
    arguments.option(parser, "-o --output", Path, "DIR", text)
    arguments.flag(parser, "--json", "print the result as one JSON object")
    series.add_making(parser)
    never = {"lenient": False, "sources": [], "include": [], "on": None}
    parser.set_defaults(action=None, record=True, record_images=False, locked=True, **never)
    actions = parser.add_subparsers(title="with results", metavar="ACTION", dest="action")
    add = partial(arguments.add_action, actions)
    check = add("check", "check a result against its runs: nothing in it is believed")
    _add_result(check, "file", "the result: benchmark.json, or the folder that it is in")
    compare = add("compare", "compare two labs' results: tests, effect sizes, sameness")
    _add_result(compare, "first", "a result")
    _add_result(compare, "second", "another lab's")
    arguments.flag(compare, "--unpaired", "take runs with the same start for independent ones")
    text = "make a page with figures, in an empty folder"
    arguments.option(compare, "--report", Path, "FOLDER", text)


def _add_result(parser: argparse.ArgumentParser, name: str, text: str) -> None:
    parser.add_argument(name, type=Path, metavar=name.upper(), help=text)
    # Not to write over what stands before the action.
    if not any(action.dest == "json" for action in parser._actions):
        parser.add_argument(
            "--json", action="store_true", default=argparse.SUPPRESS, help="print it as JSON"
        )


def run(options: argparse.Namespace) -> int:
    """Carries the benchmark out, checks a result (1: it does not hold), or compares two."""
    recording.require()
    if options.action == "check":
        return _check(options)
    if options.action == "compare":
        return _compare(options)
    from vsense.studies.benchmark.result import Benchmark

    known = definition.load()
    plan = _plan(options, known)
    roster = _require_robots(options, plan, known)
    loader, planned = series.load(options, plan)
    if plan.mode != "run":
        planned = {name: _without_warnings(one) for name, one in planned.items()}
    path = options.output or Path(f"{plan.name}-{plan.mode}")
    benchmark = Benchmark(known, plan, planned, path, options.quick)
    known.require(benchmark.files.values())
    if options.dry:
        forecast = series.forecast_of(plan, planned, path, options.pace)
        told = _told(benchmark) | forecast.facts()
        print_data(json.dumps(told, indent=2) if options.json else _dry(benchmark, forecast))
        return 0
    for words in benchmark.deviations:
        Console().say(f"{known.name}: {words}", "warning")
    code = series.carry_out(options, loader, planned, path, lambda facts: None)
    return code or _finish(options, benchmark, roster)


def _without_warnings(planned: PlannedExperiment) -> PlannedExperiment:
    """The same, which says nothing of the tags that its robots are given."""
    return replace(planned, experiment=replace(planned.experiment, warnings=()))


def _plan(options: argparse.Namespace, known: Definition) -> SeriesPlan:
    """The plan of the runs, with as many robots as were asked for."""
    plan = plans.read(known.plan(options.quick), options.mode)
    count: int | None = options.robots
    if count is None or count == known.robots:
        return plan
    if options.quick:
        raise UsageError("--robots: --quick has four")
    if not _FEWEST <= count <= known.robots:
        raise UsageError(f"--robots {count}: expected {_FEWEST} to {known.robots}")
    return replace(plan, count=count)


def _require_robots(
    options: argparse.Namespace, plan: SeriesPlan, known: Definition
) -> Roster | None:
    """Reads the roster; UsageError where a real lab has too few robots, before anything starts."""
    real = plan.mode == "run"
    roster = rosters.wanted_roster(options) if real else rosters.roster_of(options, found=False)
    if roster is None:
        return None
    count = known.robots if plan.count is None else plan.count
    ready = sum(robot.is_ready for robot in roster.robots)
    if ready < count:
        fewer = f"; --robots {ready} makes it with these" if ready >= _FEWEST else ""
        others = [f"{robot} is {robot.why_not}" for robot in roster.robots if robot.why_not]
        left = f" ({', '.join(others)})" if others else ""
        raise UsageError(
            f"{roster.path} has {ready} robots that can play{left}, the missions want"
            f" {count}{fewer if not options.quick else ''}"
        )
    return roster


def _finish(options: argparse.Namespace, benchmark: Benchmark, roster: Roster | None) -> int:
    """Makes the result of all runs, and says where it is."""
    from vsense.studies.benchmark import page, result

    console = Console()
    with interruption() as interrupted, interrupted.at_once():
        lab = result.LabSetup(options.site or socket.gethostname(), _setup(options))
        told = result.make(benchmark, lab, roster, console.progress)
        path = result.write(benchmark, told)
        tests = not lacking_tests()
        console.progress("drawing the report")
        studies = result.studies_of(benchmark.definition, benchmark.rows(), tests)
        page_, *_ = page.write(told, studies, benchmark.folder / page.FOLDER)
        console.end_progress()
    if options.json:
        print_data(json.dumps(told, indent=2))
    else:
        print_data("\n".join(_summary(told)))
    console.say(f"result: {path}")
    console.say(f"report: {page_}")
    console.say(f"anyone who has this folder can check it: vsense benchmark check {path}")
    return 0


def _setup(options: argparse.Namespace) -> dict[str, Any]:
    """How the lab was made, or where arena states came from."""
    if options.mode == "sim":
        return {}
    if options.mode == "run":
        tracker = options.tracker
        return {"tracking": "own cameras" if tracker is None else str(tracker)}
    names = ("base", "cameras", "calibrate", "pace", "wheel_errors", "marker_errors")
    told = {name: getattr(options, name) for name in names}
    return {name: value for name, value in told.items() if value not in (None, False)}


def _summary(told: Mapping[str, Any]) -> Iterator[str]:
    """The result in some lines."""
    from vsense.studies.benchmark.comparing import own_figures

    counts = told["counts"]
    yield (
        f"{told['benchmark']}, {told['site']} ({told['mode']}): {counts['valid']} runs,"
        f" {counts['void']} void"
    )
    rows = [("mission", "score", "unit", "sighted", "blind", "sighted is better")]
    for one in told["missions"]:
        medians = (f"{one[arm]['median']:.4g}" for arm in ("sighted", "blind"))
        share = f"{100 * one['sighted_better']:.0f} %"
        rows.append((one["mission"], spoken(one["measure"]), one["unit"], *medians, share))
    yield from aligned(rows, left=3)
    yield from aligned(
        [(name, words) for name, words, value in own_figures(told) if value is not None], left=1
    )


def _told(benchmark: Benchmark) -> dict[str, Any]:
    """What is measured with which missions, for programs."""
    known = benchmark.definition
    return {
        "benchmark": known.name,
        "definition_sha256": known.sha256,
        "robots": benchmark.robots,
        "deviations": benchmark.deviations,
        "missions": [asdict(mission) for mission in known.missions],
    }


def _dry(benchmark: Benchmark, forecast: Forecast) -> str:
    """The same for people, and the runs that follow."""
    known = benchmark.definition
    rows = [("mission", "score of a run", "unit", "better")]
    rows += [(m.name, spoken(m.measure), m.unit, m.better) for m in known.missions]
    words = "; ".join(benchmark.deviations)
    return "\n".join(
        [
            f"{known.name}, definition {known.sha256}{f' ({words})' if words else ''}",
            f"{benchmark.robots} robots; of the same runs: {MEASURED[benchmark.plan.mode]}",
            "",
            *aligned(rows, left=4),
            "",
            forecast.table(),
        ]
    )


def _check(options: argparse.Namespace) -> int:
    from vsense.studies.benchmark import checking

    console = Console()
    with interruption() as interrupted, interrupted.at_once():
        claims = checking.check(options.file, console.progress)
    console.end_progress()
    if options.json:
        print_data(json.dumps(checking.as_json(claims), indent=2))
    else:
        print_data("\n".join(checking.lines(claims)))
    return claims.exit_code


def _compare(options: argparse.Namespace) -> int:
    from vsense.studies.benchmark import comparing, page
    from vsense.studies.report.report import require_empty

    if options.report is not None:
        require_empty(options.report)
    paths = options.first, options.second
    found = comparing.compare(paths, options.unpaired, not lacking_tests())
    console = Console()
    if lacks := lacking_tests():
        console.say(f"vsense: {lacks}")
    if options.report is not None:
        console.say(f"report: {page.write_comparison(found, options.report)[0]}")
    text = json.dumps(found.as_json(), indent=2) if options.json else "\n".join(found.lines())
    print_data(text)
    return 0
