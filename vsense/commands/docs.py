"""`vsense docs`: the pages, headers, schemas and examples that come with vsense."""

from __future__ import annotations

import argparse
from itertools import groupby

from vsense.base.errors import UsageError
from vsense.base.terminal import aligned, paged
from vsense.commands import _arguments
from vsense.tools.shipped import documents

DESCRIPTION = (
    "Prints what comes with vsense to read: pages, headers for controllers, the shipped controllers"
    " and experiments, schemas for editors. Without a name it lists them. What is longer than the"
    " terminal is shown with $PAGER."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument(
        "name",
        nargs="?",
        metavar="NAME",
        help="a page's or file's name as it is listed, or the end of its path",
    )
    _arguments.flag(parser, "--path", "say where the file is instead of printing it")


def run(options: argparse.Namespace) -> int:
    """Prints a page, its path, or the list."""
    if options.name is None:
        if options.path:
            raise UsageError("--path: expected the name of a page or file, too; see vsense docs")
        text = _list()
    else:
        document = documents.find(options.name)
        text = f"{document.path}\n" if options.path else documents.printed(document)
    paged(text)
    return 0


def _list() -> str:
    """All names with what they are about, group by group."""
    every = documents.listed()
    rows = aligned([(f"  {document.name}", document.title()) for document in every])
    lines = ["vsense docs NAME prints one of these:"]
    for group, pairs in groupby(zip(every, rows), key=lambda pair: pair[0].group):
        lines += ["", group, *(row for _, row in pairs)]
    return "\n".join(lines) + "\n"
