"""Recordings: everything a run told, in one MCAP file; read, replayed, exported, tracked again."""

from __future__ import annotations

from pathlib import Path

from vsense import errors


def require() -> None:
    """Raises UsageError, with how to install them, if packages for recordings are missing."""
    errors.require("recordings need", "mcap", "zstandard")


SUFFIX = ".mcap"


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
            f"{path}: holds no recording ({SUFFIX}): lab, run and track make them with --record"
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
