"""`vsense pack`: runs and all that they were made from, in one file for others."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from vsense.base.errors import UsageError
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, print_data
from vsense.commands import _arguments, report
from vsense.studies.packages.pack import PackOptions, pack

DESCRIPTION = (
    "Packs runs for others: experiments, plan, controllers, calibrations, roster, seeds, versions,"
    " tables, recordings, a report and checksums, described as an RO-Crate 1.1. vsense reproduce"
    " makes all of it again. Keys, addresses, accounts and paths are left out or replaced, and"
    " named. The same runs give the same bytes."
)

_PICTURES = (
    "with the cameras' pictures, which may be gigabytes; outside of the arena they are painted over"
)
_UNMASKED = (
    "with --pictures: as they are, with the people who walk around the arena; and videos, and the"
    " pictures of real runs"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    text = "the folder of a series or of runs, or a table of runs (.csv)"
    _arguments.many(parser, "runs", Path, "RUNS", text)
    text = "the package, a new file (default: as the first RUNS, with .zip)"
    _arguments.option(parser, "-o --output", Path, "FILE", text)
    _arguments.flag(parser, "--pictures", _PICTURES)
    _arguments.flag(parser, "--unmasked", _UNMASKED)
    _arguments.flag(parser, "--no-report", "without a report")
    _arguments.flag(parser, "--json", "print what was packed as one JSON object")
    group = parser.add_argument_group("what is said of it")
    _arguments.option(group, "--name", str, "TEXT", "its title (default: the names of its runs)")
    _arguments.option(group, "--about", str, "TEXT", "what it is, in a few sentences")
    text = "who made it: 'NAME' or 'NAME <ORCID iD>'; several: repeat it"
    _arguments.repeated(group, "--author", _arguments.parsed(PackOptions.author), "NAME", text)
    licence = _arguments.parsed(PackOptions.license_of)
    text = "its licence: a name such as CC-BY-4.0, or an address"
    _arguments.option(group, "--license", licence, "NAME", text)
    _arguments.option(
        group, "--date", _date, "YYYY-MM-DD", "its day (default: that of its newest run)"
    )
    report.add_questions(parser)


def run(options: argparse.Namespace) -> int:
    """Packs; 0."""
    if options.unmasked and not options.pictures:
        raise UsageError("--unmasked belongs to --pictures")
    wanted = PackOptions(
        options.output,
        options.name or "",
        options.about or "",
        options.author,
        options.license or "",
        options.date or "",
        options.pictures,
        options.unmasked,
        None if options.no_report else report.questions_of(options),
    )
    console = Console()
    with interruption() as interrupted, interrupted.at_once():
        packed = pack(options.runs, wanted, console.progress)
    console.end_progress()
    for words in packed.lines():
        console.say(words)
    for words in packed.lacks:
        console.say(f"missing: {words}", "warning")
    if options.json:
        print_data(json.dumps(packed.as_json(), indent=2))
    return 0


def _date(text: str) -> str:
    pattern = r"\d{4}-(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])"
    return _arguments.matched(pattern, text, "a day such as 2026-11-24").string
