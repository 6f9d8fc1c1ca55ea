"""`vsense status`, `start`, `pause`, `stop`, `reset`: from a terminal to a running experiment."""

from __future__ import annotations

import argparse

from vsense.commands import arguments

NAMES = {
    "status": "show how a running experiment and its robots are",
    "start": "start the run that waits, let a paused one go on, or begin the next",
    "pause": "have the robots and the virtual world stand still until `vsense start`",
    "stop": "end the run",
    "reset": "end the run and go back to the beginning: the next run waits for `vsense start`",
}

DESCRIPTION = (
    "Talks to the `vsense run` or `vsense lab` that goes on on this machine, under this user. What"
    " is ordered here and on the web page goes through the same door, and everybody sees it."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the arguments of all five."""
    add_process(parser)
    if parser.prog.endswith("status"):
        parser.add_argument("--json", action="store_true", help="print it as one JSON object")
    if parser.prog.endswith("stop"):
        parser.add_argument(
            "--emergency",
            action="store_true",
            help="stop all robots now, whatever the run is doing; only a reset ends it",
        )


def add_process(parser: argparse.ArgumentParser) -> None:
    """Declares which experiment is meant."""
    parser.add_argument(
        "--process",
        type=arguments.process,
        metavar="PID",
        help="its process number, where several run",
    )


def run(options: argparse.Namespace) -> int:
    """Asks or orders; see `vsense.room.terminal`."""
    from vsense.room import terminal

    return terminal.run(options)
