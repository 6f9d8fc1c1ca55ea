"""An arena state as the message `/arena` has it: columns, and null where no number is."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.arena import ArenaState


def arena_data(state: ArenaState) -> dict[str, Any]:
    """Gives an arena state's columns; nothing of it is lost or rounded.

    A covariance is nine numbers row by row, or null where nobody can tell.
    """
    return {
        "timestep": state.timestep,
        "capture_ns": state.capture_ns,
        "robots": columns(state.robots),
        "detected": state.detected,
        "unnamed": state.unnamed,
        "duplicates": [int(tag) for tag in state.duplicates],
        "joined": [int(tag) for tag in state.joined],
        "sightings": columns(state.sightings),
        "cameras": list(state.cameras),
        "images": columns(state.images),
    }


def columns(rows: NDArray[np.void]) -> dict[str, list[Any]]:
    """Gives a list per field of a structured array (n,)."""
    return {
        name: _spreads(rows[name]) if name == "covariance" else rows[name].tolist()
        for name in rows.dtype.names or ()
    }


def _spreads(spreads: NDArray[np.float64]) -> list[list[float] | None]:
    known = np.asarray(np.isfinite(spreads).all(axis=(1, 2))).tolist()
    flat = spreads.reshape(len(spreads), 9).tolist()
    return [row if sure else None for row, sure in zip(flat, known)]
