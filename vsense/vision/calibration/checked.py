"""How far the calibration in use is off, by points that a person has measured.

Each camera says where it sees each point, on the plane of the point's height; that is held against
where the tape says it is. A common shift or turn of all of them is the arena frame's, and told
apart from what remains: that is the cameras'.

`vsense camera calibrate check` writes `report/check.json` beside the camera files. It holds a
digest of each camera, so that a check says when it is of another calibration than the one in use.
Later runs tell what was checked.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.arena import Floats
from vsense.base.errors import ConfigError
from vsense.base.files import parse_json, read_text
from vsense.vision.calibration._placement import places_by_id, read_pixels
from vsense.vision.calibration._views import number_at, read_table
from vsense.vision.calibration.frame import FrameShift
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking.specs import TrackingSession

CAMERA_CHECK_FILE = Path("report", "check.json")
"""Beside the camera files."""

_DIGITS = 16
_NUMBERS = ("points", "rms_mm", "worst_mm", "shape_rms_mm")


def digest(camera: Camera) -> str:
    """Returns what tells a camera's calibration from every other one, whatever its name."""
    values = json.loads(camera.to_json())
    del values["id"]
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:_DIGITS]


def of_session(cameras: Mapping[str, tuple[Camera, Path]]) -> dict[str, Any]:
    """Gives what is known of the cameras of a run, for its recordings and reports.

    Args:
        cameras: by name each camera, and its file.

    Returns:
        `checked`: whether all of them were checked as they are; `unchecked` and `stale`: names of
        those that never were, and of those whose calibration has changed since; `checks`: `when`,
        `points`, `rms_mm`, `worst_mm` and `shape_rms_mm` of each check, the newest last.
    """
    checks: dict[Path, dict[str, Any]] = {}
    for folder in {file.parent for _, file in cameras.values()}:
        check = _read(folder / CAMERA_CHECK_FILE)
        if check is not None:
            checks[folder] = check
    unchecked, stale = [], []
    for name, (camera, file) in sorted(cameras.items()):
        digests = checks.get(file.parent, {}).get("cameras", {}).values()
        if not digests:
            unchecked.append(name)
        elif digest(camera) not in digests:
            stale.append(name)
    ordered = sorted(checks.values(), key=lambda check: str(check.get("when", "")))
    return {
        "checked": bool(cameras) and not unchecked and not stale,
        "unchecked": unchecked,
        "stale": stale,
        "checks": [{name: check.get(name) for name in ("when", *_NUMBERS)} for check in ordered],
    }


def of_tracking(session: TrackingSession) -> dict[str, Any]:
    """`of_session` of a tracking session's cameras; of cameras without files: nothing is known."""
    files = session.resources.cameras
    views = [view for view in session.views if view.camera.id in files]
    return of_session({v.camera.id: (v.camera, files[v.camera.id].calibration) for v in views})


def _read(path: Path) -> dict[str, Any] | None:
    """A check's file; None where there is none that can be read."""
    try:
        data = parse_json(read_text(path))
    except (OSError, ValueError):
        return None
    if not isinstance(data, dict) or not isinstance(data.get("cameras"), dict):
        return None
    return {name: value for name, value in data.items() if _is_plain(name, value)}


def _is_plain(name: str, value: object) -> bool:
    if name in _NUMBERS:
        return isinstance(value, (int, float)) and math.isfinite(value)
    return name != "when" or isinstance(value, str)


PLACE_COLUMNS = ("id", "x_m", "y_m")
HEIGHT_COLUMN = "z_m"
DISTANCE_COLUMNS = ("from", "to", "distance_m")


@dataclass(frozen=True, slots=True)
class PointSight:
    """A point as one camera sees it: its name, and its pixel (2,)."""

    camera: str
    point: str
    pixel: Floats


@dataclass(frozen=True, slots=True)
class TapeDistance:
    """What a tape says between two points [m]."""

    first: str
    second: str
    distance_m: float


@dataclass(frozen=True, slots=True)
class PointCheck:
    """The calibration at measured points; arrays follow `sights`.

    Attributes:
        off_m: (n, 2) seen minus measured.
        left_m: (n, 2) the same when the frame as a whole is where it fits best.
        shift: from the frame in use to that one; None for a single place.
        apart_m: (k,) seen minus measured, of `distances`.
    """

    cameras: Mapping[str, Camera]
    sights: Sequence[PointSight]
    off_m: Floats
    left_m: Floats
    shift: FrameShift | None
    distances: Sequence[TapeDistance]
    apart_m: Floats

    @property
    def points(self) -> int:
        """How many points were seen."""
        return len({sight.point for sight in self.sights})

    def of(self, camera: str) -> Floats:
        """(m,) how far off one camera sees its points [m]."""
        mine = np.array([sight.camera == camera for sight in self.sights], dtype=bool)
        return np.asarray(np.linalg.norm(self.off_m[mine], axis=1))


def check(
    cameras: Mapping[str, Camera],
    points_m: Mapping[str, Floats],
    sights: Sequence[PointSight],
    distances: Sequence[TapeDistance] = (),
) -> PointCheck:
    """Holds what cameras see against measured points.

    Args:
        points_m: by name (3,) places in the arena frame.
        sights: of those points by those cameras, one at least.
        distances: between points that are among `sights`.
    """
    seen = np.array(
        [
            cameras[sight.camera].to_plane(sight.pixel, float(points_m[sight.point][2]))
            for sight in sights
        ]
    )
    wanted = np.array([points_m[sight.point][:2] for sight in sights])
    shift = None
    if len({sight.point for sight in sights}) > 1:
        shift = FrameShift.between(seen, wanted)
    left = (shift.apply(seen) if shift else seen) - wanted
    middle = {
        name: np.mean([place for place, s in zip(seen, sights) if s.point == name], axis=0)
        for name in {sight.point for sight in sights}
    }
    apart = [
        np.hypot(
            np.linalg.norm(middle[tape.first] - middle[tape.second]),
            points_m[tape.first][2] - points_m[tape.second][2],
        )
        - tape.distance_m
        for tape in distances
    ]
    return PointCheck(cameras, sights, seen - wanted, left, shift, distances, np.array(apart))


def read_places(path: Path) -> dict[str, Floats]:
    """Reads measured points, `id,x_m,y_m` and perhaps `z_m`; raises UsageError or ConfigError."""
    try:
        rows = read_table(path, (*PLACE_COLUMNS, HEIGHT_COLUMN))
        names: tuple[str, ...] = (*PLACE_COLUMNS[1:], HEIGHT_COLUMN)
    except ConfigError:
        rows, names = read_table(path, PLACE_COLUMNS), PLACE_COLUMNS[1:]
    points = places_by_id(path, rows, names)
    if not points:
        raise ConfigError(str(path), 1, "no point: expected one at least")
    return points


def read_distances(path: Path, points: Mapping[str, Floats]) -> list[TapeDistance]:
    """Reads distances between points, `from,to,distance_m`; raises as `read_places`."""
    distances = []
    for line, (first, second, text) in read_table(path, DISTANCE_COLUMNS):
        for column, name in zip(DISTANCE_COLUMNS, (first, second)):
            if name not in points:
                raise ConfigError(str(path), line, f"{column}: '{name}' is not among the points")
        distance = number_at(path, line, DISTANCE_COLUMNS[2], text)
        if not distance > 0.0:
            raise ConfigError(str(path), line, f"distance_m: '{text}' is not above 0")
        distances.append(TapeDistance(first, second, distance))
    return distances


def as_json(result: PointCheck, when: str, how: str) -> dict[str, Any]:
    """The check as its file has it; lengths in mm."""
    off = np.linalg.norm(result.off_m, axis=1)
    return {
        "when": when,
        "how": how,
        "cameras": {name: digest(camera) for name, camera in sorted(result.cameras.items())},
        "points": result.points,
        "rms_mm": _mm(rms(off)),
        "worst_mm": _mm(float(off.max())),
        "shape_rms_mm": _mm(rms(np.linalg.norm(result.left_m, axis=1))),
        "frame": None if result.shift is None else _frame(result.shift),
        "of_cameras": {
            name: _camera(result.of(name)) for name in sorted({s.camera for s in result.sights})
        },
        "sights": [
            {"point": s.point, "camera": s.camera, "x_mm": _mm(x), "y_mm": _mm(y)}
            for s, (x, y) in zip(result.sights, result.off_m.tolist())
        ],
        "distances": [
            {
                "from": t.first,
                "to": t.second,
                "measured_mm": _mm(t.distance_m),
                "off_mm": _mm(off_m),
            }
            for t, off_m in zip(result.distances, result.apart_m.tolist())
        ],
    }


def _frame(shift: FrameShift) -> dict[str, float]:
    yaw_deg = round(float(np.degrees(shift.yaw_rad)), 4)
    return {"x_mm": _mm(shift.x_m), "y_mm": _mm(shift.y_m), "yaw_deg": yaw_deg}


def _camera(off_m: Floats) -> dict[str, float]:
    return {"points": len(off_m), "rms_mm": _mm(rms(off_m)), "worst_mm": _mm(float(off_m.max()))}


def steps_m(result: PointCheck) -> dict[tuple[str, str], float]:
    """How far apart two cameras see the same points at most, by the pair of cameras [m]."""
    by_point: dict[str, list[tuple[str, Floats]]] = {}
    for sight, off in zip(result.sights, result.off_m):
        by_point.setdefault(sight.point, []).append((sight.camera, off))
    steps: dict[tuple[str, str], float] = {}
    for seen in by_point.values():
        for (first, here), (other, there) in combinations(sorted(seen, key=lambda s: s[0]), 2):
            apart = float(np.linalg.norm(here - there))
            if first != other:
                steps[first, other] = max(apart, steps.get((first, other), 0.0))
    return steps


def rms(lengths: Floats) -> float:
    """Root mean square of (n,) lengths; 0 of none."""
    return float(np.sqrt((lengths**2).mean())) if lengths.size else 0.0


def _mm(length_m: float) -> float:
    return round(1e3 * length_m, 2)


def read_seen(
    path: Path, points: Mapping[str, Floats], cameras: Mapping[str, Camera]
) -> list[PointSight]:
    """Reads where cameras see points, `camera,id,x_px,y_px`; raises UsageError or ConfigError."""
    rows = read_pixels(path, points, cameras, "the points")
    return [PointSight(camera, id, np.array(pixel)) for camera, id, pixel in rows]
