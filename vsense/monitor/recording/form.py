"""What a recording looks like inside: its head, its channels, messages as bytes, and their schemas.

A recording is an MCAP file of the profile `vsense`. Every message is JSON; pictures are Foxglove's
`foxglove.CompressedImage`, so that other tools show them. Log times are UTC for these tools; the
host's monotonic clock is that less a constant, which the head says. `vsense/monitor/ui/MESSAGES.md`
describes all topics.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, TypeVar

import numpy as np

from vsense.base.arena import IMAGE_POSE, POSE, SIGHTING
from vsense.base.errors import VsenseError
from vsense.base.message_bus import Message
from vsense.monitor.foxglove import _schemas, _shapes

PROFILE = "vsense"
RECORDING_FORMAT = (1, 2)
"""Of what is written: the first number rises when an older vsense can no longer read it."""

_MOST_NS = 1 << 63
"""More than any clock shows."""

HEAD_RECORD = "vsense"
"""Name of the metadata record that every recording begins with."""
EXPERIMENT_RECORD = "experiment"
"""Name of the metadata record with the experiment's file, for other tools."""

BLOB, DERIVED = "blob", "derived"
"""In a channel's metadata: its messages hold bytes beside their data; they follow from others, for
other tools."""

PICTURE = _shapes.PICTURE
GAP = "/gap"
TRACKER_TOPIC = "/tracker"
DEEDS, ORDERS_TOPIC, SETTINGS_TOPIC, PARTS = "/deeds", "/orders", "/settings", "/parts"
NOT_RECORDED = (PICTURE, "/readings/", "/history", "/you", "/answer")
"""Live pictures are scaled and lossy, one robot's readings are in `/readings` and the measures in
`/signals` already, the rest is between the server and one page."""


class RecordingError(VsenseError):
    """A recording that cannot be written or read; the message names the file."""

    exit_code = 2


@dataclass(frozen=True, slots=True)
class Head:
    """The beginning of a recording: the vsense that wrote it, and the clock.

    `begin_ns` is the host's monotonic clock, which was `utc_shift_ns` behind UTC's nanoseconds
    since 1970.
    """

    version: str
    begin_ns: int
    utc_shift_ns: int

    def as_metadata(self) -> dict[str, str]:
        """The head as MCAP keeps it: text by name."""
        return {
            "format": ".".join(map(str, RECORDING_FORMAT)),
            **{name: str(value) for name, value in asdict(self).items()},
        }

    @classmethod
    def from_metadata(cls, values: Mapping[str, str], file: str) -> Head:
        """Reads the head; RecordingError if it is of another format, or damaged."""
        file_format = values.get("format", "")
        version = values.get("version", "?")
        try:
            if int(file_format.split(".")[0]) != RECORDING_FORMAT[0]:
                raise RecordingError(
                    f"{file}: is a recording of format {file_format}, written by vsense {version};"
                    f" this vsense reads format {RECORDING_FORMAT[0]}"
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
    """A message's data as bytes; ValueError, TypeError, RecursionError if JSON cannot hold it."""
    data = encode_data(message.data)
    if not has_blob(message):
        return data
    reported = message.data.get("capture_ns")
    capture_ns = int(reported) if isinstance(reported, (int, np.integer)) else message.time_ns
    sec, nsec = divmod(max(capture_ns + utc_shift_ns, 0), 1_000_000_000)
    picture = {
        "timestamp": {"sec": sec, "nsec": nsec},
        "frame_id": _shapes.camera_frame(str(message.data.get("camera", message.topic))),
        "format": str(message.data.get("format", "")),
    }
    opened = _ENCODER.encode(picture).encode()[:-1]
    blob = base64.b64encode(message.blob)
    return b"".join((opened, b',"data":"', blob, b'","vsense":', data, b"}"))


def decode(topic: str, time_ns: int, blob: bool, data: bytes) -> Message:
    """Gives back what `encode` made; `blob`: its channel keeps blobs.

    ValueError, TypeError, KeyError, RecursionError if it is damaged.
    """
    values = _DECODER.decode(data.decode())
    if blob:
        picture = base64.b64decode(values["data"], validate=True)
        return Message(topic, time_ns, _object(values["vsense"]), picture)
    if topic == "/experiment":
        return Message(topic, time_ns, _with_controllers(_object(values)))
    return Message(topic, time_ns, _object(values))


def _no_number(name: str) -> Any:
    raise ValueError(f"{name} is no number")


_DECODER = json.JSONDecoder(parse_constant=_no_number)


def _with_controllers(experiment: dict[str, Any]) -> dict[str, Any]:
    """The data of `/experiment`, also where there was one controller, which had no name."""
    if "controllers" in experiment or "sensors" not in experiment:
        return experiment
    rest = dict(experiment)
    devices = {name: rest.pop(name, []) for name in ("sensors", "actuators")}
    return {**rest, "controllers": [{"id": "", "library": "", "tags": [], **devices}]}


def _object(values: Any) -> dict[str, Any]:
    if not isinstance(values, dict):
        raise TypeError("expected an object")
    return values


def _plain(value: Any) -> Any:
    """Converts what JSON does not know: NumPy's numbers and arrays."""
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


def encode_data(data: Mapping[str, Any]) -> bytes:
    """An object as JSON, with null for numbers that it does not have; raises as `encode`."""
    try:
        return _ENCODER.encode(data).encode()
    except ValueError:
        # Rare, and searched for only now: a check of every number would cost more than the rest.
        return _ENCODER.encode(without_nan(data)).encode()


def without_nan(value: Any) -> Any:
    """The same with null for every number that JSON does not have."""
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_nan(item) for item in value]
    return value


Data = dict[str, Any]
Schemas = Mapping[str, Any]
MessageKind = TypeVar("MessageKind", bound="_Message")

_INTEGER, _NUMBER, _TEXT, _YES = (
    {"type": name} for name in ("integer", "number", "string", "boolean")
)
_COLUMN, _OBJECT = {"type": "array"}, {"type": "object"}
_TIME = {"type": "object", "properties": {"sec": _INTEGER, "nsec": _INTEGER}}
_BYTES = {"type": "string", "contentEncoding": "base64"}

_KINDS: dict[str, tuple[dict[str, str], tuple[type, ...]]] = {
    "bool": (_YES, (bool,)),
    "int": (_INTEGER, (int,)),
    "float": (_NUMBER, (int, float)),
    "str": (_TEXT, (str,)),
    "list": (_COLUMN, (list,)),
    "Data": (_OBJECT, (dict,)),
}
"""What a field's annotation begins with: its JSON schema, and what JSON gives for it."""


class _Message:
    """A message whose fields are known; its defaults stand for what a recording lacks."""

    __slots__ = ()

    @classmethod
    def kinds(cls) -> dict[str, tuple[dict[str, str], tuple[type, ...]]]:
        """The fields by name."""
        # Annotations are texts here: "float | None", "list[str]".
        return {f.name: _KINDS[str(f.type).split(" ")[0].split("[")[0]] for f in fields(cls)}  # type: ignore[arg-type]

    @classmethod
    def read(cls: type[MessageKind], data: Mapping[str, Any]) -> MessageKind:
        """Reads a message of any version; what is missing or of another type has its default."""
        values: Data = {}
        lists = {f.name for f in fields(cls) if f.type == "list[Data]"}  # type: ignore[arg-type]
        for name, (_, types) in cls.kinds().items():
            value = data.get(name)
            if name in lists and isinstance(value, list):
                values[name] = [row for row in value if isinstance(row, dict)]
            elif isinstance(value, types) and (bool in types or not isinstance(value, bool)):
                values[name] = value
        return cls(**values)

    def data(self) -> Data:
        """The message's data."""
        return {name: getattr(self, name) for name in self.kinds()}


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentMessage(_Message):
    """`/experiment`: what does not change during a run; see `vsense/monitor/ui/MESSAGES.md`."""

    mode: str = "live"
    command: str = ""
    user: str | None = None
    recorded: bool = False
    name: str = ""
    seed: int | None = None
    blind: bool | None = None
    homes: bool | None = None
    version: str = ""
    file_text: str = ""
    made: Data | None = None
    timestep_s: float | None = None
    length_s: float | None = None
    arena: Data | None = None
    robots: list[Data] = field(default_factory=list)
    objects: list[Data] = field(default_factory=list)
    controllers: list[Data] = field(default_factory=list)
    cameras: list[Data] = field(default_factory=list)
    calibration: Data | None = None
    body_radius_m: float | None = None
    body_height_m: float | None = None

    def controller_of(self) -> dict[int, int]:
        """Which of `controllers` drives a robot, by its tag; the first one drives those not in it.

        What is damaged is left out.
        """
        tags = ((n, row.get("tags")) for n, row in enumerate(self.controllers))
        groups = ((n, members) for n, members in tags if isinstance(members, list))
        return {tag: n for n, members in groups for tag in members if isinstance(tag, int)}


@dataclass(frozen=True, slots=True, kw_only=True)
class RunMessage(_Message):
    """`/run`: where the run is; see `vsense/monitor/ui/MESSAGES.md`."""

    state: str = ""
    run: int = 1
    runs: int | None = None
    by: str | None = None
    can: list[str] = field(default_factory=list)
    timestep: int = -1
    time_s: float | None = None
    length_s: float | None = None
    late: int | None = None
    rate_hz: float = 0.0
    latency_ms: Data | None = None
    silent_s: float | None = None
    text: str = ""
    recording: Data | None = None
    disk_free_bytes: int | None = None
    doubts: list[str] = field(default_factory=list)
    alarms: list[Data] = field(default_factory=list)
    spares: list[int] = field(default_factory=list)
    verdict: str | None = None
    why: str = ""


def _columns(*names: str) -> dict[str, Any]:
    return {"type": "object", "properties": dict.fromkeys(names, _COLUMN)}


def _schema_of(kind: type[_Message]) -> Schemas:
    return {name: schema for name, (schema, _) in kind.kinds().items()}


ROBOT_COLUMNS = (
    "tag", "name", "connected", "heard_ms", "udp", "pose_age_ms", "seen", "doubt", "state",
    "stop_cause", "battery_mv", "battery_low", "leds", "left_steps_s", "right_steps_s",
    "base_errors", "base_resets", "overruns", "guard_restarts", "signal_dbm", "bit_rate_mbit_s",
    "retries", "power_saving", "sessions", "version", "controller",
    "hash", "expected", "authenticated", "held", "trouble",
)  # fmt: skip
"""Columns of `/robots`; beside them `actuators`, a list of lists for each robot, and `shown`, an
object for each."""

PART_COLUMNS = ("part", "name", "tag", "uid", "controller", "hash")
"""Columns of `/parts`."""


_TOPICS: dict[str, tuple[str, Schemas]] = {
    "/experiment": (
        "What the run is: arena, robots, controllers, cameras, and the experiment's file.",
        _schema_of(ExperimentMessage),
    ),
    "/run": ("Where the run is: state, timestep, rates, recording.", _schema_of(RunMessage)),
    "/arena": (
        "The tracker's arena state of a timestep, in columns. m, rad, ns.",
        {"timestep": _INTEGER, "run_timestep": _INTEGER, "capture_ns": _INTEGER,
         "detected": _INTEGER, "unnamed": _INTEGER, "robots": _columns(*POSE.names or ()),
         "sightings": _columns(*SIGHTING.names or ()), "images": _columns(*IMAGE_POSE.names or ())},
    ),
    "/world": ("The virtual things in the arena.", {"entities": _COLUMN}),
    "/signals": (
        "Virtual LEDs and cones, and the experiment's measures.",
        {"timestep": _INTEGER, "time_s": _NUMBER, "measures": _OBJECT},
    ),
    "/fields": ("Fields as rasters.", {"fields": _COLUMN}),
    "/readings": (
        "The virtual sensors' readings, as sent to the robots; a row for each tag.",
        {"timestep": _INTEGER, "capture_ns": _INTEGER, "tag": _COLUMN, "values": _COLUMN,
         "captured_ns": _COLUMN},
    ),
    DEEDS: (
        "What the robots' virtual actuators gave the world in a timestep; a row for each tag.",
        {"timestep": _INTEGER, "run_timestep": _INTEGER, "count": _INTEGER, "orders": _INTEGER,
         "tag": _COLUMN, "report": _COLUMN, "sender": _COLUMN},
    ),
    ORDERS_TOPIC: (
        "Something that people changed in the world, and before which timestep.",
        {"timestep": _INTEGER, "run_timestep": _INTEGER, "by": _TEXT, "change": _OBJECT,
         "text": _TEXT},
    ),
    SETTINGS_TOPIC: (
        "What can be changed in the world, and how it is.",
        {"locked": _YES, "sensors": _COLUMN, "fields": _COLUMN, "params": _OBJECT},
    ),
    PARTS: (
        "Which robot has which role in the experiment, in columns; `part` is the file's tag.",
        {"run": _INTEGER, "timestep": _INTEGER, **dict.fromkeys(PART_COLUMNS, _COLUMN)},
    ),
    "/robots": ("What is known of every robot, in columns.", dict.fromkeys(ROBOT_COLUMNS, _COLUMN)),
    "/cameras": ("How the cameras are.", {"cameras": _COLUMN}),
    "/event": ("A message for people.", {"text": _TEXT, "level": _TEXT, "by": _TEXT}),
    GAP: (
        "What is missing: from, to, how many messages and pictures, and why.",
        {"from_ns": _INTEGER, "to_ns": _INTEGER, "messages": _INTEGER, "pictures": _INTEGER,
         "why": _TEXT},
    ),
    TRACKER_TOPIC: (
        "What the tracker is made from, and what it remembered before the next picture.",
        {"made": _OBJECT, "memory": _OBJECT},
    ),
}  # fmt: skip


RUN_TOPICS = tuple(topic for topic in _TOPICS if topic not in (GAP, TRACKER_TOPIC))
"""Those of the topics that a run tells whoever listens."""


def schema(topic: str, blob: bool) -> tuple[str, bytes]:
    """Gives name and JSON schema of a channel; with blobs Foxglove takes them for pictures."""
    if blob:
        name, text = _schemas.IMAGE, "A picture; `vsense` is the message's own data."
        fields: Schemas = {"timestamp": _TIME, "frame_id": _TEXT, "data": _BYTES, "format": _TEXT}
    else:
        name = f"vsense{topic.replace('/', '.')}"
        text, fields = _TOPICS.get(topic, ("", {}))
    document = {"title": name, "description": text, "type": "object", "properties": fields}
    return name, json.dumps(document).encode()
