"""The directory of one run: an earlier run is never written over."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path

from vsense.errors import VsenseError

SUMMARY = "summary.json"
SERIES = "series.json"
"""What a run leaves, and what several together do."""


class DirectoryError(VsenseError):
    """What a run leaves cannot be written."""


def make(wanted: Path | None, name: str, seed: int) -> Path:
    """Makes a run directory.

    Args:
        wanted: where; None: a new one in `runs/`, named after time, experiment and seed.
        name: the experiment's.
        seed: of the run.

    Raises:
        DirectoryError: it cannot be made, or it is not empty.
    """
    stem = f"{time.strftime('%Y-%m-%d-%H%M%S')}-{name}-seed{seed}"
    directory = wanted or Path("runs") / stem
    copies = 1
    while wanted is None and directory.exists():
        copies += 1
        directory = directory.with_name(f"{stem}-{copies}")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if any(directory.iterdir()):
            raise DirectoryError(f"{directory} is not empty: choose a new folder for this run")
    except OSError as error:
        raise DirectoryError(f"cannot write to {directory}: {error.strerror}") from None
    return directory.resolve()


def write_summary(
    directory: Path, summary: Mapping[str, object], on_stdout: bool, name: str = SUMMARY
) -> None:
    """Writes figures, and prints them where they are wanted.

    Raises:
        DirectoryError: the file, or standard output, cannot be written.
    """
    try:
        (directory / name).write_text(json.dumps(summary, indent=2) + "\n")
    except OSError as error:
        raise DirectoryError(f"{directory / name}: {error.strerror}") from None
    print_summary(summary, on_stdout)


def print_summary(summary: Mapping[str, object], on_stdout: bool) -> None:
    """Prints figures where they are wanted.

    Raises:
        DirectoryError: standard output cannot be written.
    """
    try:
        if on_stdout:
            print(json.dumps(summary, indent=2), flush=True)
    except OSError as error:
        raise DirectoryError(f"standard output: {error.strerror}") from None
