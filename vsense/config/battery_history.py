"""The batteries' history: a CSV file beside the roster, a row for each robot and run.

It grows at each run's end and is never written anew: what a spreadsheet or a script reads of it
stays. Names of columns have their units; what is not known is empty.
"""

from __future__ import annotations

import csv
import fcntl
import io
import os
import statistics
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path

from vsense.base.errors import UsageError, VsenseError
from vsense.base.files import MOST_TABLE_BYTES, read_text


@dataclass(frozen=True, slots=True)
class BatteryRow:
    """A robot's battery in a run.

    Attributes:
        time: of the run's end, ISO 8601 with its offset.
        tag: of the robot.
        uid: 32 hexadecimal digits; "": not known.
        begin_v, end_v: the battery's voltage; None: the base does not tell it.
        duration_s: of the run.
    """

    time: str
    tag: int
    uid: str
    begin_v: float | None
    end_v: float | None
    duration_s: float


BATTERY_COLUMNS = tuple(field.name for field in fields(BatteryRow))


def history_of(roster: Path) -> Path:
    """The history that belongs to a roster: robots.battery.csv beside robots.toml."""
    return roster.with_name(f"{roster.stem}.battery.csv")


def append(path: Path, rows: Iterable[BatteryRow]) -> None:
    """Adds rows; the first ones are given their head. Several processes may add.

    Raises:
        VsenseError: the file cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in rows:
        values = (getattr(row, name) for name in BATTERY_COLUMNS)
        writer.writerow(f"{v:.3f}" if isinstance(v, float) else v for v in values)
    try:
        # No pipe and no device: nothing that a run would wait for.
        opened = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NONBLOCK, 0o664)
        with os.fdopen(opened, "r+b", buffering=0) as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            size = os.fstat(opened).st_size
            head = "" if size else ",".join(BATTERY_COLUMNS) + "\n"
            # A line that a full disk has cut stays alone.
            cut = size > 0 and os.pread(opened, 1, size - 1) != b"\n"
            file.write(f"{chr(10) * cut}{head}{text.getvalue()}".encode())
    except OSError as error:
        raise VsenseError(f"{path}: cannot be written: {error.strerror}") from None


def read(path: Path) -> list[BatteryRow]:
    """Reads a history; there is none yet where there is no file. Rows that make no sense are passed
    over: what a full disk has cut costs no others.

    Raises:
        UsageError: the file cannot be read.
    """
    try:
        lines = read_text(path, most_bytes=MOST_TABLE_BYTES).splitlines()
    except FileNotFoundError:
        return []
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError(f"cannot read {path}: it is no text") from None
    rows = (_row(line.split(",")) for line in lines if '"' not in line)
    return [row for row in rows if row is not None]


def _row(values: list[str]) -> BatteryRow | None:
    try:
        time, tag, uid, begin_v, end_v, duration_s = values
        volts = [float(text) if text else None for text in (begin_v, end_v)]
        return BatteryRow(time, int(tag), uid, volts[0], volts[1], float(duration_s))
    except ValueError:
        return None


def last(rows: Iterable[BatteryRow]) -> dict[int, BatteryRow]:
    """Each robot's newest row, by tag."""
    return {row.tag: row for row in rows}


_LEAST_S, _LEAST_V = 60.0, 0.005
"""Of a shorter run, or one in which the voltage fell less, it is not known how fast it falls."""


def minutes_left(
    rows: Iterable[BatteryRow], tag: int, now_v: float, empty_v: float
) -> float | None:
    """How long a robot's battery lasts where it falls as in the runs before.

    Args:
        now_v: its voltage now.
        empty_v: at which it is empty.

    Returns:
        Minutes, of the median of its runs' falls; None where no run tells.
    """
    falls = [
        (row.begin_v - row.end_v) / row.duration_s
        for row in rows
        if row.tag == tag
        and row.begin_v is not None
        and row.end_v is not None
        and row.duration_s >= _LEAST_S
        and row.begin_v - row.end_v >= _LEAST_V
    ]
    return max(now_v - empty_v, 0.0) / statistics.median(falls) / 60.0 if falls else None
