"""The commands of `vsense`: one module each, with DESCRIPTION, add_arguments and run.

This folder is the only one that knows `argparse`. A command turns its options into plain values
and hands them to the room that does the work. Only the module of the command that is called is
loaded: `vsense --help` and `vsense control stop --emergency` wait for nothing that they do not
need.
"""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from collections.abc import Sequence
from itertools import takewhile
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
    "compare": ("compare", "test a new controller against an old one, for a pull request"),
    "optimize": ("optimize", "search for the settings that are best by an experiment's measures"),
    "benchmark": ("benchmark", "qualify a lab by three fixed missions; check and compare results"),
    "control status": ("orders", "show how a running experiment and its robots are"),
    "control start": (
        "orders",
        "start the run that waits, continue a paused one, or begin the next",
    ),
    "control pause": ("orders", "have robots and virtual world stand still until `control start`"),
    "control stop": ("orders", "end the run; --emergency: stop all robots now"),
    "control reset": ("orders", "end the run and go back to the beginning, until `control start`"),
    "control replace": ("orders", "between runs: have a spare robot take the role of another"),
    "control handover": ("orders", "have the run that holds the robots end, and give them back"),
    "replay": ("replay", "play a recording in the page, or run the tracker on its pictures again"),
    "report": ("report", "make charts and a page from recordings; several are compared"),
    "export": ("export", "write what a recording holds as tables"),
    "pack": ("pack", "put runs and all that they were made from into one file for others"),
    "reproduce": ("reproduce", "make everything in a package again, and say what differs"),
    "camera list": ("cameras", "list the cameras that are there"),
    "camera show": ("cameras", "look through a camera, or take one picture"),
    "camera tune": ("cameras", "help with a camera's exposure and gain"),
    "camera init": ("cameras", "write the configuration files for the cameras that are there"),
    "camera shoot": ("cameras", "take pictures of a board with all cameras"),
    "camera pretend": ("cameras", "render cameras above emulated robots, to rehearse without any"),
    "camera node": ("cameras", "look at this computer's cameras for a tracker on another one"),
    "camera markers": ("markers", "draw markers to print and cut out, or find them in pictures"),
    "camera calibrate": ("calibrate", "from pictures of a board to camera files; check them"),
    "camera arena": ("arena", "move the arena's frame onto the real walls"),
    "camera track": ("track", "track robots in cameras or recordings: states on standard output"),
    "camera serve": ("serve", "serve arena states to clients of the original tracking system"),
    "camera render": ("render", "draw pictures of the lab's cameras to track, with the truth"),
    "robot": ("robot", "build vsensed for robots, copy it to them, see how they are"),
    "share": ("share", "let several accounts share the arena: what root types, its members"),
    "doctor": ("doctor", "check this machine: what is missing for what, and how to get it"),
    "completion": ("completion", "let a shell complete commands, options and experiments"),
}
"""Each command's module and its line in the help. A name of two words is an action of its first."""

FAMILIES = {
    "control": "Steers a running experiment, or shows how it is: from any terminal of its machine.",
    "camera": "Sets up what the robots are seen with: cameras, markers, calibration, tracking.",
}
"""First words of commands with two, and what heads their help."""

START = """\
vsense: virtual sensing for real robot swarms

  vsense sim foraging --web        simulate a swarm, and watch it in a browser
  vsense new mine                  an experiment of your own, its files explained
  vsense sim mine --runs 10        ... ten runs of it, with a table and a chart
  vsense lab mine --web            ... with emulated hardware, from pixels to wheels
  vsense doctor                    what this machine has, and what is missing
  vsense docs                      the pages: the first hour, a lab's first day, ...

All commands: vsense --help; those of one: vsense sim --help
"""
"""What `vsense` alone prints."""

GROUPS = {
    "first": ("new", "sim", "lab", "run", "replay", "report"),
    "studies of many runs": ("series", "optimize", "compare", "benchmark"),
    "while it runs, from another terminal": tuple(n for n in COMMANDS if n[:8] == "control "),
    "what a run leaves": ("export", "pack", "reproduce"),
    "cameras and markers": tuple(name for name in COMMANDS if name[:7] == "camera "),
    "robots": ("robot",),
    "this machine, and help": ("share", "doctor", "docs", "completion"),
}
"""All commands by what one wants to do, in the order of the help."""

FORMER_COMMANDS = {
    **{n.split()[1]: n for n, (module, _) in COMMANDS.items() if " " in n and module != "cameras"},
    **{"cameras": "camera", "record": "camera render"},
}
"""What commands were called, which scripts may still say; this ends with vsense 0.3."""

REMOVED = {"bench": "the benchmarks of vsense itself are in its sources: scripts/bench --help"}
"""Former commands, and where one finds them; this ends with vsense 0.3."""

FEW = 14
_COMMON = (
    "--about --author --base --binary --blind --board --check --controller --dry --duration"
    " --example --experiment --exposure --floor --frames --gain --lab --license"
    " --link-check --margin --maximize --minimize --mode"
    " --name --offline --output --pictures --quick --rate --record --resources --robots --rollback"
    " --roster --runs --seed --sensors --set --site --snapshot --speed --sweep --tags --target"
    " --thickness --tracker --tracker-port --tracking --trials --vary --wait --web --wiggle"
)
COMMON = frozenset(_COMMON.split())
"""Where a command has more than a few options, `--help` shows those of this set, and `--help all`
shows all."""


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong, with the command that it is wrong for and where help is."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings, add_help=False)
        self._bare = False
        text = "show this page; --help all, behind a command: with every option"
        self.add_argument("-h", "--help", action=ShowHelp, nargs="?", metavar="all", help=text)

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parses all of it: what a subcommand does not know, nobody knows."""
        self._bare = not args
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
        """Ends the program with exit code 2; where no action is named, shows the actions."""
        if self._bare and any(action.nargs == argparse.PARSER for action in self._actions):
            self.print_help(sys.stderr)
            self.exit(2)
        self.exit(2, f"{self.prog}: {printable_lines(message)}; see {self.prog} --help\n")


class HelpFormatter(argparse.HelpFormatter):
    """Leaves room for the indent of subcommands' names, which argparse does not count."""

    def add_argument(self, action: argparse.Action) -> None:
        """Measures an argument's name."""
        super().add_argument(action)
        if action.nargs == argparse.PARSER:
            self._action_max_length += self._indent_increment


class ShowHelp(argparse.Action):
    """`--help`: the common options, where there are many; `--help all`: all."""

    def __call__(
        self, parser: argparse.ArgumentParser, _: object, words: object, *__: object
    ) -> NoReturn:
        """Prints the page, and ends the program."""
        options = [a for a in parser._actions if a.option_strings and a is not self]
        rare = [action for action in options if not COMMON & {*action.option_strings}]
        if len(options) > FEW and words != "all":
            for action in rare:
                action.help = argparse.SUPPRESS
            parser.epilog = f"{len(rare)} more options: {parser.prog} --help all"
        parser.print_help()
        parser.exit()


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
    called, *rest = words if words and not words[0].startswith("-") else ("",)
    if called in REMOVED:
        raise UsageError(f"there is no command {called!r} any more: {REMOVED[called]}")
    if called and called not in names():
        raise UsageError(f"there is no command {called!r}; {_meant(called)}")
    for name in [called] if called else names():
        full = FORMER_COMMANDS.get(name, name)
        command = commands.add_parser(name, prog=f"vsense {full}", formatter_class=HelpFormatter)
        if name == called:
            _declare(command, full, called, rest)
    return root


def names() -> list[str]:
    """What may stand first in a command line."""
    return [*dict.fromkeys(name.split()[0] for name in COMMANDS), *FORMER_COMMANDS]


def _meant(called: str) -> str:
    """What is meant by a command that is not known: with its family, as one types it today."""
    meant = instead(called, (n for n in names() if FORMER_COMMANDS.get(n) not in FAMILIES))
    if not meant.startswith("is "):
        return instead(called, {*names()} - {*FORMER_COMMANDS})
    return re.sub(r"'(\w+)'", lambda word: repr(FORMER_COMMANDS.get(word[1], word[1])), meant)


def current(words: Sequence[str]) -> Sequence[str]:
    """A command line that begins with `cameras`, whose action may be absent, as written now."""
    if words[:1] != ["cameras"]:
        return words
    options = [*takewhile(lambda word: word.startswith("-"), words[1:])]
    if {"-h", "--help"} & {*options}:
        return ["camera", *words[1:]]
    actions = words[1 + len(options) :] or ["list"]
    return ["camera", *actions[:1], *options, *actions[1:]]


def _declare(parser: argparse.ArgumentParser, name: str, typed: str, rest: Sequence[str]) -> None:
    """Declares the arguments of a command, or the commands of a family and those of one of them."""
    if name in COMMANDS:
        module = importlib.import_module(f"vsense.commands.{COMMANDS[name][0]}")
        parser.description = module.DESCRIPTION
        module.add_arguments(parser)
        parser.set_defaults(run=module.run, command=typed)
        return
    parser.description = FAMILIES[name]
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)
    for child, (_, text) in COMMANDS.items():
        family, _, action = child.partition(" ")
        if family == name:
            command = actions.add_parser(action, help=text, formatter_class=HelpFormatter)
            if rest[:1] == [action]:
                _declare(command, child, action, ())


def _grouped() -> str:
    """The commands for the help, by what one wants to do."""
    width = max(map(len, COMMANDS))
    blocks = [
        "\n".join([f"  {group}:", *(f"    {n:{width}}  {COMMANDS[n][1]}" for n in names)])
        for group, names in GROUPS.items()
    ]
    more = "`vsense COMMAND --help` is a command's own page; `--help all` has all its options."
    return "\n\n".join(["commands:", *blocks, more])
