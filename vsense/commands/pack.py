"""`vsense pack`: runs and all that they were made from, in one file for others."""

from __future__ import annotations

import argparse
import json
import re
from dataclasses import asdict
from pathlib import Path

from vsense.base.errors import UsageError
from vsense.base.terminal import Console, interruption, print_data
from vsense.commands import arguments, report
from vsense.monitor.recording import megabytes
from vsense.studies.packages import crate
from vsense.studies.packages.pack import PackedFiles, PackOptions, pack

DESCRIPTION = (
    "Packs runs for others: experiments, plan, controllers, calibrations, roster, seeds, versions,"
    " tables, recordings, a report and checksums, described as an RO-Crate 1.1. vsense reproduce"
    " makes all of it again. Keys, addresses, accounts and paths are left out or replaced, and"
    " named. The same runs give the same bytes."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument(
        "runs",
        type=Path,
        nargs="+",
        metavar="RUNS",
        help="the folder of a series or of runs, or a table of runs (.csv)",
    )
    text = "the package, a new file (default: as the first RUNS, with .zip)"
    arguments.option(parser, "-o --output", Path, "FILE", text)
    arguments.flag(
        parser, "--pictures", "with the cameras' pictures and videos, which may be gigabytes"
    )
    arguments.flag(parser, "--no-report", "without a report")
    arguments.flag(parser, "--json", "print what was packed as one JSON object")
    group = parser.add_argument_group("what is said of it")
    arguments.option(group, "--name", str, "TEXT", "its title (default: the names of its runs)")
    arguments.option(group, "--about", str, "TEXT", "what it is, in a few sentences")
    group.add_argument(
        "--author",
        type=_person,
        action="append",
        default=[],
        metavar="NAME",
        help="who made it: 'NAME' or 'NAME <ORCID iD>'; several: repeat it",
    )
    arguments.option(
        group, "--license", _license, "NAME", "its licence: a name such as CC-BY-4.0, or an address"
    )
    arguments.option(
        group, "--date", _date, "YYYY-MM-DD", "its day (default: that of its newest run)"
    )
    report.add_questions(parser)


def run(options: argparse.Namespace) -> int:
    """Packs; 0."""
    first = options.runs[0]
    stem = first.stem if first.suffix == ".csv" else first.resolve().name
    target = options.output or Path(f"{stem}.zip")
    if target.suffix != ".zip":
        raise UsageError(f"-o {target}: expected a name that ends in .zip")
    asked = None if options.no_report else report.questions_of(options)
    wanted = PackOptions(
        options.name or "",
        options.about or "",
        options.author,
        options.license or "",
        options.date or "",
        options.pictures,
        asked,
    )
    console = Console()
    with interruption() as interrupted, interrupted.at_once():
        made = pack(options.runs, target, wanted, console.progress)
    console.end_progress()
    _say(console, made, target)
    if options.json:
        told = {"package": str(target), "bytes": target.stat().st_size, **asdict(made)}
        print_data(json.dumps(told, indent=2))
    return 0


def _say(console: Console, made: PackedFiles, target: Path) -> None:
    """Says what was packed, what stayed out, and what cannot be made again."""
    size = megabytes(target.stat().st_size)
    console.say(f"{target}: {made.runs} runs, {made.files} files, {size}")
    for what, count in made.left_out.items():
        console.say(f"left out or replaced: {what} ({count})")
    if made.pictures_bytes > 0:
        console.say(f"--pictures would add about {megabytes(made.pictures_bytes)}")
    for words in made.lacks:
        console.say(f"lacking: {words}", "warning")


def _person(text: str) -> crate.Person:
    try:
        return crate.person(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _license(text: str) -> str:
    try:
        return crate.license_of(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _date(text: str) -> str:
    if re.fullmatch(r"\d{4}-(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])", text) is None:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a day such as 2026-11-24")
    return text
