"""Notes which options of `vsense` the tests pass through its command line.

Python imports a module of this name by itself where its folder is in PYTHONPATH, in the tests' own
processes and in all that they start. Where `VSENSE_PASSED` names a file, a line such as
`vsense lab --port` is appended for each option of a command that was not refused (exit code 2).
"""

from __future__ import annotations

import os
import sys
from functools import partial
from pathlib import Path
from typing import Any


def install(file: Path) -> None:
    """Has every parser of this process note options in a file."""
    import argparse

    given: list[str] = []
    get_values = argparse.ArgumentParser._get_values  # of each option that stands there
    parse_args = argparse.ArgumentParser.parse_args

    def note(words: list[str]) -> None:
        lines = "".join(f"{line}\n" for line in words).encode()
        descriptor = os.open(file, os.O_WRONLY | os.O_APPEND)
        os.write(descriptor, lines)  # at once: many processes write
        os.close(descriptor)

    def values_of(self: Any, action: argparse.Action, words: list[str]) -> Any:
        values = get_values(self, action, words)
        if action.option_strings and self.prog.startswith("vsense "):
            given.append(f"{self.prog} {action.option_strings[-1]}")
        return values

    def parsed(self: Any, *arguments: Any, **named: Any) -> argparse.Namespace:
        given.clear()
        try:
            options = parse_args(self, *arguments, **named)
        except SystemExit as ended:
            if not ended.code:  # an option that answers by itself, such as --list
                note(given[-1:])
            raise
        if self.prog == "vsense":
            options.run = partial(run, options.run, given[:])
        return options

    def run(command: Any, words: list[str], options: argparse.Namespace) -> int:
        try:
            code = int(command(options))
        except KeyboardInterrupt:  # of a signal
            note(words)
            raise
        if code != 2:
            note(words)
        return code

    setattr(argparse.ArgumentParser, "_get_values", values_of)  # noqa: B010
    setattr(argparse.ArgumentParser, "parse_args", parsed)  # noqa: B010


# Processes that are no command line need no parser.
if "VSENSE_PASSED" in os.environ and not any(w.startswith("vsense.") for w in sys.orig_argv):
    install(Path(os.environ["VSENSE_PASSED"]))
