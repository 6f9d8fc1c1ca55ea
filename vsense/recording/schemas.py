"""What other tools are told of each topic's messages: JSON schemas, as far as plots need them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from vsense.arena import IMAGE_POSE, POSE, SIGHTING
from vsense.recording import form

Fields = Mapping[str, Any]

_INTEGER, _NUMBER, _TEXT, _YES = (
    {"type": name} for name in ("integer", "number", "string", "boolean")
)
_COLUMN = {"type": "array"}
_TIME = {"type": "object", "properties": {"sec": _INTEGER, "nsec": _INTEGER}}
_BYTES = {"type": "string", "contentEncoding": "base64"}


def _columns(*names: str) -> dict[str, Any]:
    return {"type": "object", "properties": dict.fromkeys(names, _COLUMN)}


_ROBOTS = (
    "tag", "name", "connected", "heard_ms", "pose_age_ms", "state", "battery_mv", "left_steps_s",
    "right_steps_s", "base_errors", "trouble",
)  # fmt: skip

_TOPICS: dict[str, tuple[str, Fields]] = {
    "/experiment": (
        "What the run is: arena, robots, sensors, cameras, and the experiment's file.",
        {"name": _TEXT, "seed": _INTEGER, "version": _TEXT, "command": _TEXT,
         "timestep_s": _NUMBER},
    ),
    "/run": (
        "Where the run is: state, timestep, rates, recording.",
        {"state": _TEXT, "run": _INTEGER, "timestep": _INTEGER, "time_s": _NUMBER, "text": _TEXT,
         "rate_hz": _NUMBER, "late": _INTEGER, "silent_s": _NUMBER},
    ),
    "/arena": (
        "The tracker's arena state of a timestep, in columns. m, rad, ns.",
        {"timestep": _INTEGER, "run_timestep": _INTEGER, "capture_ns": _INTEGER,
         "detected": _INTEGER, "unnamed": _INTEGER, "robots": _columns(*POSE.names or ()),
         "sightings": _columns(*SIGHTING.names or ()), "images": _columns(*IMAGE_POSE.names or ())},
    ),
    "/world": ("The virtual things in the arena.", {"entities": _COLUMN}),
    "/signals": (
        "Virtual LEDs and cones, and the experiment's measures.",
        {"timestep": _INTEGER, "time_s": _NUMBER, "measures": {"type": "object"}},
    ),
    "/fields": ("Fields as rasters.", {"fields": _COLUMN}),
    "/readings": (
        "The virtual sensors' readings, as sent to the robots; a row for each tag.",
        {"timestep": _INTEGER, "capture_ns": _INTEGER, "tag": _COLUMN, "values": _COLUMN,
         "captured_ns": _COLUMN},
    ),
    "/robots": ("What is known of every robot, in columns.", dict.fromkeys(_ROBOTS, _COLUMN)),
    "/cameras": ("How the cameras are.", {"cameras": _COLUMN}),
    "/event": (
        "Something that people were told.", {"text": _TEXT, "level": _TEXT, "by": _TEXT},
    ),
    form.GAP: (
        "What is missing: from, to, how many messages and pictures, and why.",
        {"from_ns": _INTEGER, "to_ns": _INTEGER, "messages": _INTEGER, "pictures": _INTEGER,
         "why": _TEXT},
    ),
    form.TRACKER: (
        "What the tracker is made from, and what it remembered before the next picture.",
        {"made": {"type": "object"}, "memory": {"type": "object"}},
    ),
}  # fmt: skip


def schema(topic: str, blob: bool) -> tuple[str, bytes]:
    """Gives name and JSON schema of a channel.

    Args:
        topic: its topic.
        blob: whether it keeps blobs; Foxglove then takes them for pictures.
    """
    if blob:
        name = "foxglove.CompressedImage"
        text = "A picture; `vsense` is the message's own data."
        fields: Fields = {"timestamp": _TIME, "frame_id": _TEXT, "data": _BYTES, "format": _TEXT}
    else:
        name = f"vsense{topic.replace('/', '.')}"
        text, fields = _TOPICS.get(topic, ("", {}))
    whole = {"title": name, "description": text, "type": "object", "properties": fields}
    return name, json.dumps(whole).encode()
