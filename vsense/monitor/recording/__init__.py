"""Recordings: everything a run told, in one MCAP file; read, replayed, exported, tracked again."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vsense.base import errors


def require() -> None:
    """Raises UsageError, with how to install them, if packages for recordings are missing."""
    errors.require("recordings need", "mcap", "zstandard")


MCAP = ".mcap"
EVENTS = ("time_s", "level", "by", "text")
SHOWN = ("time_s", "tag", "name", "value")
"""Columns of the tables events.csv and shown.csv."""
MEASURED_FROM_S = 5.0
"""A shorter recording does not tell what a minute costs."""
IN_CONE, LIT_IN_CONE = "robots_in_cone", "lit_in_cone"
"""Measures that are counted afterwards, where the run of a pollutant did not count them."""


def files_of(path: Path) -> list[Path]:
    """The recordings that a path means: the file, or all in the folder of a run or a series.

    Raises:
        UsageError: a folder holds none.
    """
    if not os.path.isdir(path):
        return [path]
    files = sorted([*path.glob(f"*{MCAP}"), *path.glob(f"*/*{MCAP}")])
    if not files:
        raise errors.UsageError(
            f"{path}: holds no recording ({MCAP}): sim, lab, run and track make them with --record"
        )
    return files


def file_of(path: Path) -> Path:
    """The one recording that a path means; raises as `files_of`, and where there are several."""
    files = files_of(path)
    if len(files) > 1:
        raise errors.UsageError(
            f"{path}: holds {len(files)} recordings, such as {files[0]}: say which"
        )
    return files[0]


def size_line(path: Path | str, size: int, duration_s: float) -> str:
    """Says where a recording is, how large [byte], and unless it is short what a minute costs."""
    words = f"recording: {path}, {megabytes(size)}"
    if duration_s < MEASURED_FROM_S:
        return words
    return f"{words}, {megabytes(60.0 * size / duration_s)} a minute"


def megabytes(size: float) -> str:
    """A file's size as people read it."""
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"


def changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """The shown values that differ; one that is shown no more is None."""
    names = [*now, *(name for name in before if name not in now)]
    return [
        (name, now.get(name))
        for name in names
        if name not in before or now.get(name) != before[name]
    ]


def calibration_words(calibration: Mapping[str, Any]) -> str:
    """What a recording has of its calibration, for people; "" where there is nothing to tell."""
    checks, stale = calibration.get("checks"), calibration.get("stale")
    if not isinstance(checks, Sequence) or not isinstance(stale, Sequence):
        return ""
    if not checks:
        return "the calibration was never checked: vsense camera calibrate check does"
    check = checks[-1] if isinstance(checks[-1], Mapping) else {}
    rms, worst = check.get("rms_mm"), check.get("worst_mm")
    when = str(check.get("when", "?")).split("T")[0]
    text = f"calibration checked {when} at {check.get('points')} points: {rms} mm rms, {worst} mm"
    text += " at worst"
    names = [str(name) for name in stale]
    if names:
        has = "has" if len(names) == 1 else "have"
        return f"{text}; but {', '.join(names)} {has} changed since: check again"
    unchecked = calibration.get("unchecked") or []
    if unchecked:
        return f"{text}; not of {', '.join(map(str, unchecked))}"
    return text
