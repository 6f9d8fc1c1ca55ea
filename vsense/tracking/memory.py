"""What an arena tracker remembers from one timestep to the next, as JSON can hold it.

With it a recording can begin in the middle: a tracker that is given the same memory and the same
pictures says the same. Floats survive JSON bit for bit.
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
        "whereabouts": _freeze_whereabouts(tracker._whereabouts),
    }


def restore(tracker: ArenaTracker, memory: Mapping[str, Any]) -> None:
    """Gives a tracker another one's memory, in place of its own.

    Args:
        tracker: made from the same description as the other one.
        memory: what `freeze` gave.

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
    _restore_whereabouts(tracker._whereabouts, memory["whereabouts"])


def _freeze_track(tag: int, track: Track) -> dict[str, Any]:
    return {
        "tag": tag,
        "last": asdict(track.last),
        "seen": track.seen,
        "trust": track._trust,
        "velocity": track._velocity,
        "turn_rad_s": track._turn_rad_s,
        "stray": None if track._stray is None else asdict(track._stray),
        "strays": track._strays,
    }


def _restore_track(values: Mapping[str, Any]) -> Track:
    track = Track(_sighting(values["last"]))
    track.seen = bool(values["seen"])
    track._trust = float(values["trust"])
    vx, vy = values["velocity"]
    track._velocity = float(vx), float(vy)
    track._turn_rad_s = float(values["turn_rad_s"])
    track._stray = None if values["stray"] is None else _sighting(values["stray"])
    track._strays = int(values["strays"])
    return track


def _sighting(values: Mapping[str, Any]) -> Sighting:
    lists = {name: tuple(value) for name, value in values.items() if isinstance(value, list)}
    return Sighting(**{**values, **lists})


def _freeze_whereabouts(where: Prediction) -> dict[str, Any]:
    return {
        "timesteps": where._timesteps,
        "known": [[tag, asdict(known)] for tag, known in where._known.items()],
        "joined": {family: list(tags) for family, tags in where.joined.items()},
        "anonymous": {
            camera: {
                "rows": nameless.rows.tolist(),
                "places": nameless.places.tolist(),
                "cells": nameless.cells.tolist(),
                "columns": nameless.cells.shape[1],
                "kind": nameless.cells.dtype.name,
                "pictures": nameless.pictures.tolist(),
                "capture_ns": nameless.capture_ns,
            }
            for camera, nameless in where.anonymous.items()
        },
    }


def _restore_whereabouts(where: Prediction, values: Mapping[str, Any]) -> None:
    where._timesteps = int(values["timesteps"])
    where._known = {
        int(tag): _Known(**{**known, "velocity": tuple(known["velocity"])})
        for tag, known in values["known"]
    }
    where.joined = {family: tuple(tags) for family, tags in values["joined"].items()}
    where.anonymous = {
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
