"""`vsense doctor`: what this machine lacks for what, and the command that mends it."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict

from vsense.base.terminal import aligned, print_data
from vsense.commands import _arguments
from vsense.tools.doctor.checks import BROKEN, LACKS, Finding, findings
from vsense.tools.doctor.versions import versions

DESCRIPTION = (
    "Looks at compilers, libraries, extras, ports, socket buffers, the clock and permissions, and"
    " says what is missing for what, with the command that mends it. Nothing is changed. Exit code"
    " 1: not even vsense sim and vsense lab can run."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    _arguments.flag(parser, "--json", "print the findings as one JSON object")


def run(options: argparse.Namespace) -> int:
    """Looks and says what was found; 0, or 1 where nothing can be simulated."""
    found, installed = list(findings()), versions()
    if options.json:
        rows = [asdict(one) for one in found]
        print_data(json.dumps({"versions": installed, "findings": rows}, indent=2))
    else:
        print_data(", ".join(" ".join(pair) for pair in installed.items()))
        print_data("\n".join(table(found)))
    return int(any(one.state == BROKEN for one in found))


def table(found: Sequence[Finding]) -> list[str]:
    """The findings as lines for people: what is lacking with its command below it."""
    rows = aligned([(one.name, one.state, one.text) for one in found])
    lines = [""]
    for row, one in zip(rows, found):
        lines.append(row)
        if one.mend:
            lines.append(f"    {one.mend}")
    lacking = sum(one.state in (LACKS, BROKEN) for one in found)
    end = f"{lacking} things are lacking" if lacking > 1 else "one thing is lacking"
    return [*lines, "", f"{end}, see above" if lacking else "nothing is lacking"]
