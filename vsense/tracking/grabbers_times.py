"""When the pictures of a recording were taken: from a table, from their numbers, or at a rate.

A table of timestamps is a CSV file with a header. Columns: `picture` (file name; a video's
pictures come in order and need none), `timestep` (optional: the trigger's number, the same for
all cameras), and one of `capture_ns` (whole number) and `capture_s` (decimal).
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from vsense.errors import ConfigError

COLUMNS = ("picture", "timestep", "capture_ns", "capture_s")

_LAST_NUMBER = re.compile(r"([0-9]{1,15})(?=[^0-9]*$)")
_DENSE = 4
_INTEGER = re.compile(r"[0-9]{1,18}")


@dataclass(frozen=True, slots=True)
class Taken:
    """When one picture was taken.

    Attributes:
        picture: Its file name, or "" in a video.
        timestep: The trigger's number, or None where it is not known.
        capture_ns: Middle of the exposure.
    """

    picture: str
    timestep: int | None
    capture_ns: int


def at_rate(pictures: Sequence[str], start_ns: int, rate_hz: float) -> list[Taken]:
    """Gives times to pictures that came at a steady rate.

    Where the last number in the names counts them, it is the timestep, so that a missing
    picture leaves a gap. Otherwise each is one step after the one before it.
    """
    numbers = _numbers(pictures)
    steps = range(len(pictures)) if numbers is None else [n - numbers[0] for n in numbers]
    return [
        Taken(
            name,
            None if numbers is None else numbers[place],
            start_ns + round(step * 1e9 / rate_hz),
        )
        for place, (name, step) in enumerate(zip(pictures, steps))
    ]


def _numbers(pictures: Sequence[str]) -> list[int] | None:
    """Gives the numbers in the names where they count: rising, and without wide gaps."""
    found = [_LAST_NUMBER.search(Path(name).stem) for name in pictures]
    numbers = [int(match[1]) for match in found if match is not None]
    if len(numbers) != len(pictures) or not numbers:
        return None
    rising = all(a < b for a, b in pairwise(numbers))
    dense = numbers[-1] - numbers[0] < _DENSE * len(numbers)
    return numbers if rising and dense else None


def read_timestamps(path: Path, named: bool) -> list[Taken]:
    """Reads a table of timestamps.

    Args:
        path: The CSV file.
        named: Whether every row must name its picture.

    Raises:
        ConfigError: It cannot be used; the error names file, line, value and expectation.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise ConfigError(str(path), 1, f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(str(path), 1, "is no text, expected a CSV table") from None
    rows = [
        (n, cells) for n, cells in enumerate(csv.reader(lines), 1) if any(map(str.strip, cells))
    ]
    if not rows:
        raise ConfigError(str(path), 1, f"is empty, expected a header of {', '.join(COLUMNS)}")
    header = _header(path, *rows[0], named)
    taken: list[Taken] = []
    for line, cells in rows[1:]:
        row = _row(path, line, header, cells)
        if taken and row.capture_ns <= taken[-1].capture_ns:
            raise ConfigError(str(path), line, "is not later than the picture before it")
        if taken and (row.timestep or 0) <= (taken[-1].timestep or -1):
            raise ConfigError(str(path), line, f"timestep: {row.timestep} does not rise")
        taken.append(row)
    return taken


def _header(path: Path, line: int, cells: list[str], named: bool) -> list[str]:
    names = [cell.strip() for cell in cells]
    for name in names:
        if name not in COLUMNS:
            known = ", ".join(COLUMNS)
            raise ConfigError(str(path), line, f"column {name[:40]!r} is not one of: {known}")
    if len(set(names)) < len(names):
        raise ConfigError(str(path), line, "a column is there twice")
    if ("capture_ns" in names) == ("capture_s" in names):
        raise ConfigError(str(path), line, "expected one of the columns capture_ns and capture_s")
    if named and "picture" not in names:
        raise ConfigError(str(path), line, "column picture is missing")
    return names


def _row(path: Path, line: int, header: list[str], cells: list[str]) -> Taken:
    if len(cells) != len(header):
        raise ConfigError(str(path), line, f"has {len(cells)} values, expected {len(header)}")
    values = dict(zip(header, (cell.strip() for cell in cells)))
    timestep = None
    if "timestep" in values:
        timestep = _whole(path, line, "timestep", values["timestep"])
    if "capture_ns" in values:
        capture_ns = _whole(path, line, "capture_ns", values["capture_ns"])
    else:
        capture_ns = _seconds(path, line, values["capture_s"])
    name = values.get("picture", "")
    if Path(name).name != name:
        raise ConfigError(str(path), line, f"picture: {name[:40]!r} is not a plain file name")
    return Taken(name, timestep, capture_ns)


def _whole(path: Path, line: int, column: str, text: str) -> int:
    if not _INTEGER.fullmatch(text):
        raise ConfigError(str(path), line, f"{column}: {text[:40]!r} is not a whole number")
    return int(text)


def _seconds(path: Path, line: int, text: str) -> int:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) < 9e9:
        raise ConfigError(str(path), line, f"capture_s: {text[:40]!r} is not a time in seconds")
    return round(value * 1e9)
