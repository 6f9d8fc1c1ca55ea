"""Views: the corners of a board, or known points, that one camera saw at one moment.

Corners are found in a picture to a few hundredths of a pixel.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vsense.base.arena import Floats, Ints
from vsense.base.errors import ConfigError, UsageError
from vsense.base.files import MOST_TABLE_BYTES, read_text

_DIGITS_MAX = 9

CORNER_COLUMNS = ("camera", "moment", "corner", "x_px", "y_px")
"""Of a corners file."""


@dataclass(frozen=True, slots=True)
class View:
    """One camera's sight of the board.

    Attributes:
        moment: Its name; views of the same moment show the same pose of the board.
        ids: (n,) numbers of the corners, row by row from the printed board's upper left one.
        pixels: (n, 2).
    """

    camera: str
    moment: str
    ids: Ints
    pixels: Floats


@dataclass(frozen=True, slots=True)
class BoardViews:
    """Views of the board by camera and moment; per camera, size [px] and number of pictures."""

    sizes: dict[str, tuple[int, int]]
    views: Sequence[View]
    pictures: dict[str, int]

    def of(self, camera: str) -> list[View]:
        """The views of one camera."""
        return [view for view in self.views if view.camera == camera]


def read_table(path: Path, columns: Sequence[str]) -> list[tuple[int, list[str]]]:
    """Reads columns of a CSV file with a header; returns them per line, with its number.

    Raises UsageError for an unreadable file, ConfigError for a missing column or value.
    """
    try:
        text = read_text(path, "utf-8-sig", MOST_TABLE_BYTES)
        lines = list(csv.reader(io.StringIO(text, newline="")))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"{path}: cannot be read: {reason}") from None
    header = [name.strip() for name in lines[0]] if lines else []
    missing = [name for name in columns if name not in header]
    if missing:
        expected = ",".join(columns)
        raise ConfigError(str(path), 1, f"no column '{missing[0]}': expected {expected}")
    places = [header.index(name) for name in columns]
    table = []
    for number, line in enumerate(lines[1:], start=2):
        if not line:
            continue
        if len(line) < len(header):
            raise ConfigError(
                str(path), number, f"{len(line)} values: the header has {len(header)}"
            )
        table.append((number, [line[place].strip() for place in places]))
    return table


def number_at(path: Path, line: int, name: str, text: str) -> float:
    """Returns a finite number of a file; raises ConfigError where it is none."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigError(str(path), line, f"{name}: '{text}' is not a number")
    return value


def _is_number(text: str) -> bool:
    """Of a size that Python makes a number of."""
    return text.isdecimal() and len(text) <= _DIGITS_MAX


def read_corners(path: Path, corners: int) -> list[View]:
    """Reads a file of `write_corners`, for so many corners; raises as `read_table` does."""
    views: dict[tuple[str, str], dict[int, tuple[float, float]]] = {}
    for line, (camera, moment, corner, *place) in read_table(path, CORNER_COLUMNS):
        if not _is_number(corner) or int(corner) >= corners:
            raise ConfigError(
                str(path),
                line,
                f"corner: '{corner[:40]}': expected 0 to {corners - 1} on this board",
            )
        view = views.setdefault((camera, moment), {})
        if int(corner) in view:
            raise ConfigError(
                str(path), line, f"corner {corner} of {camera} {moment} is there twice"
            )
        x, y = (number_at(path, line, name, text) for name, text in zip(CORNER_COLUMNS[3:], place))
        view[int(corner)] = (x, y)
    return [
        View(camera, moment, np.array(list(seen), np.int64), np.array(list(seen.values())))
        for (camera, moment), seen in sorted(views.items())
    ]


def write_corners(path: Path, views: Iterable[View]) -> None:
    """Writes a corners file: one line per corner that a camera saw."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(CORNER_COLUMNS)
        for view in views:
            for corner, (x, y) in zip(view.ids.tolist(), view.pixels.tolist()):
                writer.writerow((view.camera, view.moment, corner, f"{x:.4f}", f"{y:.4f}"))
