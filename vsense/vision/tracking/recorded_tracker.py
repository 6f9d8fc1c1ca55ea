"""An arena tracker as JSON can hold it: what it is made from, and what it remembers.

Lab and tracking session build their trackers in different ways; both are cameras, each with what is
looked for in its pictures, and limits. Marker families are written out, so that a family of the
user's own comes with the recording. With the memory of a timestep a recording can begin in the
middle: the same memory and the same pictures give the same states. Floats survive JSON bit for bit.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense import __version__
from vsense.base.errors import UsageError, VsenseError
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import (
    MarkerFamily,
    SquareFamily,
    definition_of,
    load_family,
    parse_family,
)
from vsense.vision.tracking._joining import _Candidate
from vsense.vision.tracking._prediction import (
    KNOWN,
    Anonymous,
    MarkerSearch,
    Prediction,
    SearchPlan,
)
from vsense.vision.tracking._tracks import TRACK, Limits
from vsense.vision.tracking._views import VIEW
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.mask import Mask
from vsense.vision.tracking.specs import PlacedMarker, TrackingSession

Description = dict[str, Any]
"""`cameras`: camera files; `sees`: by the camera's id the tracker that looks at its pictures;
`trackers`: by id `family`, `heading_deg`, `heights_m` (pairs of tag and height), `open_roster`, and
where there is a mask `mask_m` (its corners) and `mask_margin_m`;
`limits`, `plan`, `workers`; `offsets`: by tag where markers sit on their robots, x, y [m] and yaw
[rad], absent where none is known; `versions` of what computed."""

Offsets = Mapping[int, PlacedMarker]
_NO_OFFSETS: Offsets = {}

_MOST_WORKERS = 64


class _Placed(NamedTuple):
    x_m: float
    y_m: float
    yaw_rad: float


def of_family(
    cameras: Sequence[Camera],
    family: str,
    heights_m: Mapping[int, float],
    workers: int = 2,
    offsets: Offsets = _NO_OFFSETS,
) -> Description:
    """Describes `ArenaTracker.for_family(cameras, load_family(family), heights_m)` with `offsets`.

    VsenseError if there is no such family.
    """
    tracker = _tracker(family, 0.0, heights_m, True)
    sees = {camera.id: "robots" for camera in cameras}
    data = _describe(cameras, sees, {"robots": tracker}, Limits(), SearchPlan(), workers)
    return data | _offsets(offsets)


def of_session(session: TrackingSession) -> Description:
    """Describes the tracker of `vsense.vision.tracking.opening.open_tracking`.

    VsenseError if there is no such family.
    """
    specs = {view.tracker.id: view.tracker for view in session.views}
    masked = _masked(session.mask)
    trackers = {
        id: {**_tracker(spec.family, spec.heading_deg, spec.heights_m, spec.open_roster), **masked}
        for id, spec in specs.items()
    }
    data = _describe(
        [view.camera for view in session.views],
        {view.camera.id: view.tracker.id for view in session.views},
        trackers,
        Limits(max(spec.max_speed_m_s for spec in specs.values())),
        SearchPlan(session.key_frame_period, session.square_size_m),
        2,
    )
    return data | _offsets(session.offsets)


def make(data: Description) -> ArenaTracker:
    """Makes the tracker that was described; VsenseError if the description is damaged."""
    try:
        return _make(data)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise VsenseError(f"the description of the tracker is damaged: {error!r}") from None


def versions() -> dict[str, str]:
    """Versions of what decides the last bit of a result."""
    return {"vsense": __version__, "opencv": cv2.__version__, "numpy": np.__version__}


def _describe(
    cameras: Sequence[Camera],
    sees: Mapping[str, str],
    trackers: Mapping[str, Description],
    limits: Limits,
    plan: SearchPlan,
    workers: int,
) -> Description:
    return {
        "cameras": [json.loads(camera.to_json()) for camera in cameras],
        "sees": dict(sees),
        "trackers": dict(trackers),
        "limits": asdict(limits),
        "plan": asdict(plan),
        "workers": workers,
        "versions": versions(),
    }


def _offsets(offsets: Offsets) -> Description:
    """The part of a description that says where markers sit; none where nothing is known."""
    rows = [[tag, marker.x_m, marker.y_m, marker.yaw_rad] for tag, marker in offsets.items()]
    return {"offsets": rows} if rows else {}


def _tracker(
    family: str, heading_deg: float, heights_m: Mapping[int, float], open_roster: bool
) -> Description:
    load_family(family)
    return {
        "family": json.loads(definition_of(family)),
        "heading_deg": heading_deg,
        "heights_m": [[tag, height_m] for tag, height_m in heights_m.items()],
        "open_roster": open_roster,
    }


def seen_by(data: Description) -> tuple[list[Camera], list[MarkerSearch], SearchPlan]:
    """Returns a description's cameras, what is looked for by each, and how much is searched."""
    cameras = [Camera.from_json(json.dumps(camera)) for camera in data["cameras"]]
    trackers = {id: data["trackers"][id] for id in data["sees"].values()}
    searches = {
        id: MarkerSearch(
            _family(tracker),
            _heights_m(tracker),
            bool(tracker["open_roster"]),
            mask=_mask(tracker),
        )
        for id, tracker in trackers.items()
    }
    chosen = [searches[data["sees"][camera.id]] for camera in cameras]
    return cameras, chosen, SearchPlan(**data["plan"])


def _make(data: Description) -> ArenaTracker:
    cameras, searches, plan = seen_by(data)
    limits = Limits(**data["limits"])
    workers = int(data["workers"])
    if workers > _MOST_WORKERS:
        raise ValueError(f"{workers} workers")
    return ArenaTracker.of_searches(
        cameras,
        searches,
        limits,
        plan,
        workers,
        offsets={
            int(tag): _Placed(float(x_m), float(y_m), float(yaw_rad))
            for tag, x_m, y_m, yaw_rad in data.get("offsets", ())
        },
    )


def _family(tracker: Description) -> MarkerFamily | SquareFamily:
    family = parse_family("family.json", json.dumps(tracker["family"]))
    if isinstance(family, SquareFamily):
        return replace(family, heading_deg=family.heading_deg + tracker["heading_deg"])
    return family


def _masked(mask: Mask | None) -> Description:
    if mask is None:
        return {}
    return {"mask_m": [list(corner) for corner in mask.outline_m], "mask_margin_m": mask.margin_m}


def _mask(tracker: Description) -> Mask | None:
    if "mask_m" not in tracker:
        return None
    corners = tuple((float(x), float(y)) for x, y in tracker["mask_m"])
    return Mask(corners, float(tracker["mask_margin_m"]))


def _heights_m(tracker: Description) -> dict[int, float]:
    return {int(tag): float(height_m) for tag, height_m in tracker["heights_m"]}


HEIGHT = "tracker.height_m"
"""Of all markers of all trackers."""


def change_settings(data: Mapping[str, Any], settings: Mapping[str, str]) -> dict[str, Any]:
    """Gives the description `data` with other settings.

    `settings` are by name: "limits.X", "plan.X", or "tracker.X" for all of its trackers.

    Raises:
        UsageError: a setting is not known, or its value is none.
    """
    changed = {**data, "limits": dict(data["limits"]), "plan": dict(data["plan"])}
    changed["trackers"] = {id: dict(tracker) for id, tracker in data["trackers"].items()}
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


def _parts(data: dict[str, Any], key: str) -> tuple[list[dict[str, Any]], str]:
    """Finds what holds a setting, and the setting's name there."""
    group, _, name = key.partition(".")
    groups = {
        "limits": [data["limits"]],
        "plan": [data["plan"]],
        "tracker": list(data["trackers"].values()),
    }
    parts = groups.get(group, [])
    if not any(isinstance(part.get(name), (bool, int, float)) for part in parts):
        names = [f"{g}.{n}" for g in ("limits", "plan") for n in data[g]]
        names += ["tracker.heading_deg", HEIGHT, "tracker.open_roster"]
        raise UsageError(f"{key}: is no setting of the tracker; known are {', '.join(names)}")
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


_RECORDED = {"covariance": "spread", "height_sensitivity": "lean"}
"""Fields of a sighting that recordings hold under another name, as they do the prediction."""


def freeze(tracker: ArenaTracker) -> dict[str, Any]:
    """Gives a tracker's memory; to be called in its thread, between two timesteps."""
    tracker.learn()
    return {
        "newest": tracker._gate._newest,
        "heights_m": [[tag, height] for tag, height in tracker.heights_m.items()],
        "joined": sorted(tracker._joined),
        "tracks": [_freeze_track(track) for track in tracker._tracks.rows],
        "candidates": [
            [*key, asdict(candidate)] for key, candidate in tracker._joining._candidates.items()
        ],
        "whereabouts": _freeze_prediction(tracker._prediction),
    }


def restore(tracker: ArenaTracker, memory: Mapping[str, Any]) -> None:
    """Gives a tracker, in place of its own, the memory of another of the same description.

    Raises:
        KeyError, TypeError, ValueError, IndexError: the memory is damaged.
    """
    tracker.learn()  # what waits to be learned is of its own memory
    tracker._gate._newest = int(memory["newest"])
    tracker.heights_m.clear()
    tracker.heights_m.update({int(tag): float(height) for tag, height in memory["heights_m"]})
    tracker._joined = {int(tag) for tag in memory["joined"]}
    tracks = np.array([_restore_track(row) for row in memory["tracks"]], dtype=TRACK)
    tracker._tracks.rows = tracks[np.argsort(tracks["last"]["tag"])]
    tracker._joining._candidates = {
        (str(family), int(tag)): _Candidate(**{**values, "place": tuple(values["place"])})
        for family, tag, values in memory["candidates"]
    }
    _restore_prediction(tracker._prediction, memory["whereabouts"])


def _freeze_track(track: np.void) -> dict[str, Any]:
    strays = int(track["strays"])
    return {
        "tag": int(track["last"]["tag"]),
        "last": _freeze_view(track["last"]),
        "seen": bool(track["seen"]),
        "trust": float(track["trust"]),
        "velocity": track["velocity_m_s"].tolist(),
        "turn_rad_s": float(track["turn_rad_s"]),
        "stray": _freeze_view(track["stray"]) if strays else None,
        "strays": strays,
    }


def _restore_track(values: Mapping[str, Any]) -> NDArray[np.void]:
    track = np.zeros((), dtype=TRACK)
    track["last"] = _restore_view(values["last"])
    track["seen"], track["trust"] = bool(values["seen"]), float(values["trust"])
    track["velocity_m_s"], track["turn_rad_s"] = values["velocity"], float(values["turn_rad_s"])
    if values["stray"] is not None:
        track["stray"], track["strays"] = _restore_view(values["stray"]), int(values["strays"])
    return track


def _freeze_view(view: np.void) -> dict[str, Any]:
    return {_RECORDED.get(name, name): view[name].tolist() for name in VIEW.names or ()}


def _restore_view(values: Mapping[str, Any]) -> NDArray[np.void]:
    view = np.zeros((), dtype=VIEW)
    for name in VIEW.names or ():
        value = values[_RECORDED.get(name, name)]
        # Older recordings hold the cameras' ids.
        view[name] = len(value) if name == "cameras" and isinstance(value, list) else value
    return view


def _freeze_prediction(prediction: Prediction) -> dict[str, Any]:
    return {
        "timesteps": prediction._timesteps,
        "known": [_freeze_known(row) for row in prediction.known],
        "joined": {family: list(tags) for family, tags in prediction.joined.items()},
        "anonymous": {
            camera: {
                "rows": unnamed.rows.tolist(),
                "places": unnamed.places.tolist(),
                "cells": unnamed.cells.tolist(),
                "columns": unnamed.cells.shape[1],
                "kind": unnamed.cells.dtype.name,
                "pictures": unnamed.pictures.tolist(),
                "capture_ns": unnamed.capture_ns,
            }
            for camera, unnamed in prediction.anonymous.items()
        },
    }


def _restore_prediction(prediction: Prediction, values: Mapping[str, Any]) -> None:
    prediction._timesteps = int(values["timesteps"])
    rows = np.array([_restore_known(*row) for row in values["known"]], dtype=KNOWN)
    prediction.known = rows[np.argsort(rows["tag"])]
    prediction.joined = {family: tuple(tags) for family, tags in values["joined"].items()}
    prediction.anonymous = {
        camera: Anonymous(
            np.array(entry["rows"], dtype=np.intp),
            np.array(entry["places"], dtype=np.float64).reshape(-1, 2),
            _cells(entry),
            np.array(entry["pictures"], dtype=np.int64),
            int(entry["capture_ns"]),
        )
        for camera, entry in values["anonymous"].items()
    }


def _freeze_known(row: np.void) -> list[Any]:
    names = [name for name in KNOWN.names or () if name != "tag"]
    return [int(row["tag"]), {name: row[name].tolist() for name in names}]


def _restore_known(tag: int, values: Mapping[str, Any]) -> NDArray[np.void]:
    row = np.zeros((), dtype=KNOWN)
    row["tag"] = tag
    for name, value in values.items():
        row[name] = value
    return row


def _cells(values: Mapping[str, Any]) -> NDArray[Any]:
    kind: Any = np.float32 if values["kind"] == "float32" else np.float64
    # Not reshaped: of no marker, the number of columns still counts.
    cells = np.zeros((len(values["cells"]), int(values["columns"])), dtype=kind)
    cells[:] = np.array(values["cells"], dtype=kind).reshape(cells.shape)
    return cells
