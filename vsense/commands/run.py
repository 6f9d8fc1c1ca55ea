"""`vsense run`: an experiment with real robots."""

from __future__ import annotations

import argparse
from pathlib import Path

from vsense.commands import arguments

HELP = "run an experiment with real robots and cameras, or with another tracker"

DESCRIPTION = (
    "Runs an experiment with real robots. The arena state comes from cameras of your own"
    " (--tracking), or from the tracker that the experiment's <framework> names: one that speaks"
    " the original protocol (ats_host, ats_port) or any other one (<vs:tracker format='lines' />)."
    " All robots that are connected and seen start on one signal. Where arena states stay out the"
    " robots stand still until they are back; whoever drops out may come back at any time. The run"
    " ends after its length, or with Ctrl-C."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    arguments.add_experiment(parser)
    arguments.add_settings(parser)
    _add_ends(parser)
    parser.add_argument(
        "--start-after",
        type=arguments.seconds,
        metavar="S",
        help="start after S s at the latest, without whoever is missing (default: wait for all)",
    )
    _add_results(parser)
    arguments.add_room(parser)


def _add_ends(parser: argparse.ArgumentParser) -> None:
    """Declares where the arena state comes from, and where the robots connect to."""
    parser.add_argument(
        "--tracking",
        nargs=2,
        metavar=("RESOURCES", "SESSION"),
        help="track with these two files of `vsense track`: cameras, or recordings in their place",
    )
    parser.add_argument(
        "--host",
        metavar="ADDRESS",
        help="interface that robots connect to, 0.0.0.0: all (default: the file's vss_host)",
    )
    parser.add_argument(
        "--port",
        type=arguments.port,
        metavar="P",
        help="TCP and UDP port; 0 takes a free one (default: the file's vss_port)",
    )
    parser.add_argument(
        "--legacy-port",
        type=arguments.port,
        metavar="P",
        help="serve robots that still run the original's client, too, on this TCP port; 0 takes a"
        " free one (default: serve none)",
    )


def _add_results(parser: argparse.ArgumentParser) -> None:
    """Declares where the figures go."""
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help="folder for notes and figures (default: runs/...)",
    )


def run(options: argparse.Namespace) -> int:
    """Runs the experiment; see `vsense.run.command.run`."""
    # Imported here: `vsense --help` must not wait for OpenCV.
    from vsense.run import command

    return command.run(options)
