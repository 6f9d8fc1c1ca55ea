"""Recordings: everything a run told, in one MCAP file; read, replayed, exported, tracked again."""

from __future__ import annotations

from pathlib import Path

from vsense.base import errors


def require() -> None:
    """Raises UsageError, with how to install them, if packages for recordings are missing."""
    errors.require("recordings need", "mcap", "zstandard")


SUFFIX = ".mcap"
LEAST_S = 5.0
"""A shorter recording does not tell what a minute costs."""


def files_of(path: Path) -> list[Path]:
    """The recordings that a path means: the file, or all in the folder of a run or a series.

    Raises:
        UsageError: a folder holds none.
    """
    if not path.is_dir():
        return [path]
    found = sorted([*path.glob(f"*{SUFFIX}"), *path.glob(f"*/*{SUFFIX}")])
    if not found:
        raise errors.UsageError(
            f"{path}: holds no recording ({SUFFIX}):"
            " sim, lab, run and track make them with --record"
        )
    return found


def file_of(path: Path) -> Path:
    """The one recording that a path means; raises as `files_of`, and where there are several."""
    found = files_of(path)
    if len(found) > 1:
        raise errors.UsageError(
            f"{path}: holds {len(found)} recordings, such as {found[0]}: say which"
        )
    return found[0]


def size_line(path: Path | str, size: int, duration_s: float) -> str:
    """Says where a recording is, how large [byte], and unless it is short what a minute costs."""
    words = f"recording: {path}, {megabytes(size)}"
    if duration_s < LEAST_S:
        return words
    return f"{words}, {megabytes(60.0 * size / duration_s)} a minute"


def megabytes(size: float) -> str:
    """A file's size as people read it."""
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"
