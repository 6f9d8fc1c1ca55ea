"""Which options of `vsense` nothing passes through the command line.

`scripts/test` has the whole suite's options noted (`noting_options/`) and then runs this module:
`python -m tests.rigs.passed_options FILE` prints the rest, and ends with 1 where there is some.
"""

from __future__ import annotations

import sys
from collections.abc import Collection
from pathlib import Path

from scripts.site.commands import parsers
from vsense.commands import COMMANDS

NOTING = Path(__file__).parent / "noting_options"
"""This folder in PYTHONPATH, and a file's name in VSENSE_PASSED, have options noted there."""


def offered() -> set[str]:
    """All options of all commands, as `vsense robot build --target`."""
    return {
        f"{parser.prog} {action.option_strings[-1]}"
        for name in COMMANDS
        for parser in parsers(name)
        for action in parser._actions
        if action.option_strings and action.dest != "help"
    }


def passed(file: Path) -> set[str]:
    """The options that were noted in a file."""
    return set(file.read_text().splitlines())


def untried(file: Path) -> list[str]:
    """What is offered and was not passed."""
    return sorted(offered() - passed(file))


def main(words: Collection[str]) -> int:
    """Prints what is untried; 0, or 1 where something is."""
    (file,) = words
    rest = untried(Path(file))
    if rest:
        print("\nOptions that no test passes through the command line:", *rest, sep="\n    ")
    return int(bool(rest))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
