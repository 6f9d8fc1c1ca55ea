"""What was checked of a calibration, kept beside its camera files, and told with later runs.

`vsense camera calibrate check` writes `report/check.json` beside the camera files. It holds a
digest of each camera, so that a check says when it is of another calibration than the one in use.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vsense.base.files import parse_json, read_text
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
