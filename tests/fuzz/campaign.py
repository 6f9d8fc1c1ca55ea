"""Runs the fuzzers, C and Python, each for a while, and prints a table: `scripts/bench fuzz`.

Exit code 1 where there is a finding: its file, or the command that makes the case again, is named.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict

from tests.fuzz import c_targets
from tests.fuzz.c_targets import BUILT, BuildFailed, Outcome
from tests.fuzz.rooms import ROOMS
from tests.fuzz.running import run_room

_DEFAULT_S = 20.0
_COLUMNS = ("target", "executions", "per second", "coverage", "findings")


def _arguments(words: Sequence[str] | None) -> argparse.Namespace:
    known = ", ".join([*c_targets.names(), *ROOMS])
    parser = argparse.ArgumentParser(prog="scripts/bench fuzz", description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"all, or some of: {known}")
    parser.add_argument(
        "--seconds", type=float, default=_DEFAULT_S, help="for each target (default: 20)"
    )
    parser.add_argument("--runs", type=int, help="executions of each target, in place of --seconds")
    parser.add_argument("--seed", type=int, help="of the first case (default: drawn)")
    parser.add_argument("--case", type=int, help="of a Python target: this one case alone, once")
    parser.add_argument("--minimise", action="store_true", help="update the C corpora in the tree")
    parser.add_argument("--json", action="store_true", help="print JSON in place of the table")
    options = parser.parse_args(words)
    for name in options.targets:
        if name not in ROOMS and name not in c_targets.names():
            parser.error(f"no target {name!r}; known are {known}")
    if options.case is not None and (options.seed is None or len(options.targets) != 1):
        parser.error("--case: expected --seed and one Python target beside it")
    return options


def _table(outcomes: Sequence[Outcome]) -> str:
    rows = [_COLUMNS]
    for one in outcomes:
        rate = one.executions / one.seconds if one.seconds > 0 else 0.0
        coverage = "-" if one.coverage is None else str(one.coverage)
        found = str(len(one.findings))
        rows.append((one.name, f"{one.executions:,}", f"{rate:,.0f}", coverage, found))
    total = sum(one.executions for one in outcomes)
    rows.append(("all", f"{total:,}", "", "", str(sum(len(one.findings) for one in outcomes))))
    widths = [max(len(row[place]) for row in rows) for place in range(len(_COLUMNS))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if place == 0 else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths))
        )
        for row in rows
    )


def _note(outcome: Outcome) -> None:
    """Adds to the sum of all campaigns of this checkout."""
    BUILT.mkdir(parents=True, exist_ok=True)
    with (BUILT / "sum.jsonl").open("a") as file:
        file.write(json.dumps({"at_s": round(time.time()), **asdict(outcome)}) + "\n")


def main(words: Sequence[str] | None = None) -> int:
    """Runs what the words of the command line say; gives the exit code."""
    options = _arguments(words)
    seed = options.seed if options.seed is not None else int.from_bytes(os.urandom(4), "big")
    wanted = options.targets or [*c_targets.names(), *ROOMS]
    if options.case is not None:
        return 1 if run_room(wanted[0], seed, options.case, 1, None, loud=True).findings else 0
    outcomes = []
    try:
        programs = c_targets.build([name for name in wanted if name not in ROOMS])
    except BuildFailed as error:
        print(f"scripts/bench fuzz: {error}", file=sys.stderr)
        return 1
    for name in wanted:
        print(f"{name} ...", end="\r", file=sys.stderr, flush=True)
        began_s = time.monotonic()
        if name in ROOMS:
            seconds = None if options.runs is not None else options.seconds
            outcome = run_room(name, seed, 0, options.runs, seconds)
        elif options.minimise:
            count = c_targets.minimise(name, programs[name])
            outcome = Outcome(name, count, time.monotonic() - began_s, None, ())
        else:
            outcome = c_targets.run(name, programs[name], options.seconds, options.runs, seed)
        if not options.minimise:
            _note(outcome)
        outcomes.append(outcome)
        for finding in outcome.findings:
            print(f"{name}: finding: {finding}", file=sys.stderr)
    if options.json:
        print(json.dumps([asdict(one) for one in outcomes]))
    else:
        print(_table(outcomes))
    return 1 if any(one.findings for one in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
