"""`vsense lab`: an experiment on this machine."""

from __future__ import annotations

import argparse
from pathlib import Path

from vsense.commands import arguments
from vsense.lab.bases import BASES

HELP = "run an experiment on this machine: rendered cameras, emulated robots, real code"

DESCRIPTION = (
    "Runs an experiment in real time on this machine. Everything between the camera's pixels and"
    " the motor command is the real thing: the tracker, the world, the network and one vsensed per"
    " robot; only photons and wheels are simulated."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    arguments.add_experiment(parser)
    arguments.add_settings(parser)
    _add_base(parser)
    parser.add_argument(
        "--port",
        type=arguments.port,
        metavar="P",
        help="TCP and UDP port; 0 takes a free one (default: the file's)",
    )
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help="folder for picture and logs (default: runs/...)"
    )
    arguments.add_room(parser)


def _add_base(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--base",
        choices=BASES,
        default=BASES[0],
        help="what the emulated robots are based on, as in vsensed --base; mixed: one after the"
        " other (default: argos)",
    )


def run(options: argparse.Namespace) -> int:
    """Runs the experiment; see `vsense.lab.experiment_run.run`."""
    # Imported here: `vsense --help` must not wait for OpenCV.
    from vsense.lab import experiment_run

    return experiment_run.run(options)
