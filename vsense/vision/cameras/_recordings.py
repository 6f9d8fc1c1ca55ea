"""One camera's recorded pictures, a directory or a video, and when they were taken.

The times come from a table, from the pictures' numbers, or from a rate. A table of timestamps is a
CSV file with a header. Columns: `picture` (file name; not needed for a video), `timestep`
(optional: the trigger's number, the same for all cameras), and one of `capture_ns` (whole number)
and `capture_s` (decimal).
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2

from vsense.base.arena import Image
from vsense.base.errors import ConfigError, GrabberError
from vsense.base.files import MOST_TABLE_BYTES, read_text
from vsense.vision.cameras.picture import ENDINGS, PictureError, pictures_in, read_picture, to_grey

STAMPS = ("picture", "timestep", "capture_ns", "capture_s")

_LAST_NUMBER = re.compile(r"([0-9]{1,15})(?=[^0-9]*$)")
_DENSE = 4
_INTEGER = re.compile(r"[0-9]{1,18}")


@dataclass(frozen=True, slots=True)
class CaptureTime:
    """When a picture of some file name ("" in a video) was taken: the middle of the exposure.

    `timestep` is the trigger's number; None: unknown.
    """

    picture: str
    timestep: int | None
    capture_ns: int


def at_rate(pictures: Sequence[str], start_ns: int, rate_hz: float) -> list[CaptureTime]:
    """Assigns times to pictures that came at a steady rate.

    Where the last number in the names counts them, it is the timestep, so that a missing picture
    leaves a gap. Otherwise each is one step after the one before it.
    """
    numbers = _numbers(pictures)
    steps = range(len(pictures)) if numbers is None else [n - numbers[0] for n in numbers]
    return [
        CaptureTime(
            name,
            None if numbers is None else numbers[place],
            start_ns + round(step * 1e9 / rate_hz),
        )
        for place, (name, step) in enumerate(zip(pictures, steps))
    ]


def _numbers(pictures: Sequence[str]) -> list[int] | None:
    """The last numbers in the names where they count: rising, and without wide gaps."""
    matches = [_LAST_NUMBER.search(Path(name).stem) for name in pictures]
    numbers = [int(match[1]) for match in matches if match is not None]
    if len(numbers) != len(pictures) or not numbers:
        return None
    rising = all(a < b for a, b in pairwise(numbers))
    dense = numbers[-1] - numbers[0] < _DENSE * len(numbers)
    return numbers if rising and dense else None


def read_timestamps(path: Path, named: bool) -> list[CaptureTime]:
    """Reads a table of timestamps; if `named`, rows must name pictures. Raises ConfigError."""
    try:
        lines = read_text(path, "utf-8-sig", MOST_TABLE_BYTES).splitlines()
    except OSError as error:
        raise ConfigError(str(path), 1, f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(str(path), 1, "is no text, expected a CSV table") from None
    reader = csv.reader(lines)
    try:
        rows = [(n, cells) for n, cells in enumerate(reader, 1) if any(map(str.strip, cells))]
    except csv.Error as error:
        raise ConfigError(str(path), max(reader.line_num, 1), str(error)) from None
    if not rows:
        raise ConfigError(str(path), 1, f"is empty, expected a header of {', '.join(STAMPS)}")
    header = _header(path, *rows[0], named)
    taken: list[CaptureTime] = []
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
        if name not in STAMPS:
            columns = ", ".join(STAMPS)
            raise ConfigError(str(path), line, f"column {name[:40]!r} is not one of: {columns}")
    if len(set(names)) < len(names):
        raise ConfigError(str(path), line, "a column is there twice")
    if ("capture_ns" in names) == ("capture_s" in names):
        raise ConfigError(str(path), line, "expected one of the columns capture_ns and capture_s")
    if named and "picture" not in names:
        raise ConfigError(str(path), line, "column picture is missing")
    return names


def _row(path: Path, line: int, header: list[str], cells: list[str]) -> CaptureTime:
    if len(cells) != len(header):
        raise ConfigError(str(path), line, f"has {len(cells)} values, expected {len(header)}")
    values = dict(zip(header, (cell.strip() for cell in cells)))
    stamped = "timestep" in values
    timestep = _integer(path, line, "timestep", values["timestep"]) if stamped else None
    if "capture_ns" in values:
        capture_ns = _integer(path, line, "capture_ns", values["capture_ns"])
    else:
        capture_ns = _seconds(path, line, values["capture_s"])
    name = values.get("picture", "")
    if Path(name).name != name:
        raise ConfigError(str(path), line, f"picture: {name[:40]!r} is not a plain file name")
    return CaptureTime(name, timestep, capture_ns)


def _integer(path: Path, line: int, column: str, text: str) -> int:
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


DEFAULT_RATE_HZ = 10.0
"""One timestep of ARGoS. Source: thesis, 2.2.1."""


class DirectoryRecording:
    """The pictures of a directory, in the order of their timestamps or else of their names."""

    def __init__(
        self,
        folder: Path,
        timestamps: Path | None = None,
        start_ns: int = 0,
        rate_hz: float | None = None,
    ) -> None:
        """Lists the pictures of a folder; reads none of them.

        Without a table of timestamps (see `read_timestamps`), the first was taken at `start_ns`
        and the others at `rate_hz`, by default `DEFAULT_RATE_HZ`.

        Raises:
            GrabberError: There is no picture.
            ConfigError: The table of timestamps cannot be used.
        """
        self._folder = folder
        self.taken: Sequence[CaptureTime]
        if timestamps is not None:
            self.taken = read_timestamps(timestamps, named=True)
        else:
            self.taken = at_rate(pictures_in(folder), start_ns, rate_hz or DEFAULT_RATE_HZ)
        if not self.taken:
            raise GrabberError(f"{folder}: holds no pictures, expected {', '.join(ENDINGS)}")

    def read(self, place: int) -> Image:
        """See `CameraRecording.read`."""
        return read_picture(self._folder / self.taken[place].picture)

    def close(self) -> None:
        """Does nothing."""


_MOST_PICTURES = 2_000_000
"""More than a day at 20 per second; a damaged header can claim any number."""


class VideoRecording:
    """The pictures of a video file."""

    def __init__(
        self,
        path: Path,
        timestamps: Path | None = None,
        start_ns: int = 0,
        rate_hz: float | None = None,
    ) -> None:
        """Opens the file; arguments are as in `DirectoryRecording`, the default rate is its own.

        Raises:
            GrabberError: It is no video that OpenCV opens, or holds no pictures.
            ConfigError: The table of timestamps cannot be used.
        """
        self._path = path
        self._video = cv2.VideoCapture(str(path))
        self._next = 0
        if not self._video.isOpened():
            raise GrabberError(f"{path}: is no video that OpenCV opens")
        self.taken: Sequence[CaptureTime]
        if timestamps is not None:
            self.taken = read_timestamps(timestamps, named=False)
        else:
            count = self._video.get(cv2.CAP_PROP_FRAME_COUNT)
            pictures = [""] * int(count if 0 < count < _MOST_PICTURES else 0)
            self.taken = at_rate(pictures, start_ns, rate_hz or self._own_rate_hz())
        if not self.taken:
            raise GrabberError(f"{path}: holds no pictures")

    def read(self, place: int) -> Image:
        """See `CameraRecording.read`; rising order is fast."""
        if place < self._next:
            self._video.release()
            self._video = cv2.VideoCapture(str(self._path))
            self._next = 0
        while self._next <= place:
            if not self._video.grab():
                raise PictureError(f"{self._path.name} ends after {self._next} pictures")
            self._next += 1
        ok, image = self._video.retrieve()
        if not ok:
            raise PictureError(f"picture {place} of {self._path.name} cannot be decoded")
        return to_grey(image)

    def close(self) -> None:
        """Closes the file; can be called again."""
        self._video.release()

    def _own_rate_hz(self) -> float:
        rate_hz = float(self._video.get(cv2.CAP_PROP_FPS))
        return rate_hz if 0.01 <= rate_hz <= 10_000.0 else DEFAULT_RATE_HZ
