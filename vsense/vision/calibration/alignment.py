"""`vsense camera arena align`: the arena frame moved onto the real walls, for all cameras together.

Where the arena is, is not in the experiment: it says how large the arena is, and the camera files
say where. So all camera files turn and shift together, and whatever uses them follows. How the
cameras are to each other, which the pictures of a board have said, stays as it is to the last bit
that a rotation leaves.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.arena import Floats, Image
from vsense.base.errors import UsageError, failing_as
from vsense.base.files import parse_json, replace_text
from vsense.base.terminal import aligned
from vsense.vision.calibration._pictures import gather, inspect
from vsense.vision.calibration.checked import CAMERA_CHECK_FILE as CHECK
from vsense.vision.calibration.checked import PointSight, read_places, read_seen, rms
from vsense.vision.calibration.frame import FrameShift
from vsense.vision.calibration.session import cameras_of
from vsense.vision.cameras.camera import Camera

CORNERS = ("sw", "se", "ne", "nw")
"""Names of an arena's corners: south is low y, west low x."""
ALIGN = Path("report", "align.json")
BEFORE_ALIGN = Path("report", "before-align")
"""Beside the camera files: what was found, and the camera files as they were before."""
FAR_M = 0.01
"""A corner that is farther off than this after the shift was clicked wrongly, or is not where the
experiment says."""
_SAME = 1e-5
"""What the rounding of a shift in `ALIGN` may change: in m, and of a rotation."""


@dataclass(frozen=True, slots=True)
class Alignment:
    """The shift that brings what was clicked to where it is to be.

    Attributes:
        shift: from the frame of the camera files to the arena's.
        off_m: (n, 2) what remains at each click, seen minus wanted.
    """

    clicks: Sequence[PointSight]
    shift: FrameShift
    off_m: Floats

    @property
    def rms_m(self) -> float:
        """Root mean square of what remains."""
        return rms(np.linalg.norm(self.off_m, axis=1))

    @property
    def worst_m(self) -> float:
        """The largest of what remains."""
        return float(np.linalg.norm(self.off_m, axis=1).max())


def solve(
    cameras: Mapping[str, Camera], points_m: Mapping[str, Floats], clicks: Sequence[PointSight]
) -> Alignment:
    """Finds the shift by least squares.

    Args:
        points_m: by name (3,) where each point is to be.
        clicks: where cameras show them; two different points at least.

    Raises:
        UsageError: there are fewer points, or one is no place for its camera.
    """
    if len({click.point for click in clicks}) < 2:
        raise UsageError("expected clicks on two different points or more")
    seen = np.array(
        [cameras[c.camera].to_plane(c.pixel, float(points_m[c.point][2])) for c in clicks]
    )
    for click, place in zip(clicks, seen):
        if not np.isfinite(place).all():
            raise UsageError(f"click on {click.point}: {click.camera} shows no floor there")
    wanted = np.array([points_m[click.point][:2] for click in clicks])
    shift = FrameShift.between(seen, wanted)
    return Alignment(clicks, shift, shift.apply(seen) - wanted)


def points_of(
    corners_m: Sequence[Sequence[float]], height_m: float, path: Path | None = None
) -> dict[str, Floats]:
    """The corners of an arena by their names, at a height above the floor; or a file's points.

    Raises UsageError or ConfigError where the file cannot be used.
    """
    if path is not None:
        return read_places(path)
    return {name: np.array((x, y, height_m)) for name, (x, y) in zip(CORNERS, corners_m)}


_CLICK = re.compile(r"(?P<camera>.+):(?P<point>[^:]+):(?P<x>[^:,]+),(?P<y>[^:,]+)")


def sights_of(
    clicks: Sequence[str],
    seen: Path | None,
    cameras: Mapping[str, Camera],
    points: Mapping[str, Floats],
) -> list[PointSight]:
    """Reads where cameras see points: `CAMERA:POINT:X,Y` each, and a table `seen`.

    Raises UsageError or ConfigError.
    """
    sights = [_clicked(text, cameras, points) for text in clicks]
    return sights + (read_seen(seen, points, cameras) if seen else [])


def _clicked(text: str, cameras: Mapping[str, Camera], points: Mapping[str, Floats]) -> PointSight:
    match = _CLICK.fullmatch(text)
    if match is None:
        raise UsageError(f"--click {text}: expected CAMERA:POINT:X,Y such as cam_0_0:sw:212,1003")
    for name, names in (("camera", cameras), ("point", points)):
        if match[name] not in names:
            raise UsageError(f"--click {text}: {name} is not one of: {', '.join(names)}")
    try:
        pixel = np.array((float(match["x"]), float(match["y"])))
    except ValueError:
        pixel = np.full(2, np.nan)
    if not np.isfinite(pixel).all() or not cameras[match["camera"]].contains(pixel):
        raise UsageError(f"--click {text}: '{match['x']},{match['y']}' is no pixel of that camera")
    return PointSight(match["camera"], match["point"], pixel)


MOST_CLICKS = 400


def read_clicks(
    clicks: object, cameras: Mapping[str, Camera], points: Mapping[str, Floats]
) -> list[PointSight]:
    """Reads a page's clicks, objects of camera, point, x and y; raises UsageError."""
    if not isinstance(clicks, list) or len(clicks) > MOST_CLICKS:
        raise UsageError("clicks: expected a list")
    sights = []
    for click in clicks:
        try:
            camera, point = str(click["camera"]), str(click["point"])
            pixel = np.array((float(click["x"]), float(click["y"])))
        except (TypeError, KeyError, ValueError, OverflowError):
            raise UsageError("a click: expected camera, point, x and y") from None
        if camera not in cameras or point not in points:
            raise UsageError(f"a click on {point[:40]!r} in {camera[:40]!r}: not known here")
        if not np.isfinite(pixel).all() or not cameras[camera].contains(pixel):
            raise UsageError(f"a click on {point}: outside of the picture")
        sights.append(PointSight(camera, point, pixel))
    return sights


def pictures_of(
    paths: Sequence[Path], camera: str | None, cameras: Mapping[str, Camera], folder: Path
) -> dict[str, Image]:
    """Reads each camera's last picture, (h, w) uint8.

    `camera`: all pictures are its own, whatever their folders. `folder` has the cameras' files.
    Raises UsageError where a picture cannot be used.
    """
    images: dict[str, Image] = {}
    pictures = {(camera or picture.camera): picture for picture in gather(paths)}
    for name in pictures:
        if name not in cameras:
            raise UsageError(
                f"--pictures: camera {name}: {folder} has no file of it; expected"
                f" {', '.join(cameras)}, as folder of the pictures or with --camera"
            )
    names = {picture: name for name, picture in pictures.items()}
    looked = inspect(list(names), lambda: lambda image: image, lambda done, total: None)
    for picture, size, image in looked:
        calibration = cameras[names[picture]]
        if size != (calibration.width_px, calibration.height_px):
            raise UsageError(
                f"{picture.path}: {size[0]} x {size[1]} px, expected {calibration.width_px} x"
                f" {calibration.height_px} as in the file of {calibration.id}"
            )
        images[calibration.id] = image
    return images


def apply(folder: Path, result: Alignment) -> list[Path]:
    """Moves all camera files of a folder, and keeps those from before in `BEFORE_ALIGN`.

    A file is whole at any moment. Returns the files; raises UsageError where one cannot be written.
    """
    cameras = cameras_of("--cameras", folder)
    files = {Camera.from_json(path.read_text()).id: path for path in sorted(folder.glob("*.json"))}
    with failing_as(UsageError, f"{folder}: cannot be written"):
        (folder / BEFORE_ALIGN).mkdir(parents=True, exist_ok=True)
        (folder / ALIGN).unlink(missing_ok=True)  # of an earlier time; it stands for whole moves
        for path in files.values():
            shutil.copyfile(path, folder / BEFORE_ALIGN / path.name)
        for id, path in files.items():
            replace_text(path, result.shift.moved(cameras[id]).to_json() + "\n")
        (folder / ALIGN).write_text(json.dumps(as_json(result), indent=2) + "\n", encoding="utf-8")
    return list(files.values())


def undo(folder: Path) -> list[Path]:
    """Puts the camera files back that `apply` has kept.

    UsageError where there are none, or where the cameras were calibrated anew since.
    """
    files = sorted((folder / BEFORE_ALIGN).glob("*.json"))
    if not files:
        raise UsageError(f"{folder / BEFORE_ALIGN}: nothing was aligned here, or it was undone")
    for path in files:
        if not _is_moved(path, folder / path.name, folder / ALIGN):
            raise UsageError(
                f"{folder / path.name}: is not what was aligned, it was made again since; what was"
                f" before that is in {folder / BEFORE_ALIGN}"
            )
    with failing_as(UsageError, f"{folder}: cannot be written"):
        for path in files:
            replace_text(folder / path.name, path.read_text(encoding="utf-8"))
        shutil.rmtree(folder / BEFORE_ALIGN)
        (folder / ALIGN).unlink(missing_ok=True)
    return [folder / path.name for path in files]


def _is_moved(before: Path, after: Path, file: Path) -> bool:
    """Whether a camera file is another one moved as a file of `apply` says, as far as that tells.

    Where files were moved by halves, as they were is right, too.
    """
    try:
        shift = (
            parse_json(file.read_text(encoding="utf-8"))["shift"] if os.path.exists(file) else None
        )
        old, now = (Camera.from_json(path.read_text()) for path in (before, after))
    except (OSError, ValueError, KeyError, TypeError):
        return True
    if shift is None:
        return True
    yaw_rad = math.radians(shift["yaw_deg"])
    moved = FrameShift(1e-3 * shift["x_mm"], 1e-3 * shift["y_mm"], yaw_rad).moved(old)
    return now == old or (
        np.allclose(now.position_m, moved.position_m, rtol=0.0, atol=_SAME)
        and np.allclose(now.rotation, moved.rotation, rtol=0.0, atol=_SAME)
        and now.fx_px == old.fx_px
    )


def as_json(result: Alignment) -> dict[str, Any]:
    """What was found, for the file and for scripts; lengths in mm."""
    return {
        "when": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "shift": {
            "x_mm": round(1e3 * result.shift.x_m, 3),
            "y_mm": round(1e3 * result.shift.y_m, 3),
            "yaw_deg": round(float(np.degrees(result.shift.yaw_rad)), 5),
        },
        "rms_mm": round(1e3 * result.rms_m, 2),
        "worst_mm": round(1e3 * result.worst_m, 2),
        "clicks": [
            {
                "point": click.point,
                "camera": click.camera,
                "pixel": [round(float(v), 2) for v in click.pixel],
                "off_mm": [round(1e3 * float(v), 2) for v in off],
            }
            for click, off in zip(result.clicks, result.off_m)
        ],
    }


def as_text(result: Alignment) -> list[str]:
    """What was found as lines: what remains at each click, and the shift."""
    rows: list[tuple[str, ...]] = [("point", "camera", "x mm", "y mm", "left mm")]
    for click, (x, y) in zip(result.clicks, (1e3 * result.off_m).tolist()):
        left = f"{float(np.hypot(x, y)):.1f}"
        rows.append((click.point, click.camera, f"{x:+.1f}", f"{y:+.1f}", left))
    lines = [
        *aligned(rows, left=2),
        f"the frame moves {result.shift.in_words()}; {1e3 * result.rms_m:.1f} mm rms are left",
    ]
    if result.worst_m > FAR_M:
        lines.append(
            f"{1e3 * result.worst_m:.0f} mm at worst: a click is wrong, or the real arena is not as"
            " large as the experiment's"
        )
    return lines


def stale_check(folder: Path) -> str:
    """What to say of an earlier check; "" where there was none."""
    if not os.path.exists(folder / CHECK):
        return ""
    return "the calibration was checked before it was moved: vsense camera calibrate check again"
