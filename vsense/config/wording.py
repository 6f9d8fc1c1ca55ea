"""What is said about an experiment file: its warnings, and how errors show values and names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass, field

MAX_SHOWN = 60
"""Characters of a value that an error repeats."""

COUNTS = ("no", "one", "two", "three", "four")


@dataclass(frozen=True, slots=True)
class Document:
    """An experiment file while it is read.

    Attributes:
        file: the file as the user named it.
        passed_over: line and words for whatever is not done as the file asks.
    """

    file: str
    passed_over: list[tuple[int, str]] = field(default_factory=list)

    def warnings(self) -> tuple[str, ...]:
        """Gives what is passed over, in the file's order: `file:line: what happens instead`."""
        return tuple(f"{self.file}:{line}: {words}" for line, words in sorted(self.passed_over))


def shown(text: str) -> str:
    """Gives a value in quotes, a long one cut."""
    return repr(text if len(text) <= MAX_SHOWN else text[:MAX_SHOWN] + "...")


def listed(names: Iterable[str]) -> str:
    """Gives names in alphabetical order, "none" where there is none."""
    return ", ".join(sorted(names)) or "none"


def likely(missing: str, present: Iterable[str]) -> str:
    """Points to a name nearby that looks like a misspelling of the missing one."""
    close = difflib.get_close_matches(missing, sorted(present), 1, 0.75)
    return f" (is {close[0]!r} meant?)" if close else ""
