"""The arena state as text: one JSON object per timestep, or one CSV row per robot.

Lengths in m, angles in rad (counter-clockwise in (-pi, pi], 0 along +x), times in integer ns.
"""

from __future__ import annotations

import json

from vsense.arena import POSE, ArenaState

CSV_HEADER = "timestep,state_capture_ns," + ",".join(POSE.names or ())

_DECIMALS = {"x_m": 5, "y_m": 5, "yaw_rad": 5, "speed_m_s": 4, "confidence": 3}


def to_json(state: ArenaState) -> str:
    """Gives one line without its end; `robots` hold the fields of POSE by their names."""
    robots = [
        {name: _plain(name, value) for name, value in zip(POSE.names or (), row)}
        for row in state.robots.tolist()
    ]
    values = {
        "timestep": state.timestep,
        "capture_ns": state.capture_ns,
        "detected": state.detected,
        "unnamed": state.unnamed,
        "duplicates": [int(tag) for tag in state.duplicates],
        "robots": robots,
    }
    return json.dumps(values, separators=(",", ":"))


def to_csv(state: ArenaState) -> str:
    """Gives one line per robot, without the last line's end; "" where there is none."""
    head = f"{state.timestep},{state.capture_ns},"
    return "\n".join(
        head + ",".join(_cell(name, value) for name, value in zip(POSE.names or (), row))
        for row in state.robots.tolist()
    )


def _plain(name: str, value: float | int | bool) -> float | int | bool:
    return round(value, _DECIMALS[name]) if name in _DECIMALS else value


def _cell(name: str, value: float | int | bool) -> str:
    if isinstance(value, bool):
        return str(int(value))
    return f"{value:.{_DECIMALS[name]}f}" if name in _DECIMALS else str(value)
