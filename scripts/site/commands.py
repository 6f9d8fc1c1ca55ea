"""Writes the page of all commands from the parser itself: usage, options, and what they are for."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Iterator

from vsense import commands

WIDTH = "88"
"""Columns of a usage line: what fits beside the navigation."""

INTRO = """# Commands

Every command with all its options, as `--help` prints them. Data goes to standard output, talk to
standard error. Exit codes: 0 ok, 1 failed, 2 wrong usage or input, 130 interrupted.
"""


def page() -> str:
    """The whole page."""
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = WIDTH
    try:
        return "\n".join([INTRO, _overview(), *(_section(name) for name in commands.COMMANDS)])
    finally:
        os.environ.pop("COLUMNS")
        if before is not None:
            os.environ["COLUMNS"] = before


def parsers(name: str) -> Iterator[argparse.ArgumentParser]:
    """The parser of a command, then those of what stands after it, each with its `prog`."""
    parser = commands.parser(name.split())
    for word in name.split():
        parser = _child(parser, word)
    yield from _below(parser)


def _below(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    yield parser
    for children in _choices(parser):
        for child in children.values():
            yield from _below(child)


def _child(parser: argparse.ArgumentParser, name: str) -> argparse.ArgumentParser:
    return next(children[name] for children in _choices(parser) if name in children)


def _choices(parser: argparse.ArgumentParser) -> Iterator[dict[str, argparse.ArgumentParser]]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield action.choices


def options(parser: argparse.ArgumentParser) -> set[str]:
    """All options that a parser knows."""
    return {word for action in parser._actions for word in action.option_strings}


def _overview() -> str:
    rows = [
        f"| [`{name}`](#vsense-{name.replace(' ', '-')}) | {line} |"
        for name, (_, line) in commands.COMMANDS.items()
    ]
    return "\n".join(["| command | |", "| --- | --- |", *rows]) + "\n"


def _section(name: str) -> str:
    parts = []
    for parser in parsers(name):
        depth = "#" * min(parser.prog.count(" ") + 1, 4)
        description = re.sub(r"([<*_|])", r"\\\1", parser.description or "")
        parts.append(f"{depth} {parser.prog}\n\n{description}\n\n```text\n{_help(parser)}\n```\n")
    return "\n".join(parts)


def _help(parser: argparse.ArgumentParser) -> str:
    """What `--help` prints, without the description, which stands above it."""
    description, parser.description = parser.description, None
    try:
        return parser.format_help().rstrip()
    finally:
        parser.description = description
