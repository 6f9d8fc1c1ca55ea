"""`vsense benchmark`: three fixed missions that qualify a lab, rendered or real."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from vsense.base.terminal import print_data
from vsense.commands import _arguments, series
from vsense.monitor import recording
from vsense.run.runs_csv import MODES

if TYPE_CHECKING:
    from vsense.studies.benchmark.benchmark import BenchmarkAnswer

DESCRIPTION = (
    "Qualifies a lab, simulated, rendered or real, by three missions that are the same everywhere:"
    " aggregation, foraging and phototaxis, each with and without virtual sensors, in random order"
    " and with repetitions, as `vsense series` makes runs. From these runs it computes latency, how"
    " true poses are, what wheels do and how noisy everything is, and how well each mission went:"
    " benchmark.json and a report. Ctrl-C costs the run that goes on; the same command goes on"
    " from there."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    _arguments.choice(parser, "--mode", MODES, "where (default: sim)", "sim")
    _arguments.flag(
        parser, "--dry", "only say what is measured, which runs follow, how long it takes"
    )
    _arguments.flag(
        parser, "--quick", "six runs of 6 s with four robots: a first look, comparable with nothing"
    )
    text = "with so many robots, 5 or more: comparable with results of as many"
    _arguments.option(parser, "--robots", _arguments.positive, "N", f"{text} (default: 15)")
    text = "what results call this lab (default: this machine's name)"
    _arguments.option(parser, "--site", str, "NAME", text)
    text = "folder of the runs and of the result (default: vsense-benchmark-1-MODE here)"
    _arguments.option(parser, "-o --output", Path, "DIR", text)
    _arguments.flag(parser, "--json", "print the result as one JSON object")
    series.add_making(parser)
    never = {"lenient": False, "sources": [], "include": [], "on": None}
    parser.set_defaults(action=None, record=True, record_images=False, locked=True, **never)
    actions = parser.add_subparsers(title="with results", metavar="ACTION", dest="action")
    add = partial(_arguments.add_action, actions)
    check = add("check", "check a result against its runs: nothing in it is believed")
    _add_result(check, "file", "the result: benchmark.json, or the folder that it is in")
    compare = add("compare", "compare two labs' results: tests, effect sizes, sameness")
    _add_result(compare, "first", "a result")
    _add_result(compare, "second", "another lab's")
    _arguments.flag(compare, "--unpaired", "take runs with the same start for independent ones")
    text = "make a page with figures, in an empty folder"
    _arguments.option(compare, "--report", Path, "FOLDER", text)


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
    from vsense.studies.benchmark import benchmark

    if options.action == "check":
        return _give(options, benchmark.check(options.file))
    if options.action == "compare":
        pair = options.first, options.second
        return _give(options, benchmark.compare(*pair, options.unpaired, options.report))
    how = series.options_of(options, options.mode, None)
    planned = benchmark.PlannedBenchmark(
        _arguments.fill(benchmark.BenchmarkOptions, options, series=replace(how, json=False))
    )
    if options.dry:
        return _give(options, planned.described())
    answer = planned.carry_out()
    return answer if isinstance(answer, int) else _give(options, answer)


def _give(options: argparse.Namespace, answer: BenchmarkAnswer) -> int:
    text = json.dumps(answer.facts, indent=2) if options.json else "\n".join(answer.lines)
    print_data(text)
    return answer.exit_code
