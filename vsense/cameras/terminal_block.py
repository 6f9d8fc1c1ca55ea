"""Lines on a terminal that are drawn over themselves."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from typing import TextIO


class Block:
    """A block of lines at the foot of a terminal; where there is none, it is printed once more.

    Attributes:
        has_blocks: whether the stream takes Unicode's block characters.
    """

    def __init__(self, stream: TextIO) -> None:
        """Draws on a stream."""
        self._stream = stream
        self._live = stream.isatty()
        self._drawn = 0
        self.has_blocks = (stream.encoding or "").lower().replace("-", "") == "utf8"

    def draw(self, lines: Sequence[str]) -> None:
        """Draws lines in the place of those before."""
        if self._live:
            columns = shutil.get_terminal_size().columns
            # A line that the terminal breaks is two, and the next block would begin too low.
            lines = [line[: columns - 1] for line in lines]
            if self._drawn:
                self._stream.write(f"\x1b[{self._drawn}A\r\x1b[J")
        self._stream.write("".join(f"{line}\n" for line in lines))
        self._stream.flush()
        self._drawn = len(lines)
