"""`vsense robot`: the daemon for the robots' boards, built and brought there."""

from __future__ import annotations

import argparse
from pathlib import Path

HELP = "build vsensed for robots, and copy it to them"

DESCRIPTION = (
    "What a lab does with its robots' boards. 'build' makes the daemon vsensed with a controller"
    " in it, one static file for a kind of board."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True, dest="action")
    _add_build(actions.add_parser("build", help="build vsensed with a controller for a board"))


def _add_build(parser: argparse.ArgumentParser) -> None:
    """Declares what `vsense robot build` takes."""
    from vsense.robot.targets import TARGETS

    boards = "; ".join(f"{target.name}: {target.help}" for target in TARGETS.values())
    parser.add_argument(
        "--controller",
        required=True,
        metavar="FILE",
        help="the controller's .c file, or a shipped controller's name",
    )
    parser.add_argument(
        "--target", required=True, choices=list(TARGETS), help=f"kind of board. {boards}"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("vsensed"),
        metavar="FILE",
        help="where it goes (default: vsensed)",
    )
    parser.add_argument("--json", action="store_true", help="print what was built as JSON")


def run(options: argparse.Namespace) -> int:
    """Runs an action; see `vsense.robot.command`."""
    from vsense.robot import command

    return command.run(options)
