"""What an arena tracker remembers from one timestep to the next, as JSON can hold it.

With it a recording can begin in the middle: the same memory and the same pictures give the same
states. Floats survive JSON bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.joining import _Candidate
from vsense.vision.tracking.prediction import KNOWN, Anonymous, Prediction
from vsense.vision.tracking.tracks import TRACK
from vsense.vision.tracking.views import VIEW

_RECORDED = {"covariance": "spread", "height_sensitivity": "lean"}
"""Fields of a sighting that recordings hold under another name, as they do the prediction."""


def freeze(tracker: ArenaTracker) -> dict[str, Any]:
    """Gives a tracker's memory; to be called in its thread, between two timesteps."""
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
    tracker._gate._newest = int(memory["newest"])
    tracker.heights_m.clear()
    tracker.heights_m.update({int(tag): float(height) for tag, height in memory["heights_m"]})
    tracker._joined = {int(tag) for tag in memory["joined"]}
    tracks = np.array([_restore_track(each) for each in memory["tracks"]], dtype=TRACK)
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
        "known": [_freeze_known(known) for known in prediction._known],
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
    known = np.array([_restore_known(*each) for each in values["known"]], dtype=KNOWN)
    prediction._known = known[np.argsort(known["tag"])]
    prediction.joined = {family: tuple(tags) for family, tags in values["joined"].items()}
    prediction.anonymous = {
        camera: Anonymous(
            np.array(each["rows"], dtype=np.intp),
            np.array(each["places"], dtype=np.float64).reshape(-1, 2),
            _cells(each),
            np.array(each["pictures"], dtype=np.int64),
            int(each["capture_ns"]),
        )
        for camera, each in values["anonymous"].items()
    }


def _freeze_known(known: np.void) -> list[Any]:
    names = [name for name in KNOWN.names or () if name != "tag"]
    return [int(known["tag"]), {name: known[name].tolist() for name in names}]


def _restore_known(tag: int, values: Mapping[str, Any]) -> NDArray[np.void]:
    known = np.zeros((), dtype=KNOWN)
    known["tag"] = tag
    for name, value in values.items():
        known[name] = value
    return known


def _cells(values: Mapping[str, Any]) -> NDArray[Any]:
    kind: Any = np.float32 if values["kind"] == "float32" else np.float64
    # Not reshaped: of no marker, the number of columns still counts.
    cells = np.zeros((len(values["cells"]), int(values["columns"])), dtype=kind)
    cells[:] = np.array(values["cells"], dtype=kind).reshape(cells.shape)
    return cells
