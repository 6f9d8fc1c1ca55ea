"""What a recording looks like inside: its head, its channels, and messages as bytes.

A recording is an MCAP file of the profile `vsense`. Every message is JSON; pictures are Foxglove's
`foxglove.CompressedImage`, so that other tools show them. Log times are UTC for these tools; the
host's monotonic clock is that less a constant, which the head says.

What other tools are told of each topic's messages: JSON schemas, as far as plots need them.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vsense.arena import IMAGE_POSE, POSE, SIGHTING
from vsense.errors import VsenseError
from vsense.message_bus import Message

PROFILE = "vsense"
FORMAT = (1, 0)
"""Of what is written: the first number rises when an older vsense could not read it any more."""

_MOST_NS = 1 << 63
"""No clock shows more."""

HEAD = "vsense"
"""Name of the metadata record that every recording begins with."""
EXPERIMENT = "experiment"
"""Name of the metadata record with the experiment's file, for people with other tools."""

BLOB = "blob"
"""In a channel's metadata: its messages hold bytes beside their data."""

PICTURE = "/picture/"
GAP = "/gap"
TRACKER = "/tracker"
NOT_RECORDED = (PICTURE, "/readings/", "/you", "/answer")
"""Live pictures are scaled and lossy, one robot's readings are in `/readings` already, and the
rest is between the server and one page."""


class RecordingError(VsenseError):
    """A recording that cannot be written or read; one line that names the file."""


@dataclass(frozen=True, slots=True)
class Head:
    """What a recording says first.

    Attributes:
        version: the vsense that wrote it.
        begin_ns: when it was begun, host's monotonic clock.
        utc_shift_ns: what that clock was behind UTC's nanoseconds since 1970.
    """

    version: str
    begin_ns: int
    utc_shift_ns: int

    def as_metadata(self) -> dict[str, str]:
        """The head as MCAP keeps it: text by name."""
        return {
            "format": ".".join(map(str, FORMAT)),
            "version": self.version,
            "begin_ns": str(self.begin_ns),
            "utc_shift_ns": str(self.utc_shift_ns),
        }

    @classmethod
    def from_metadata(cls, values: Mapping[str, str], file: str) -> Head:
        """Reads the head.

        Raises:
            RecordingError: it is of another format, or damaged.
        """
        found = values.get("format", "")
        version = values.get("version", "?")
        try:
            if int(found.split(".")[0]) != FORMAT[0]:
                raise RecordingError(
                    f"{file}: is a recording of format {found}, written by vsense {version};"
                    f" this vsense reads format {FORMAT[0]}"
                )
            head = cls(version, int(values["begin_ns"]), int(values["utc_shift_ns"]))
            if max(abs(head.begin_ns), abs(head.utc_shift_ns)) > _MOST_NS:
                raise ValueError
            return head
        except (KeyError, ValueError):
            raise RecordingError(f"{file}: its head is damaged") from None


def is_recorded(topic: str) -> bool:
    """Whether messages of a topic go into a recording as they come."""
    return not topic.startswith(NOT_RECORDED)


def has_blob(message: Message) -> bool:
    """Whether a message is kept as Foxglove keeps pictures."""
    return bool(message.blob) or message.topic.startswith(PICTURE)


def encode(message: Message, utc_shift_ns: int) -> bytes:
    """Gives a message's data as it is kept.

    Raises:
        ValueError, TypeError, RecursionError: JSON cannot hold it.
    """
    data = _encode_data(message.data)
    if not has_blob(message):
        return data
    capture_ns = message.data.get("capture_ns", message.time_ns)
    sec, nsec = divmod(max(capture_ns + utc_shift_ns, 0), 1_000_000_000)
    frame = message.data.get("camera", message.topic)
    return b"".join(
        (
            b'{"timestamp":{"sec":%d,"nsec":%d},"frame_id":' % (sec, nsec),
            json.dumps(str(frame)).encode(),
            b',"format":',
            json.dumps(str(message.data.get("format", ""))).encode(),
            b',"data":"',
            base64.b64encode(message.blob),
            b'","vsense":',
            data,
            b"}",
        )
    )


def decode(topic: str, time_ns: int, blob: bool, data: bytes) -> Message:
    """Gives a message back.

    Args:
        topic: its topic.
        time_ns: when it was, host's monotonic clock.
        blob: whether its channel keeps blobs.
        data: what `encode` made.

    Raises:
        ValueError, TypeError, KeyError, RecursionError: it is damaged.
    """
    values = json.loads(data)
    if blob:
        picture = base64.b64decode(values["data"], validate=True)
        return Message(topic, time_ns, _object(values["vsense"]), picture)
    return Message(topic, time_ns, _object(values))


def _object(values: Any) -> dict[str, Any]:
    if not isinstance(values, dict):
        raise TypeError("expected an object")
    return values


def _plain(value: Any) -> Any:
    """What JSON does not know by itself: NumPy's numbers and arrays."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} cannot be recorded")


_ENCODER = json.JSONEncoder(
    separators=(",", ":"), allow_nan=False, check_circular=False, default=_plain
)


def _encode_data(data: Mapping[str, Any]) -> bytes:
    try:
        return _ENCODER.encode(data).encode()
    except ValueError:
        # Rare, and looked for only now: a look at every number would cost more than the rest.
        return _ENCODER.encode(_without_nan(data)).encode()


def _without_nan(value: Any) -> Any:
    """Puts null where no number is."""
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _without_nan(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(each) for each in value]
    return value


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
    GAP: (
        "What is missing: from, to, how many messages and pictures, and why.",
        {"from_ns": _INTEGER, "to_ns": _INTEGER, "messages": _INTEGER, "pictures": _INTEGER,
         "why": _TEXT},
    ),
    TRACKER: (
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
