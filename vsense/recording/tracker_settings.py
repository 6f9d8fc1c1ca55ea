"""Other settings for a recorded tracker, as a person writes them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from vsense.errors import UsageError

HEIGHT = "tracker.height_m"
"""Of all markers of all trackers."""


def change_settings(made: Mapping[str, Any], settings: Mapping[str, str]) -> dict[str, Any]:
    """Gives a description of a tracker with other settings.

    Args:
        made: the description; see `tracker_made`.
        settings: by name, "limits.X", "plan.X", or "tracker.X" for all of its trackers.

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
    """Finds what a setting is a setting of."""
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
