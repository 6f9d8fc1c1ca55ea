"""`vsense doctor`: what this machine lacks for what, and the command that mends it."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict

from vsense.base.terminal import print_data
from vsense.commands import _arguments
from vsense.tools.doctor.checks import BROKEN, findings, table, versions

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
    all_findings, installed = list(findings()), versions()
    if options.json:
        rows = [asdict(finding) for finding in all_findings]
        print_data(json.dumps({"versions": installed, "findings": rows}, indent=2))
    else:
        print_data(", ".join(" ".join(pair) for pair in installed.items()))
        print_data("\n".join(table(all_findings)))
    return int(any(finding.state == BROKEN for finding in all_findings))
