"""`vsense report`: recordings as charts, one page, and numbers."""

from __future__ import annotations

import argparse
import json
from contextlib import suppress
from pathlib import Path

from vsense.base import errors
from vsense.base.terminal import Console, print_data
from vsense.commands import _arguments
from vsense.monitor import recording
from vsense.studies.report import FORMATS, Questions

DESCRIPTION = (
    "Makes report.html, one page that holds everything it shows, and its charts as PNG, SVG or PDF:"
    " trajectories, occupancy, the experiment's measures, robots seen and connected, latency, loss"
    " and gaps. Several recordings are compared as well, each experiment's runs with virtual"
    " sensors with those without, and simulated runs with those of the lab and of real robots."
    " Tables of runs (runs.csv, and those of vsense sim --runs) become figures, tests, effect sizes"
    " and a paragraph for a paper: the run is the unit. Nothing is written over."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    text = (
        "the recordings (.mcap), or folders of runs that hold some; tables of runs (.csv), or"
        " the folder that they are in"
    )
    _arguments.many(parser, "files", Path, "FILE", text)
    text = (
        "folder for the report, made if need be, else empty (default: FILE without .mcap and"
        " with -report; of several: report)"
    )
    _arguments.option(parser, "-o --output", Path, "FOLDER", text)
    add_charts(parser)
    _arguments.flag(parser, "--json", "print the figures as JSON")
    add_questions(parser)


def add_charts(parser: argparse.ArgumentParser) -> None:
    """Declares how charts are drawn and kept."""
    group = parser.add_argument_group("charts")
    _arguments.choice(group, "--format", FORMATS, "of their files (default: png)")
    text = "a Matplotlib style sheet (.mplstyle), or the name of one; a matplotlibrc counts, too"
    _arguments.option(group, "--style", str, "FILE_OR_NAME", text)


def check_charts(options: argparse.Namespace) -> None:
    """Refuses what `add_charts` declares where nothing is there that draws."""
    if options.format or options.style:
        errors.require("charts need", "matplotlib")


def add_questions(parser: argparse.ArgumentParser) -> None:
    """Declares what can be asked of tables of runs."""
    group = parser.add_argument_group("tables of runs")
    text = (
        "columns whose values are compared, such as mode or start; runs that differ in"
        " experiment, mode or condition are else kept apart (default: condition)"
    )
    _arguments.option(group, "--by", _columns, "COLUMN[,COLUMN]", text)
    text = "compare all others with this one (default: each with each)"
    _arguments.option(group, "--against", str, "CONDITION", text)
    text = "only this measure, named before anybody has looked; several: repeat it"
    _arguments.repeated(group, "--measure", str, "NAME", text)
    text = (
        "test whether conditions are the same: whether the means of a measure differ by less"
        " than a margin that you chose before you saw the runs"
    )
    _arguments.repeated(group, "--same", _margin, "MEASURE=MARGIN", text)
    _arguments.flag(group, "--unpaired", "take runs with the same start for independent ones")
    text = (
        f"of the bootstrap: the same runs and seed give the same page (default: {Questions().seed})"
    )
    _arguments.option(group, "--seed", _arguments.natural, "N", text)


def _columns(text: str) -> list[str]:
    return [word.strip() for word in text.split(",")]


def _margin(text: str) -> tuple[str, float]:
    name, _, number = text.rpartition("=")
    with suppress(ValueError):
        if name and 0.0 < float(number) < float("inf"):
            return name, float(number)
    raise argparse.ArgumentTypeError(
        f"{text!r}: expected MEASURE=MARGIN with a margin above 0 in the measure's unit"
    )


def run(options: argparse.Namespace) -> int:
    """Makes the report; see `vsense.studies.report.report`."""
    recording.require()
    check_charts(options)
    from vsense.studies.report.report import ReportOptions, report

    asked = {name: getattr(options, name) for name in ("by", "against", "measure", "same", "seed")}
    named = [f"--{name}" for name, value in asked.items() if value not in (None, [])]
    named += ["--unpaired"] if options.unpaired else []
    how = ReportOptions(
        options.output, options.format or "png", options.style, questions_of(options), named
    )
    written = report(options.files, how, Console())
    print_data(json.dumps(written.as_json(), indent=1) if options.json else written.in_words())
    return 0


def questions_of(options: argparse.Namespace) -> Questions:
    """What is asked of tables, as `add_questions` declares it; UsageError: SciPy is needed."""
    if options.same:
        errors.require("statistical tests need", "scipy")
    plain = Questions()
    return Questions(
        by=options.by or plain.by,
        independent=options.unpaired,
        seed=plain.seed if options.seed is None else options.seed,
        margins=dict(options.same),
        only=options.measure,
        against=options.against or "",
    )
