"""The commands of `vsense`: one module each, with HELP, DESCRIPTION, add_arguments and run.

A module that is several commands at once has NAMES instead of HELP: the help of each by its name.
"""

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
            names = getattr(module, "NAMES", None) or {found.name: module.HELP}
            for name, text in names.items():
                command = commands.add_parser(name, help=text, description=module.DESCRIPTION)
                module.add_arguments(command)
                command.set_defaults(run=module.run, command=name)
    return whole
