"""`vsense cameras init`: the configuration files for all cameras that are there."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from vsense.cameras import writing
from vsense.cameras.finding import find
from vsense.cameras.listing import NOTHING
from vsense.config.recording_files import EXPERIMENT, RESOURCES
from vsense.errors import UsageError, VsenseError
from vsense.sheets import tags
from vsense.tracking.families import load_family

ROSTER = "auto:20"
BOARD = "charuco:7x5:80mm:4X4_50"


def run(options: argparse.Namespace) -> int:
    """Writes the files, and says what comes next.

    Raises:
        UsageError: a file is there already.
        VsenseError: there is no camera, or a file cannot be written.
    """
    directory: Path = options.directory
    there = [name for name in (RESOURCES, EXPERIMENT) if (directory / name).exists()]
    if there and not options.force:
        raise UsageError(f"{directory / there[0]}: is there already; --force writes over it")
    found, missing = find()
    if missing:
        print(f"vsense: {missing}", file=sys.stderr)
    if not found:
        raise VsenseError("\n".join(NOTHING))
    roster = tags.parse(ROSTER, load_family(writing.FAMILY))
    try:
        files = writing.write(directory, found, roster)
    except OSError as error:
        raise VsenseError(f"{error.filename}: cannot be written: {error.strerror}") from None
    print("\n".join(map(str, files)))
    for line in _next(directory, writing.ids(found)):
        print(line, file=sys.stderr)
    for id, camera in zip(writing.ids(found), found):
        if camera.trouble:
            print(f"vsense: {id}: {camera.id}: {camera.trouble}", file=sys.stderr)
    return 0


def _next(directory: Path, ids: list[str]) -> list[str]:
    """Gives the commands that lead on from here."""
    cameras = f"{len(ids)} camera{'' if len(ids) == 1 else 's'}"
    step = "" if directory == Path() else f"  cd {directory}\n"
    return [
        f"{cameras}: {', '.join(ids)}. What comes next:",
        f"{step}  vsense cameras tune {ids[0]} --resources {RESOURCES} --sweep",
        f"  vsense cameras shoot {RESOURCES} --board {BOARD} -o shoot",
        f"  vsense calibrate rig --board {BOARD} --pictures shoot --floor 'floor_*' -o cameras",
        f"and then: vsense track {RESOURCES} {EXPERIMENT}",
    ]
