"""Names of moments: floor_01, floor_02 and so on, never one that is taken already."""

from __future__ import annotations

import re
from pathlib import Path

FLOOR = "floor"
_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,60}")
_NUMBERED = re.compile(r"(.*)_([0-9]{1,6})")


def is_plain(text: str) -> bool:
    """Whether a text is a word that can be a file's name everywhere."""
    return _PLAIN.fullmatch(text) is not None


class Names:
    """Gives each moment its name.

    Attributes:
        next: what the next moment is called if nobody says otherwise.
    """

    def __init__(self, directory: Path, series: str = FLOOR) -> None:
        """Goes on after the pictures that are in the cameras' folders already."""
        self._taken = {path.stem for path in directory.glob("*/*")}
        self.next = self._first_free(series)

    def choose(self, text: str) -> str:
        """Takes what a person has typed: nothing, a series such as "tilt", or a whole name.

        Returns:
            The moment's name, or "" where the text is none, or taken.
        """
        words = text.strip()
        if not words:
            name = self.next
        elif not is_plain(words):
            return ""
        else:
            name = words if _NUMBERED.fullmatch(words) else self._first_free(words)
        if name in self._taken:
            return ""
        return name

    def take(self, name: str) -> None:
        """Notes that a name is used; its series goes on with the next number."""
        self._taken.add(name)
        numbered = _NUMBERED.fullmatch(name)
        assert numbered is not None
        self.next = self._first_free(numbered[1], int(numbered[2]) + 1)

    def _first_free(self, series: str, number: int = 1) -> str:
        while f"{series}_{number:02d}" in self._taken:
            number += 1
        return f"{series}_{number:02d}"
