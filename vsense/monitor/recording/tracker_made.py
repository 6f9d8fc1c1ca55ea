"""What an arena tracker is made from, as JSON can hold it, and a tracker made from that.

Lab and tracking session build their trackers in different ways; both are cameras, each with what is
looked for in its pictures, and limits. Marker families are written out, so that a family of the
user's own comes with the recording.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from importlib import resources
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

from vsense import __version__
from vsense.base.errors import UsageError, VsenseError
from vsense.config.roster_fields import MarkerOffset
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, SquareFamily, load_family
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.marker_offsets import PlacedMarker
from vsense.vision.tracking.mask import Mask
from vsense.vision.tracking.prediction import MarkerSearch, SearchPlan
from vsense.vision.tracking.specs import TrackingSession
from vsense.vision.tracking.tracks import Limits

Made = dict[str, Any]
"""`cameras`: camera files; `sees`: by the camera's id the tracker that looks at its pictures;
`trackers`: by id `family`, `heading_deg`, `heights_m` (pairs of tag and height), `open_roster`, and
where there is a mask `mask_m` (its corners) and `mask_margin_m`;
`limits`, `plan`, `workers`; `offsets`: by tag where markers sit on their robots, x, y [m] and yaw
[rad], absent where none is known; `versions` of what computed."""

Offsets = Mapping[int, PlacedMarker]
_NO_OFFSETS: Offsets = {}

_MOST_WORKERS = 64


def of_family(
    cameras: Sequence[Camera],
    family: str,
    heights_m: Mapping[int, float],
    workers: int = 2,
    offsets: Offsets = _NO_OFFSETS,
) -> Made:
    """Describes `ArenaTracker.for_family(cameras, load_family(family), heights_m)` with `offsets`.

    VsenseError if there is no such family.
    """
    tracker = _tracker(family, 0.0, heights_m, True)
    sees = {camera.id: "robots" for camera in cameras}
    made = _made(cameras, sees, {"robots": tracker}, Limits(), SearchPlan(), workers)
    return made | _offsets(offsets)


def of_session(session: TrackingSession) -> Made:
    """Describes the tracker of `vsense.vision.tracking.opening.open_tracking`.

    VsenseError if there is no such family.
    """
    specs = {view.tracker.id: view.tracker for view in session.views}
    masked = _masked(session.mask)
    trackers = {
        id: {**_tracker(spec.family, spec.heading_deg, spec.heights_m, spec.open_roster), **masked}
        for id, spec in specs.items()
    }
    made = _made(
        [view.camera for view in session.views],
        {view.camera.id: view.tracker.id for view in session.views},
        trackers,
        Limits(max(spec.max_speed_m_s for spec in specs.values())),
        SearchPlan(session.key_frame_period, session.square_size_m),
        2,
    )
    return made | _offsets(session.offsets)


def make(made: Made) -> ArenaTracker:
    """Makes the tracker that was described; VsenseError if the description is damaged."""
    try:
        return _make(made)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise VsenseError(f"the description of the tracker is damaged: {error!r}") from None


def versions() -> dict[str, str]:
    """Versions of what decides the last bit of a result."""
    return {"vsense": __version__, "opencv": cv2.__version__, "numpy": np.__version__}


def _made(
    cameras: Sequence[Camera],
    sees: Mapping[str, str],
    trackers: Mapping[str, Made],
    limits: Limits,
    plan: SearchPlan,
    workers: int,
) -> Made:
    return {
        "cameras": [json.loads(camera.to_json()) for camera in cameras],
        "sees": dict(sees),
        "trackers": dict(trackers),
        "limits": asdict(limits),
        "plan": asdict(plan),
        "workers": workers,
        "versions": versions(),
    }


def _offsets(offsets: Offsets) -> Made:
    """The part of a description that says where markers sit; none where nothing is known."""
    rows = [[tag, marker.x_m, marker.y_m, marker.yaw_rad] for tag, marker in offsets.items()]
    return {"offsets": rows} if rows else {}


def _tracker(
    family: str, heading_deg: float, heights_m: Mapping[int, float], open_roster: bool
) -> Made:
    load_family(family)
    if family.endswith(".json"):
        text = Path(family).read_text(encoding="utf-8")
    else:
        file = resources.files("vsense.vision.markers") / "families" / f"{family}.json"
        text = file.read_text(encoding="utf-8")
    return {
        "family": json.loads(text),
        "heading_deg": heading_deg,
        "heights_m": [[tag, height_m] for tag, height_m in heights_m.items()],
        "open_roster": open_roster,
    }


def _make(made: Made) -> ArenaTracker:
    cameras = [Camera.from_json(json.dumps(camera)) for camera in made["cameras"]]
    trackers = {id: made["trackers"][id] for id in made["sees"].values()}
    searches = {
        id: MarkerSearch(
            _family(tracker),
            _heights_m(tracker),
            bool(tracker["open_roster"]),
            mask=_mask(tracker),
        )
        for id, tracker in trackers.items()
    }
    limits, plan = Limits(**made["limits"]), SearchPlan(**made["plan"])
    workers = int(made["workers"])
    if workers > _MOST_WORKERS:
        raise ValueError(f"{workers} workers")
    return ArenaTracker.of_searches(
        cameras,
        [searches[made["sees"][camera.id]] for camera in cameras],
        limits,
        plan,
        workers,
        offsets={
            int(tag): MarkerOffset(float(x_m), float(y_m), float(yaw_rad))
            for tag, x_m, y_m, yaw_rad in made.get("offsets", ())
        },
    )


def _family(tracker: Made) -> MarkerFamily | SquareFamily:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "family.json"
        file.write_text(json.dumps(tracker["family"]), encoding="utf-8")
        family = load_family(str(file))
    if isinstance(family, SquareFamily):
        return replace(family, heading_deg=family.heading_deg + tracker["heading_deg"])
    return family


def _masked(mask: Mask | None) -> Made:
    if mask is None:
        return {}
    return {"mask_m": [list(corner) for corner in mask.outline_m], "mask_margin_m": mask.margin_m}


def _mask(tracker: Made) -> Mask | None:
    if "mask_m" not in tracker:
        return None
    corners = tuple((float(x), float(y)) for x, y in tracker["mask_m"])
    return Mask(corners, float(tracker["mask_margin_m"]))


def _heights_m(tracker: Made) -> dict[int, float]:
    return {int(tag): float(height_m) for tag, height_m in tracker["heights_m"]}


HEIGHT = "tracker.height_m"
"""Of all markers of all trackers."""


def change_settings(made: Mapping[str, Any], settings: Mapping[str, str]) -> dict[str, Any]:
    """Gives the description `made` with other settings.

    `settings` are by name: "limits.X", "plan.X", or "tracker.X" for all of its trackers.

    Raises:
        UsageError: a setting is not known, or its value is none.
    """
    changed = {**made, "limits": dict(made["limits"]), "plan": dict(made["plan"])}
    changed["trackers"] = {id: dict(tracker) for id, tracker in made["trackers"].items()}
    for key, text in settings.items():
        if key == HEIGHT:
            height_m = _value(key, 0.0, text)
            for tracker in changed["trackers"].values():
                tracker["heights_m"] = [[tag, height_m] for tag, _ in tracker["heights_m"]]
            continue
        parts, name = _parts(changed, key)
        for part in parts:
            part[name] = _value(key, part[name], text)
    return changed


def _parts(made: dict[str, Any], key: str) -> tuple[list[dict[str, Any]], str]:
    """Finds what holds a setting, and the setting's name there."""
    group, _, name = key.partition(".")
    groups = {
        "limits": [made["limits"]],
        "plan": [made["plan"]],
        "tracker": list(made["trackers"].values()),
    }
    parts = groups.get(group, [])
    if not any(isinstance(part.get(name), (bool, int, float)) for part in parts):
        known = [f"{g}.{n}" for g in ("limits", "plan") for n in made[g]]
        known += ["tracker.heading_deg", HEIGHT, "tracker.open_roster"]
        raise UsageError(f"{key}: is no setting of the tracker; known are {', '.join(known)}")
    return parts, name


def _value(key: str, before: bool | float, text: str) -> bool | float:
    """Reads a value of the same kind as the one before."""
    kinds = {bool: "true or false", int: "a whole number", float: "a number"}
    try:
        if isinstance(before, bool):
            return {"true": True, "false": False}[text]
        value = type(before)(text)
        if not math.isfinite(value):
            raise ValueError
    except (KeyError, ValueError):
        raise UsageError(f"{key}: {text!r} is not {kinds[type(before)]}") from None
    return value
