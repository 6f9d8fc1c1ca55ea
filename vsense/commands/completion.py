"""`vsense completion`: lets a shell complete commands, options and experiments.

Completing is argcomplete's work (extra `completion`): the shell calls vsense, which then declares
all arguments of the command that stands in the line, and answers. Without it, or outside of a
completion, nothing is loaded for it.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys

from vsense.base import errors
from vsense.base.terminal import print_data

DESCRIPTION = (
    "Prints what lets a shell complete vsense's commands, options and experiments. To have it in"
    " every bash: echo 'eval \"$(vsense completion bash)\"' >> ~/.bashrc"
)

SHELLS = ("bash", "zsh", "fish")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    shell = os.path.basename(os.environ.get("SHELL", ""))
    default = shell if shell in SHELLS else SHELLS[0]
    parser.add_argument(
        "shell",
        nargs="?",
        choices=SHELLS,
        default=default,
        help=f"the shell (default: yours, {default})",
    )


def run(options: argparse.Namespace) -> int:
    """Prints the shell's code."""
    errors.require("completion needs", "argcomplete")
    from argcomplete.shell_integration import shellcode

    print_data(shellcode(["vsense"], shell=options.shell))
    return 0


def answer() -> None:
    """Answers the shell that asks, and ends the process; without the extra there is no answer."""
    try:
        import argcomplete
    except ImportError:
        sys.exit(1)
    from vsense import commands

    typed = os.environ.get("COMP_LINE", "")[: int(os.environ.get("COMP_POINT", "0") or 0)]
    try:
        words = shlex.split(typed)
    except ValueError:  # a quote is still open
        words = typed.split()
    # The word that is being typed is no command yet.
    done = words[1:] if typed[-1:].isspace() else words[1:-1]
    known = done[:1] if done[:1] and done[0] in commands.names() else []
    argcomplete.autocomplete(commands.parser([*known, *done[1:]]), always_complete_options="long")
