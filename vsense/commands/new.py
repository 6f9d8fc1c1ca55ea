"""`vsense new`: an experiment of one's own to begin with."""

from __future__ import annotations

import argparse
from pathlib import Path

from vsense.base.terminal import Console, print_data
from vsense.commands import _arguments
from vsense.tools.shipped import templates

DESCRIPTION = (
    "Makes a folder with an experiment of your own: the .argos file, the robots' controller in C or"
    " in Python, loop functions in Python that measure, and a README that explains them line by"
    " line. It runs as it is made; then change it. The names of the files go to standard output."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument(
        "folder",
        type=Path,
        metavar="NAME",
        help="the experiment's name, and that of its folder; a path before it says where",
    )
    parser.add_argument(
        "--from",
        dest="source",
        default=templates.TEMPLATE,
        metavar="EXPERIMENT",
        help="the shipped experiment that is copied (default: the smallest that has everything)."
        f" There are: {', '.join(templates.templates())}",
    )
    text = "add a virtual sensor of your own, in Python, which the controller reads"
    _arguments.flag(parser, "--sensor", text)
    text = "the controller is in Python, which runs on the host"
    _arguments.flag(parser, "--python", text)
    text = "add a notebook for Jupyter: loads, simulates, compares and plots it (extra notebook)"
    _arguments.flag(parser, "--notebook", text)
    text = "add a test of its behaviour, and the files that have GitHub and GitLab run it"
    _arguments.flag(parser, "--ci", text)


def run(options: argparse.Namespace) -> int:
    """Makes the files; says how to run them."""
    named = ("sensor", "python", "notebook", "ci")
    wanted = {name: getattr(options, name) for name in named}
    files = templates.make(options.folder, options.source, **wanted)
    print_data("\n".join(map(str, files)))
    readme = options.folder / "README.md"
    Console().say(f"vsense: now: vsense sim {files[0]}    {readme} explains it all")
    return 0
