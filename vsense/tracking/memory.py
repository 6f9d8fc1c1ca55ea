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

from vsense.tracking.arena_tracker import ArenaTracker
from vsense.tracking.joining import _Candidate
from vsense.tracking.prediction import Anonymous, Prediction, _Known
from vsense.tracking.tracks import Track
from vsense.tracking.views import Sighting

_RECORDED = {"covariance": "spread", "height_sensitivity": "lean"}
"""Fields of a sighting that recordings hold under another name, as they do the prediction."""


def freeze(tracker: ArenaTracker) -> dict[str, Any]:
    """Gives a tracker's memory; to be called in its thread, between two timesteps."""
    return {
        "newest": tracker._gate._newest,
        "heights_m": [[tag, height] for tag, height in tracker.heights_m.items()],
        "joined": sorted(tracker._joined),
        "tracks": [_freeze_track(tag, track) for tag, track in tracker._tracks.items()],
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
    tracker._tracks = {int(each["tag"]): _restore_track(each) for each in memory["tracks"]}
    tracker._joining._candidates = {
        (str(family), int(tag)): _Candidate(**{**values, "place": tuple(values["place"])})
        for family, tag, values in memory["candidates"]
    }
    _restore_prediction(tracker._prediction, memory["whereabouts"])


def _freeze_track(tag: int, track: Track) -> dict[str, Any]:
    return {
        "tag": tag,
        "last": _freeze_sighting(track.last),
        "seen": track.seen,
        "trust": track._trust,
        "velocity": track._velocity,
        "turn_rad_s": track._turn_rad_s,
        "stray": None if track._stray is None else _freeze_sighting(track._stray),
        "strays": track._strays,
    }


def _restore_track(values: Mapping[str, Any]) -> Track:
    track = Track(_restore_sighting(values["last"]))
    track.seen = bool(values["seen"])
    track._trust = float(values["trust"])
    vx, vy = values["velocity"]
    track._velocity = float(vx), float(vy)
    track._turn_rad_s = float(values["turn_rad_s"])
    track._stray = None if values["stray"] is None else _restore_sighting(values["stray"])
    track._strays = int(values["strays"])
    return track


def _freeze_sighting(sighting: Sighting) -> dict[str, Any]:
    return {_RECORDED.get(name, name): value for name, value in asdict(sighting).items()}


def _restore_sighting(values: Mapping[str, Any]) -> Sighting:
    known: dict[str, Any] = {name: values[_RECORDED.get(name, name)] for name in Sighting.__slots__}
    lists = {name: tuple(value) for name, value in known.items() if isinstance(value, list)}
    return Sighting(**{**known, **lists})


def _freeze_prediction(prediction: Prediction) -> dict[str, Any]:
    return {
        "timesteps": prediction._timesteps,
        "known": [[tag, asdict(known)] for tag, known in prediction._known.items()],
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
    prediction._known = {
        int(tag): _Known(**{**known, "velocity": tuple(known["velocity"])})
        for tag, known in values["known"]
    }
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


def _cells(values: Mapping[str, Any]) -> NDArray[Any]:
    kind: Any = np.float32 if values["kind"] == "float32" else np.float64
    # Not reshaped: of no marker, the number of columns still counts.
    cells = np.zeros((len(values["cells"]), int(values["columns"])), dtype=kind)
    cells[:] = np.array(values["cells"], dtype=kind).reshape(cells.shape)
    return cells
