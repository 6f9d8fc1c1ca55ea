"""`vsense report`: recordings as charts, one page, and numbers."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from vsense.base.errors import UsageError
from vsense.base.terminal import Console
from vsense.commands import arguments
from vsense.monitor import recording
from vsense.studies.report.study import BY, SEED, SUFFIX

if TYPE_CHECKING:
    from vsense.studies.report.study.results import Questions

DESCRIPTION = (
    "Makes report.html, one page that holds everything it shows, and its charts as PNG, SVG or PDF:"
    " trajectories, occupancy, the experiment's measures, robots seen and connected, latency, loss"
    " and gaps. Several recordings are compared as well, each experiment's sighted runs with its"
    " blind ones, and simulated runs with those of the lab and of real robots. Tables of runs"
    " (runs.csv, and those of vsense sim --runs) become figures, tests, effect sizes and a"
    " paragraph for a paper: the run is the unit. Nothing is written over."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument(
        "files",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="the recordings (.mcap), or folders of runs that hold some; tables of runs (.csv), or"
        " the folder that they are in",
    )
    text = (
        "folder for the report, made if need be, else empty (default: FILE without .mcap and"
        " with -report; of several: report)"
    )
    arguments.option(parser, "-o --output", Path, "FOLDER", text)
    arguments.add_charts(parser)
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    add_questions(parser)


def add_questions(parser: argparse.ArgumentParser) -> None:
    """Declares what can be asked of tables of runs."""
    group = parser.add_argument_group("tables of runs")
    text = (
        "columns whose values are compared, such as mode or start; runs that differ in"
        " experiment, mode or condition are else kept apart (default: condition)"
    )
    arguments.option(group, "--by", _columns, "COLUMN[,COLUMN]", text)
    text = "compare all others with this one (default: each with each)"
    arguments.option(group, "--against", str, "CONDITION", text)
    group.add_argument(
        "--measure",
        action="append",
        default=[],
        metavar="NAME",
        help="only this measure, named before anybody has looked; several: repeat it",
    )
    group.add_argument(
        "--same",
        type=_margin,
        action="append",
        default=[],
        metavar="MEASURE=MARGIN",
        help="test whether conditions are the same: whether the means of a measure differ by less"
        " than a margin that you chose before you saw the runs",
    )
    arguments.flag(group, "--unpaired", "take runs with the same start for independent ones")
    text = f"of the bootstrap: the same runs and seed give the same page (default: {SEED})"
    arguments.option(group, "--seed", arguments.natural, "N", text)


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
    files = [file for path in options.files for file in _files_of(path)]
    asked = _asked(options, files)
    if any(file.suffix != SUFFIX for file in files):
        recording.require()
    from vsense.studies.report.report import make_report

    alone = files[0].with_name(f"{files[0].stem}-report")
    folder = options.output or (alone if len(files) == 1 else Path("report"))
    console = Console()
    made = make_report(
        files,
        folder,
        lambda path, share: console.progress(f"reading {path}: {100 * share:.0f} %"),
        options.format or "png",
        options.style,
        asked,
        lambda text: console.progress(f"computing {text}"),
    )
    console.end_progress()
    for text in (*made.missing, *made.notes):
        console.say(f"vsense: {text}")
    for one in made.findings:
        if not one.complete:
            console.say(f"vsense: {one.path} was cut off: its last second may be missing")
        if one.damaged:
            console.say(f"vsense: {one.damaged} parts of {one.path} are damaged")
        if one.only_tracked:
            console.say(f"vsense: {one.path}: {one.only_tracked}")
        if not one.gathered.ran:
            console.say(f"vsense: {one.path} holds no run: all of it is shown")
    if options.json:
        print(json.dumps(made.as_json(), indent=1))
    else:
        print(f"{made.files[0]}: {len(made.files) - 1} charts beside it")
    return 0


def _asked(options: argparse.Namespace, files: Sequence[Path]) -> Questions:
    """What is asked of the tables; UsageError where something is, and there are none."""
    told = {name: getattr(options, name) for name in ("by", "against", "measure", "same", "seed")}
    named = [f"--{name}" for name, value in told.items() if value not in (None, [])]
    named += ["--unpaired"] if options.unpaired else []
    if named and not any(file.suffix == SUFFIX for file in files):
        raise UsageError(f"{', '.join(named)}: tables of runs (.csv) only, and none is named")
    return questions_of(options)


def questions_of(options: argparse.Namespace) -> Questions:
    """What is asked of tables, as `add_questions` declares it."""
    from vsense.studies.report.study.results import Questions

    return Questions(
        by=options.by or BY,
        independent=options.unpaired,
        seed=SEED if options.seed is None else options.seed,
        margins=dict(options.same),
        only=options.measure,
        against=options.against or "",
    )


def _files_of(path: Path) -> list[Path]:
    """The recordings, or the tables of runs, that a path means; raises as `files_of`.

    A folder of runs has a runs.csv beside its recordings, which show more.
    """
    from vsense.run.runs_csv import RUNS
    from vsense.studies.report.study.collect import tables_in

    if not path.is_dir() or not (tables := tables_in(path)):
        return recording.files_of(path)
    if all(table.name == RUNS for table in tables):
        with suppress(UsageError):
            return recording.files_of(path)
    return tables
