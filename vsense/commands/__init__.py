"""The commands of `vsense`: one module each, with DESCRIPTION, add_arguments and run.

This folder is the only one that knows `argparse`. A command turns its options into plain values
and hands them to the room that does the work. Only the module of the command that is called is
loaded: `vsense --help` and `vsense stop --emergency` wait for nothing that they do not need.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from vsense.base.errors import UsageError, instead, likely
from vsense.base.terminal import printable_lines

COMMANDS = {
    "new": ("new", "make an experiment of your own to begin with, with its files explained"),
    "docs": ("docs", "print the pages, headers, schemas and examples that come with vsense"),
    "sim": ("sim", "simulate an experiment with its real controller, faster than real time"),
    "lab": ("lab", "run an experiment on this machine: rendered cameras, emulated robots"),
    "run": ("run", "run an experiment with real robots and cameras, or with another tracker"),
    "series": ("series", "make many runs by a plan, without hands: sim, lab or real robots"),
    "benchmark": ("benchmark", "qualify a lab by three fixed missions; check and compare results"),
    "status": ("orders", "show how a running experiment and its robots are"),
    "start": ("orders", "start the run that waits, let a paused one go on, or begin the next"),
    "pause": ("orders", "have robots and virtual world stand still until `vsense start`"),
    "stop": ("orders", "end the run; --emergency: stop all robots now"),
    "reset": ("orders", "end the run and go back to the beginning, waiting for `vsense start`"),
    "replace": ("orders", "between runs: have a spare robot play the part of another"),
    "handover": ("orders", "have the run that holds the robots end, and give them back"),
    "replay": ("replay", "play a recording in the page, or run the tracker on its pictures again"),
    "report": ("report", "make charts and a page from recordings; several are compared"),
    "export": ("export", "write what a recording holds as tables"),
    "pack": ("pack", "put runs and all that they were made from into one file for others"),
    "reproduce": ("reproduce", "make everything in a package anew, and say what differs"),
    "cameras": ("cameras", "find cameras, look through them, set them up"),
    "markers": ("markers", "draw markers to print and cut out, or find them in pictures"),
    "calibrate": ("calibrate", "from pictures of a board to camera files; check the ones in use"),
    "arena": ("arena", "move the arena's frame onto the real walls"),
    "track": ("track", "track robots in cameras or recordings: arena states on standard output"),
    "serve": ("serve", "serve arena states to clients of the original tracking system"),
    "render": ("render", "draw pictures of the lab's cameras for `vsense track`, with the truth"),
    "robot": ("robot", "build vsensed for robots, copy it to them, see how they are"),
    "share": ("share", "let several accounts share the arena: what root types, who is in it"),
    "doctor": ("doctor", "say what this machine lacks for what, and how to mend it"),
    "completion": ("completion", "let a shell complete commands, options and experiments"),
}
"""Each command's module and its line in the help."""

START = """\
vsense: virtual sensing for real robot swarms

  vsense sim foraging --web        simulate a swarm, and watch it in a browser
  vsense new mine                  an experiment of your own, its files explained
  vsense sim mine --runs 10        ... ten runs of it, with a table and a chart
  vsense lab mine --web            ... with emulated hardware, from pixels to wheels
  vsense doctor                    what this machine has, and what it lacks for what
  vsense docs                      the pages: the first hour, a lab's first day, ...

All commands: vsense --help; those of one: vsense sim --help
"""
"""What `vsense` alone prints."""

GROUPS = {
    "first": ("new", "sim", "lab", "run", "replay", "report"),
    "studies of many runs": ("series", "benchmark"),
    "while it runs, from another terminal": (
        *("status", "start", "pause", "stop", "reset", "replace", "handover"),
    ),
    "what a run leaves": ("export", "pack", "reproduce"),
    "cameras and markers": ("cameras", "markers", "calibrate", "arena", "track", "serve", "render"),
    "robots": ("robot",),
    "this machine, and help": ("share", "doctor", "docs", "completion"),
}
"""All commands by what one wants to do, in the order of the help."""

FORMER_COMMANDS = {"record": "render"}
"""Former names of commands, which scripts may still say."""

REMOVED = {"bench": "the benchmarks of vsense itself are in its sources: scripts/bench --help"}
"""Former commands, and where one finds them; this ends with vsense 0.3."""


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong, with the command that it is wrong for and where help is."""

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parses all of it: what a subcommand does not know, nobody knows."""
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:
            option = next((word.partition("=")[0] for word in unknown if word[:2] == "--"), "")
            names = [name for name in self._option_string_actions if name[:2] == "--"]
            self.error(f"unrecognized arguments: {' '.join(unknown)}{likely(option, names)}")
        return options, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            words = f"there is no {value!r}; {instead(str(value), map(str, action.choices))}"
            raise argparse.ArgumentError(action, words)

    def error(self, message: str) -> NoReturn:
        """Ends the program with exit code 2."""
        self.exit(2, f"{self.prog}: {printable_lines(message)}; see {self.prog} --help\n")


class HelpFormatter(argparse.HelpFormatter):
    """Leaves room for the indent of subcommands' names, which argparse does not count."""

    def add_argument(self, action: argparse.Action) -> None:
        """Measures an argument's name."""
        super().add_argument(action)
        if action.nargs == argparse.PARSER:
            self._action_max_length += self._indent_increment


class ShowVersion(argparse.Action):
    """`--version`: what is looked up is looked up where somebody asks."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        """Prints what is installed, and ends the program."""
        from vsense.tools.doctor.checks import versions

        sys.stdout.write(f"{', '.join(' '.join(pair) for pair in versions().items())}\n")
        parser.exit()


def parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """Makes the parser of a command line.

    Args:
        words: what stands after `vsense`; the arguments of the command that they name are declared,
            and the options that they give have that command's `run`.
    """
    root = Parser(
        prog="vsense",
        usage="vsense [-h] [--version] COMMAND ...",
        description="Virtual sensing for real robot swarms.",
        epilog=_grouped(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    root.add_argument(
        "-v",
        "--version",
        nargs=0,
        action=ShowVersion,
        help="show the versions of vsense and its libraries",
    )
    commands = root.add_subparsers(
        prog="vsense", metavar="COMMAND", required=True, help=argparse.SUPPRESS
    )
    called = next((word for word in words if not word.startswith("-")), "")
    if called in REMOVED:
        raise UsageError(f"there is no command {called!r} any more: {REMOVED[called]}")
    if called and called not in COMMANDS and called not in FORMER_COMMANDS:
        raise UsageError(f"there is no command {called!r}; {instead(called, COMMANDS)}")
    for name in (*COMMANDS, *FORMER_COMMANDS):
        command = commands.add_parser(name, formatter_class=HelpFormatter)
        if name == called:
            module_name, _ = COMMANDS[FORMER_COMMANDS.get(name, name)]
            module = importlib.import_module(f"vsense.commands.{module_name}")
            command.description = module.DESCRIPTION
            module.add_arguments(command)
            command.set_defaults(run=module.run, command=name)
    return root


def _grouped() -> str:
    """The commands for the help, by what one wants to do."""
    width = max(map(len, COMMANDS))
    blocks = [
        "\n".join([f"  {group}:", *(f"    {n:{width}}  {COMMANDS[n][1]}" for n in names)])
        for group, names in GROUPS.items()
    ]
    more = "`vsense COMMAND --help` is a command's own page."
    return "\n\n".join(["commands:", *blocks, more])
