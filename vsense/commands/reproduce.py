"""`vsense reproduce`: everything in a package made again, and compared."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

from vsense.base.errors import Interrupted
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, print_data
from vsense.commands import _arguments
from vsense.studies.packages.reproduce import ReproduceOptions, reproduce

DESCRIPTION = (
    "Makes a package of vsense pack again and says for each thing whether it is the same, what"
    " differs, or why it cannot be made again. First all checksums are compared. Then simulated"
    " runs are simulated again, recordings of the lab and of real robots tracked and sensed again,"
    " and tables and figures made of them. Exit code: 0 when all is the same in every bit, 1 when"
    " something differs, 3 when something could not be made again."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("package", type=Path, help="the package (.zip)")
    text = "a new folder for what is unpacked and made again (default: nothing stays)"
    _arguments.option(parser, "-o --output", Path, "FOLDER", text)
    text = (
        "compile and run code of the package: controllers and loop functions are programs of"
        " its author, and can do what you can"
    )
    _arguments.flag(parser, "--trust", text)
    _arguments.flag(parser, "--check", "only compare the checksums")
    _arguments.flag(parser, "--json", "print what was found as one JSON object")
    text = "simulated runs at the same time (default: one per processor)"
    _arguments.option(parser, "-j --jobs", _arguments.positive, "N", text)


def run(options: argparse.Namespace) -> int:
    """Makes a package again; for the exit code see `DESCRIPTION`, or 130 after Ctrl-C."""
    console = Console()
    jobs = options.jobs or len(os.sched_getaffinity(0))
    wanted = ReproduceOptions(options.output, options.trust, options.check, jobs)
    with interruption() as interrupted:
        try:
            claims = reproduce(options.package, wanted, interrupted, console.say, console.progress)
        except Interrupted:
            console.end_progress()
            return interrupted.code
    console.end_progress()
    if options.json:
        print_data(json.dumps(claims.as_json(), indent=2))
    else:
        print_data("\n".join(claims.lines()))
    return claims.exit_code
