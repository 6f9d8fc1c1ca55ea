"""`vsense compare`: a new controller against an old one, for a pull request."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.terminal import Console, print_data
from vsense.commands import _arguments, _experiments, report, sim
from vsense.studies.report import lacking
from vsense.studies.series.compare import MOST_PAIRS, compare

DESCRIPTION = (
    "Says whether a swarm still does as well as before: simulates an old and a new controller with"
    " the same seeds, pair after pair, until the difference of a measure is clear, and ends with 0"
    " where the new one is better or not worse by more than a margin, 1 where it is worse, 3 where"
    " that is not clear after all pairs. OLD may be a revision of Git: main: is NEW as main has it."
    " A wrong verdict comes up in some 2.5 % of comparisons. Nothing passes before 48 pairs, or as"
    " many as it takes to see a failure that is as seldom as the margin accepts."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    text = (
        "an .argos file, the folder of one, a shipped experiment, or a controller's file, which"
        " then drives the other side's robots; REVISION:PATH as Git has it"
    )
    parser.add_argument("old", metavar="OLD", help=f"{text}; REVISION: alone has NEW's path")
    parser.add_argument("new", metavar="NEW", help="likewise, such as the file with your changes")
    group = parser.add_mutually_exclusive_group(required=True)
    for option, word in (("--maximize", "more"), ("--minimize", "less")):
        _arguments.option(group, option, str, "MEASURE", f"the measure, of which {word} is better")
    text = "so much worse is accepted: a share of the old mean, or a number (default: 10%%)"
    _arguments.option(parser, "--margin", str, "SHARE%", text, "10%")
    text = f"at most so many (default and most: {MOST_PAIRS})"
    _arguments.option(parser, "--pairs", _arguments.positive, "N", text, MOST_PAIRS)
    add_trials(parser)


def add_trials(parser: argparse.ArgumentParser) -> None:
    """Declares how runs are made of which some decide which others follow."""
    text = "length of a run in s (default: the file's)"
    _arguments.option(parser, "--duration", _arguments.seconds, "S", text)
    _arguments.option(parser, "--robots", _arguments.positive, "N", _experiments.ROBOTS)
    _experiments.add_settings(parser)
    text = "of the first run; the others have the next ones (default: 1)"
    _arguments.option(parser, "--seed", _arguments.natural, "N", text, 1)
    _arguments.flag(parser, "--lenient", "as of vsense sim")
    text = (
        "table of the runs (.csv) or the picture (.png, .svg, .pdf); the other one lies beside it"
        " (default: in runs/, named by what is simulated)"
    )
    _arguments.option(parser, "-o --output", Path, "FILE", text)
    _arguments.flag(parser, "--json", "print the answer as one JSON object")
    text = "runs at the same time (default: one per processor)"
    _arguments.option(parser, "-j --jobs", _arguments.positive, "N", text)
    sim.add_on(parser)
    report.add_charts(parser)


def trials_of(options: argparse.Namespace) -> dict[str, Any]:
    """Returns what `add_trials` declares; UsageError: nothing is there that draws."""
    report.check_charts(options)
    same = ("robots", "seed", "output", "format", "style", "jobs", "on", "lenient")
    how = {name: getattr(options, name) for name in same}
    return {
        **how,
        "settings": once("--set", options.set),
        "duration_s": options.duration,
        "progress": True,
    }


def run(options: argparse.Namespace) -> int:
    """Compares; `Comparison.exit_code`, or 130 after Ctrl-C, 143 after SIGTERM."""
    answer = compare(
        options.old,
        options.new,
        maximize=options.maximize,
        minimize=options.minimize,
        margin=options.margin,
        pairs=options.pairs,
        **trials_of(options),
    )
    say_files(answer.table, answer.picture)
    if options.json:
        print_data(json.dumps(answer.facts(), indent=2))
    Console().say(str(answer))
    return answer.exit_code


def say_files(table: Path, picture: Path | None) -> None:
    """Says where runs and picture are."""
    Console().say(f"runs: {table}")
    Console().say(f"picture: {picture}" if picture else f"no picture: {lacking()}")


def once(option: str, pairs: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Settings by their names; UsageError: the option has one of them twice."""
    values = dict(pairs)
    if len(values) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise UsageError(f"{option} {twice}: given twice")
    return values
