"""`vsense sim`: an experiment without cameras, network or robots, faster than real time."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from vsense.commands import arguments

HELP = "simulate an experiment with its real controller, faster than real time; campaigns"

DESCRIPTION = (
    "Runs an experiment in this machine alone: the same controller, compiled once and run in one"
    " process for every robot, with the lab's wheels and proximity sensors, the same virtual world,"
    " and neither cameras nor network. A seed gives the same run every time. With --runs, --seeds"
    " or several values of a setting it is a campaign: one row of a CSV file for every run, and a"
    " picture that compares the settings."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    arguments.add_experiment(parser)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="PATH",
        help="folder of a run (default: runs/...), or a campaign's CSV file (default: results.csv)",
    )
    _add_campaign(parser)


def _add_campaign(parser: argparse.ArgumentParser) -> None:
    """Declares what makes a campaign."""
    campaign = parser.add_argument_group("campaign")
    campaign.add_argument(
        "--runs",
        type=arguments.positive,
        metavar="N",
        help="runs of every setting, with the seeds 1 to N unless --seeds says which",
    )
    campaign.add_argument(
        "--seeds",
        type=arguments.numbers,
        metavar="LIST",
        help="their seeds, such as 1-100 or 1,2,10-12",
    )
    campaign.add_argument(
        "--set",
        type=arguments.setting,
        action="append",
        default=[],
        metavar="ELEMENT.ATTRIBUTE=VALUE[,VALUE...]",
        help="values instead of the file's, each in turn; values with commas of their own are"
        " separated by semicolons. ELEMENT is an element's name or id, a controller's library (for"
        " its parameters), 'sensor' or 'actuator' (for all virtual ones). Several --set: all"
        " combinations",
    )
    campaign.add_argument(
        "-j",
        "--jobs",
        type=arguments.positive,
        default=len(os.sched_getaffinity(0)),
        metavar="N",
        help="runs at the same time (default: one per processor)",
    )


def run(options: argparse.Namespace) -> int:
    """Runs the experiment, or the campaign; see `vsense.sim.command.run`."""
    # Imported here: `vsense --help` must not wait for NumPy.
    from vsense.sim import command

    return command.run(options)
