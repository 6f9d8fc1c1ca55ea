"""The arena state as text: one JSON object per timestep, or one CSV row per robot.

Lengths in m, angles in rad (counter-clockwise in (-pi, pi], 0 along +x), times in integer ns. A
covariance is six numbers of x, y and yaw: xx, xy, x yaw, yy, y yaw, yaw yaw.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from vsense.arena import POSE, ArenaState

_UPPER = np.triu_indices(3)
_SPREAD = ("xx_m2", "xy_m2", "x_yaw_m_rad", "yy_m2", "y_yaw_m_rad", "yaw_yaw_rad2")
_PLAIN = tuple(name for name in POSE.names or () if name != "covariance")

CSV_HEADER = ",".join(
    ("timestep", "state_capture_ns", *_PLAIN, *(f"covariance_{name}" for name in _SPREAD))
)

_DECIMALS = {"x_m": 5, "y_m": 5, "yaw_rad": 5, "speed_m_s": 4, "confidence": 3}
_DIGITS = 3
"""Of a covariance."""


def to_json(state: ArenaState) -> str:
    """Gives one line without its end.

    `robots` hold the fields of POSE by their names, `covariance` as six numbers, or null where
    nobody can tell; and in `images`, by the camera's id, where each camera sees the robot.
    `duplicate_sightings` are all places of the tags in `duplicates`.
    """
    images = _images(state)
    robots = [
        _fields(row) | {"covariance": _spread(row), "images": images.get(int(row["tag"]), {})}
        for row in state.robots
    ]
    values = {
        "timestep": state.timestep,
        "capture_ns": state.capture_ns,
        "detected": state.detected,
        "unnamed": state.unnamed,
        "duplicates": [int(tag) for tag in state.duplicates],
        "duplicate_sightings": _twins(state),
        "joined": [int(tag) for tag in state.joined],
        "robots": robots,
    }
    return json.dumps(values, separators=(",", ":"), allow_nan=False)


def to_csv(state: ArenaState) -> str:
    """Gives one line per robot, without the last line's end; "" where there is none.

    A covariance that nobody can tell is six empty cells.
    """
    head = f"{state.timestep},{state.capture_ns},"
    return "\n".join(head + ",".join(_cells(row)) for row in state.robots)


def _twins(state: ArenaState) -> list[dict[str, float]]:
    """Every place where a tag was read that is there twice."""
    twins = state.sightings[np.isin(state.sightings["tag"], state.duplicates)]
    names = twins.dtype.names or ()
    return [{n: _plain(n, v) for n, v in zip(names, row)} for row in twins.tolist()]


def _fields(row: np.void) -> dict[str, Any]:
    return {name: _plain(name, row[name].item()) for name in _PLAIN}


def _plain(name: str, value: float | int | bool) -> float | int | bool:
    return round(value, _DECIMALS[name]) if name in _DECIMALS else value


def _spread(row: np.void) -> list[float] | None:
    """The covariance's six numbers, None where they are not known."""
    numbers = row["covariance"][_UPPER].tolist()
    known = all(math.isfinite(number) for number in numbers)
    return [float(f"{number:.{_DIGITS - 1}e}") for number in numbers] if known else None


def _images(state: ArenaState) -> dict[int, dict[str, dict[str, float]]]:
    """Where the cameras see each tag: by tag and camera. Of a tag that is there twice, neither."""
    found: dict[int, dict[str, dict[str, float]]] = {}
    fields = ("tag", "camera", "x_px", "y_px", "yaw_px_rad")
    for tag, camera, x_px, y_px, yaw in zip(*(state.images[f].tolist() for f in fields)):
        if tag not in state.duplicates:
            pose = {"x_px": round(x_px, 2), "y_px": round(y_px, 2), "yaw_px_rad": round(yaw, 4)}
            found.setdefault(tag, {})[state.cameras[camera]] = pose
    return found


def _cells(row: np.void) -> list[str]:
    spread = _spread(row)
    cells = [_cell(name, row[name].item()) for name in _PLAIN]
    return cells + (["" for _ in _SPREAD] if spread is None else [f"{v:g}" for v in spread])


def _cell(name: str, value: float | int | bool) -> str:
    if isinstance(value, bool):
        return str(int(value))
    return f"{value:.{_DECIMALS[name]}f}" if name in _DECIMALS else str(value)
