"""The commands of `vsense`: one module each, with HELP, DESCRIPTION, add_arguments and run."""

from __future__ import annotations

import argparse
import importlib
import pkgutil

from vsense import __version__


def parser() -> argparse.ArgumentParser:
    """Makes the parser of the whole command line; the options it gives have the command's `run`."""
    whole = argparse.ArgumentParser(
        prog="vsense", description="Virtual sensing for real robot swarms."
    )
    whole.add_argument("--version", action="version", version=f"vsense {__version__}")
    commands = whole.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for found in pkgutil.iter_modules(__path__):
        if found.name != "arguments":
            module = importlib.import_module(f"vsense.commands.{found.name}")
            command = commands.add_parser(
                found.name, help=module.HELP, description=module.DESCRIPTION
            )
            module.add_arguments(command)
            command.set_defaults(run=module.run)
    return whole
