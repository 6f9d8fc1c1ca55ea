"""The command `vsense`: reads arguments, turns every error into one line and an exit code.

Exit codes: 0 ok, 1 failed, 2 wrong usage or input, 130 interrupted. Standard output is data,
standard error is talk.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from vsense import __version__
from vsense.errors import VsenseError


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command.

    Args:
        arguments: words after `vsense`; by default those of this process.

    Returns:
        The exit code.
    """
    options = _parser().parse_args(arguments)
    try:
        return int(options.run(options))
    except VsenseError as error:
        print(f"vsense: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("vsense: interrupted", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="vsense", description="Virtual sensing for real robot swarms."
    )
    parser.add_argument("--version", action="version", version=f"vsense {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_lab(commands)
    return parser


def _add_lab(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    lab = commands.add_parser(
        "lab",
        help="run an experiment on this machine: rendered cameras, emulated robots, real code",
        description="Runs an experiment in real time on this machine. Everything between the"
        " camera's pixels and the motor command is the real thing: the tracker, the world, the"
        " network and one vsensed per robot; only photons and wheels are simulated.",
    )
    lab.add_argument("experiment", help="a shipped experiment's name, or the path of a .argos file")
    lab.add_argument(
        "--duration",
        type=_seconds,
        metavar="S",
        help="length of the run in s (default: the file's)",
    )
    lab.add_argument(
        "--seed",
        type=_natural,
        metavar="N",
        help="seed of poses, noise and robots (default: the file's)",
    )
    lab.add_argument(
        "--robots", type=_positive, metavar="N", help="take only the first N robots of the file"
    )
    lab.add_argument(
        "--blind", action="store_true", help="hold the virtual sensors at 0: the control experiment"
    )
    lab.add_argument(
        "--port",
        type=_port,
        metavar="P",
        help="TCP and UDP port; 0 takes a free one (default: the file's)",
    )
    lab.add_argument(
        "--output", type=Path, metavar="DIR", help="folder for picture and logs (default: runs/...)"
    )
    lab.add_argument(
        "--json",
        action="store_true",
        help="print the summary as one JSON object on standard output",
    )
    lab.set_defaults(run=_lab)


def _lab(options: argparse.Namespace) -> int:
    # Imported here: `vsense --help` must not wait for OpenCV.
    from vsense.lab.command import run

    return run(options)


def _seconds(text: str) -> float:
    """A length of time in s, at least one and finite."""
    value = _number(text, float, "a number of seconds")
    if not 1.0 <= value <= 86_400.0 or math.isnan(value):
        raise argparse.ArgumentTypeError(f"{text}: expected 1 to 86400 seconds")
    return value


def _natural(text: str) -> int:
    return _integer(text, 0, 2**32 - 1)


def _positive(text: str) -> int:
    return _integer(text, 1, 10_000)


def _port(text: str) -> int:
    return _integer(text, 0, 65_535)


def _integer(text: str, least: int, most: int) -> int:
    value = int(_number(text, int, "a whole number"))
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"{text}: expected {least} to {most}")
    return value


def _number(text: str, kind: type[int] | type[float], expected: str) -> float:
    try:
        return kind(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not {expected}") from None
