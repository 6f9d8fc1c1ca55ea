"""The commands of `vsense`: one module each, with DESCRIPTION, add_arguments and run.

This folder is the only one that knows `argparse`. A command turns its options into plain values
and hands them to the room that does the work. Only the module of the command that is called is
loaded: `vsense --help` and `vsense stop --emergency` wait for nothing that they do not need.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Sequence

from vsense import __version__
from vsense.errors import UsageError, instead

COMMANDS = {
    "new": ("new", "make an experiment of your own to begin with, with its files explained"),
    "docs": ("docs", "print the pages, headers, schemas and examples that come with vsense"),
    "sim": ("sim", "simulate an experiment with its real controller, faster than real time"),
    "lab": ("lab", "run an experiment on this machine: rendered cameras, emulated robots"),
    "run": ("run", "run an experiment with real robots and cameras, or with another tracker"),
    "status": ("orders", "show how a running experiment and its robots are"),
    "start": ("orders", "start the run that waits, let a paused one go on, or begin the next"),
    "pause": ("orders", "have robots and virtual world stand still until `vsense start`"),
    "stop": ("orders", "end the run"),
    "reset": ("orders", "end the run and go back to the beginning, waiting for `vsense start`"),
    "replay": ("replay", "play a recording in the page, or run the tracker on its pictures again"),
    "report": ("report", "make charts and a page from recordings; several are compared"),
    "export": ("export", "write what a recording holds as tables"),
    "cameras": ("cameras", "find cameras, look through them, set them up"),
    "markers": ("markers", "draw markers to print and cut out, or find them in pictures"),
    "calibrate": ("calibrate", "from pictures of a printed board to camera files"),
    "track": ("track", "track robots in cameras or recordings: arena states on standard output"),
    "serve": ("serve", "serve arena states to clients of the original tracking system"),
    "record": ("record", "record the lab's cameras with what `vsense track` needs to read them"),
    "robot": ("robot", "build vsensed for robots, copy it to them, see how they are"),
    "bench": ("bench", "measure detectors, names, cameras, the virtual world, the robots' daemon"),
}
"""Each command's module and its line in the help, in the order of the help."""


class HelpFormatter(argparse.HelpFormatter):
    """Leaves room for the indent of subcommands' names, which argparse does not count."""

    def add_argument(self, action: argparse.Action) -> None:
        """Measures an argument's name."""
        super().add_argument(action)
        if action.nargs == argparse.PARSER:
            self._action_max_length += self._indent_increment


def parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """Makes the parser of a command line.

    Args:
        words: what stands after `vsense`; the arguments of the command that they name are declared,
            and the options that they give have that command's `run`.
    """
    whole = argparse.ArgumentParser(
        prog="vsense",
        description="Virtual sensing for real robot swarms.",
        formatter_class=HelpFormatter,
    )
    whole.add_argument("--version", action="version", version=f"vsense {__version__}")
    commands = whole.add_subparsers(title="commands", metavar="COMMAND", required=True)
    called = next((word for word in words if not word.startswith("-")), "")
    if called and called not in COMMANDS:
        raise UsageError(f"there is no command {called!r}; {instead(called, COMMANDS)}")
    for name, (module_name, text) in COMMANDS.items():
        command = commands.add_parser(name, help=text, formatter_class=HelpFormatter)
        if name == called:
            module = importlib.import_module(f"vsense.commands.{module_name}")
            command.description = module.DESCRIPTION
            module.add_arguments(command)
            command.set_defaults(run=module.run, command=name)
    return whole
