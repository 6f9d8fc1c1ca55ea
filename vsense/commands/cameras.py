"""`vsense cameras`: what is plugged in, how it looks, and how it is set up."""

from __future__ import annotations

import argparse
from pathlib import Path

from vsense.commands import arguments

HELP = "find cameras, look through them, set them up"

DESCRIPTION = (
    "Without an action it lists the cameras: GigE Vision, USB3 Vision, V4L2. 'show' looks through"
    " one, 'tune' helps with its exposure and gain, 'init' writes the configuration files for all"
    " that are there, and 'shoot' takes pictures of a board with all of them for vsense calibrate."
)

_ID = (
    "what `vsense cameras` lists as its id or address, its serial number, /dev/video0, a URL, or"
    " with --resources the id of a grabber"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("--json", action="store_true", help="print the list as JSON")
    actions = parser.add_subparsers(title="actions", metavar="ACTION", dest="action")
    _add_list(actions.add_parser("list", help="show what is there (as without an action)"))


def _add_list(parser: argparse.ArgumentParser) -> None:
    """Declares what `vsense cameras list` takes."""
    # Without a default of its own: --json before the action counts, too.
    parser.add_argument(
        "--json", action="store_true", default=argparse.SUPPRESS, help="print it as JSON"
    )


def run(options: argparse.Namespace) -> int:
    """Runs an action; see `vsense.cameras.command`."""
    # Imported here: `vsense --help` must not wait for OpenCV.
    from vsense.cameras import command

    return command.run(options)
