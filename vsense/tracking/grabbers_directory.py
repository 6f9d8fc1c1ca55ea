"""A directory of pictures as a recording of one camera."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from vsense.tracking.grabbers import GrabberError
from vsense.tracking.grabbers_picture import Image, read_picture
from vsense.tracking.grabbers_times import Taken, at_rate, read_timestamps

SUFFIXES = (".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".bmp", ".tif", ".tiff", ".webp")
DEFAULT_RATE_HZ = 10.0
"""One timestep of ARGoS. Source: thesis, 2.2.1."""

_DIGITS = re.compile(r"([0-9]+)")


class DirectoryRecording:
    """The pictures of a directory, in the order of their timestamps or else of their names.

    Attributes:
        taken: When each was taken.
    """

    def __init__(
        self,
        folder: Path,
        timestamps: Path | None = None,
        start_ns: int = 0,
        rate_hz: float | None = None,
    ) -> None:
        """Looks which pictures there are; reads none of them.

        Args:
            folder: Where the pictures are.
            timestamps: Table of when they were taken; see `grabbers_times`.
            start_ns: Without a table: when the first was taken.
            rate_hz: Without a table: pictures per second, by default `DEFAULT_RATE_HZ`.

        Raises:
            GrabberError: There is no picture.
            ConfigError: The table of timestamps cannot be used.
        """
        self._folder = folder
        self.taken: Sequence[Taken]
        if timestamps is not None:
            self.taken = read_timestamps(timestamps, named=True)
        else:
            self.taken = at_rate(_pictures(folder), start_ns, rate_hz or DEFAULT_RATE_HZ)
        if not self.taken:
            raise GrabberError(f"{folder}: holds no pictures, expected {', '.join(SUFFIXES)}")

    def read(self, place: int) -> Image:
        """Reads a picture; places count from 0.

        Raises:
            PictureError: It cannot be used.
        """
        return read_picture(self._folder / self.taken[place].picture)

    def close(self) -> None:
        """Has nothing to let go of."""


def natural_order(name: str) -> tuple[object, ...]:
    """Sorts names as people do: "a2" before "a10"."""
    parts = _DIGITS.split(name.lower())
    return tuple((int(p), "") if p.isdecimal() else (-1, p) for p in parts), name


def _pictures(folder: Path) -> list[str]:
    try:
        names = [p.name for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and p.is_file()]
    except OSError as error:
        raise GrabberError(f"{folder}: cannot be read: {error.strerror}") from None
    return sorted(names, key=natural_order)
