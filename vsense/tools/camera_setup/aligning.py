"""`vsense arena align`, from camera files and pictures or pixels to moved camera files."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vsense.base.errors import UsageError
from vsense.base.terminal import interruption
from vsense.tools.camera_setup.align_page import AlignServer, AlignTask
from vsense.vision.calibration import alignment
from vsense.vision.calibration.alignment import Alignment
from vsense.vision.calibration.check import PointSight, read_places
from vsense.vision.calibration.checking import read_seen
from vsense.vision.calibration.pictures import gather, inspect
from vsense.vision.calibration.session import cameras_of
from vsense.vision.cameras.camera import Camera, Floats
from vsense.vision.cameras.picture import Image

_CLICK = re.compile(r"(?P<camera>.+):(?P<point>[^:]+):(?P<x>[^:,]+),(?P<y>[^:,]+)")


@dataclass(frozen=True, slots=True)
class AlignOptions:
    """How the frame is moved; see `vsense arena align -h`. `height` is in m."""

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
    points = alignment.points_of(corners_m, options.height)
    if options.points:
        points = read_places(options.points)
    clicks = [parse_click(text, cameras, points) for text in options.clicks]
    if options.seen:
        clicks += read_seen(options.seen, points, cameras)
    if not clicks:
        return _with_page(options, cameras, points, np.array(corners_m))
    found = alignment.solve(cameras, points, clicks)
    _deliver(options, found)
    print(json.dumps(alignment.as_json(found), indent=2) if options.json else options.cameras)
    return 0


def undo(folder: Path) -> int:
    """Puts camera files back as they were; returns 0."""
    for path in alignment.undo(folder):
        print(path)
    _say("the camera files are as they were before")
    return 0


def parse_click(
    text: str, cameras: Mapping[str, Camera], points: Mapping[str, Floats]
) -> PointSight:
    """Reads `CAMERA:POINT:X,Y`; raises UsageError."""
    found = _CLICK.fullmatch(text)
    if found is None:
        raise UsageError(f"--click {text}: expected CAMERA:POINT:X,Y such as cam_0_0:sw:212,1003")
    for name, known in (("camera", cameras), ("point", points)):
        if found[name] not in known:
            raise UsageError(f"--click {text}: {name} is not one of: {', '.join(known)}")
    try:
        pixel = np.array((float(found["x"]), float(found["y"])))
    except ValueError:
        pixel = np.full(2, np.nan)
    if not np.isfinite(pixel).all() or not cameras[found["camera"]].contains(pixel):
        raise UsageError(f"--click {text}: '{found['x']},{found['y']}' is no pixel of that camera")
    return PointSight(found["camera"], found["point"], pixel)


def _with_page(
    options: AlignOptions,
    cameras: Mapping[str, Camera],
    points: Mapping[str, Floats],
    corners_m: Floats,
) -> int:
    """Serves the page until something was saved, or Ctrl-C."""
    if not options.pictures:
        raise UsageError(
            "expected --pictures, of all cameras at one moment (vsense cameras shoot takes them),"
            " or --click, or --seen"
        )
    pictures = _pictures(options, cameras)
    outline = np.column_stack((corners_m, np.full(len(corners_m), options.height)))
    task = AlignTask(cameras, points, outline, pictures, lambda found: _deliver(options, found))
    with interruption() as interrupted, AlignServer(task, options.port) as server:
        _say(f"open {server.url} in a browser on this machine; Ctrl-C ends without a change")
        server.serve_until(interrupted.wait)
        if task.saved is None:
            _say("nothing was changed")
            return interrupted.code
    print(json.dumps(alignment.as_json(task.saved), indent=2) if options.json else options.cameras)
    return 0


def _pictures(options: AlignOptions, cameras: Mapping[str, Camera]) -> dict[str, Image]:
    """Each camera's last picture."""
    assert options.pictures is not None
    found: dict[str, Image] = {}
    pictures = {(options.camera or one.camera): one for one in gather(options.pictures)}
    for name in pictures:
        if name not in cameras:
            raise UsageError(
                f"--pictures: camera {name}: {options.cameras} has no file of it; expected"
                f" {', '.join(cameras)}, as folder of the pictures or with --camera"
            )
    names = {one: name for name, one in pictures.items()}
    looked = inspect(list(names), lambda: lambda image: image, lambda done, total: None)
    for one, size, image in looked:
        camera = cameras[names[one]]
        if size != (camera.width_px, camera.height_px):
            raise UsageError(
                f"{one.path}: {size[0]} x {size[1]} px, expected {camera.width_px} x"
                f" {camera.height_px} as in the file of {camera.id}"
            )
        found[camera.id] = image
    return found


def _deliver(options: AlignOptions, found: Alignment) -> None:
    """Says what was found, and moves the camera files unless that was not wanted."""
    for line in alignment.as_text(found):
        _say(line)
    if options.dry:
        _say("nothing was changed (--dry)")
        return
    files = alignment.apply(options.cameras, found)
    before = options.cameras / alignment.BEFORE
    _say(f"{len(files)} camera files moved; as they were: {before} (--undo puts them back)")
    stale = alignment.stale_check(options.cameras)
    if stale:
        _say(stale)


def _say(text: str) -> None:
    print(text, file=sys.stderr)
