"""`vsense camera arena align`, from camera files and pictures or pixels to moved camera files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vsense.base.arena import Floats
from vsense.base.errors import UsageError
from vsense.base.terminal import Console, interruption, print_data
from vsense.tools.camera_setup._align_page import AlignServer, AlignTask
from vsense.vision.calibration import alignment
from vsense.vision.calibration.alignment import Alignment
from vsense.vision.calibration.session import cameras_of
from vsense.vision.cameras.camera import Camera


@dataclass(frozen=True, slots=True)
class AlignOptions:
    """How the frame is moved; see `vsense camera arena align -h`. `height` is in m."""

    cameras: Path
    points: Path | None
    height: float
    clicks: list[str]
    seen: Path | None
    pictures: list[Path] | None
    camera: str | None
    port: int
    dry: bool
    json: bool


def run(options: AlignOptions, corners_m: Sequence[Sequence[float]]) -> int:
    """Finds where the frame is to be, says what remains, and moves the camera files.

    `corners_m` are those of the experiment's arena. Returns 0, or 130 where the page was left.

    Raises:
        UsageError, ConfigError: options or files are wrong.
        VsenseError: the page cannot be served.
    """
    cameras = cameras_of("--cameras", options.cameras)
    points = alignment.points_of(corners_m, options.height, options.points)
    clicks = alignment.sights_of(options.clicks, options.seen, cameras, points)
    if not clicks:
        return _with_page(options, cameras, points, np.array(corners_m))
    solution = alignment.solve(cameras, points, clicks)
    _deliver(options, solution)
    _print(options, solution)
    return 0


def undo(folder: Path) -> int:
    """Puts camera files back as they were; returns 0."""
    for path in alignment.undo(folder):
        print_data(str(path))
    _say("the camera files are as they were before")
    return 0


def _with_page(
    options: AlignOptions,
    cameras: Mapping[str, Camera],
    points: Mapping[str, Floats],
    corners_m: Floats,
) -> int:
    """Serves the page until something was saved, or Ctrl-C."""
    if not options.pictures:
        raise UsageError(
            "expected --pictures, of all cameras at one moment (vsense camera shoot takes them),"
            " or --click, or --seen"
        )
    pictures = alignment.pictures_of(options.pictures, options.camera, cameras, options.cameras)
    outline = np.column_stack((corners_m, np.full(len(corners_m), options.height)))
    task = AlignTask(cameras, points, outline, pictures, lambda fit: _deliver(options, fit))
    with interruption() as interrupted, AlignServer(task, options.port) as server:
        _say(f"open {server.url} in a browser on this machine; Ctrl-C ends without a change")
        server.serve_until(interrupted.wait)
        if task.saved is None:
            _say("nothing was changed")
            return interrupted.code
    _print(options, task.saved)
    return 0


def _deliver(options: AlignOptions, solution: Alignment) -> None:
    """Says what was found, and moves the camera files unless that was not wanted."""
    for line in alignment.as_text(solution):
        _say(line)
    if options.dry:
        _say("nothing was changed (--dry)")
        return
    files = alignment.apply(options.cameras, solution)
    before = options.cameras / alignment.BEFORE_ALIGN
    _say(f"{len(files)} camera files moved; as they were: {before} (--undo puts them back)")
    stale = alignment.stale_check(options.cameras)
    if stale:
        _say(stale)


def _print(options: AlignOptions, found: Alignment) -> None:
    facts = json.dumps(alignment.as_json(found), indent=2) if options.json else ""
    print_data(facts or str(options.cameras))


def _say(text: str) -> None:
    Console().say(text)
