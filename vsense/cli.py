"""The command `vsense`: reads arguments, turns every error into one line and an exit code.

Every module in `vsense/commands` is one command. Exit codes: 0 ok, 1 failed, 2 wrong usage or
input, 130 interrupted. Standard output is data, standard error is talk.
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import sys
from collections.abc import Sequence

import vsense.commands
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
    for found in pkgutil.iter_modules(vsense.commands.__path__):
        if found.name != "arguments":
            module = importlib.import_module(f"vsense.commands.{found.name}")
            command = commands.add_parser(
                found.name, help=module.HELP, description=module.DESCRIPTION
            )
            module.add_arguments(command)
            command.set_defaults(run=module.run)
    return parser
