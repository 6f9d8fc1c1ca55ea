"""What a tracker and the nodes of its cameras say to each other, as bytes.

A node is the tracker's detector by wire. An expectation says where robots were seen last, so that
the node can expect them when its pictures are taken; rows are what it has found there. Both are
NumPy rows, little-endian, behind a head with a version. How they get there is Zenoh's.

Whatever comes is looked at before it is used: bytes that are no message, or say what cannot be,
raise `NodeError`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import DETECTION, UNLISTED, Found
from vsense.base.errors import VsenseError
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking._prediction import KNOWN

NODE_FORMAT = 1
"""Of all messages between nodes and trackers; both ends have the same."""
MOST_ROWS = 4096
"""Of one picture: more than a detector's tables hold."""
MOST_CAMERAS = 256
_MOST_TAG = 65_535
_BESIDE_PX = 0.5
"""A marker's centre is in its picture, whose pixels reach so far around their middles."""

_EXPECT, _ROWS = 1, 2
_HEAD = np.dtype(
    [
        ("magic", "S4"),
        ("version", "<u2"),
        ("kind", "<u2"),
        ("session", "<u8"),
        ("number", "<u8"),
        ("sent_ns", "<i8"),
        ("first_ns", "<i8"),
        ("second_ns", "<i8"),
        ("counts", "<u2", (4,)),
    ]
)
_MAGIC = b"vsnd"
_GONE = (None, False, True)
_PICTURE = np.dtype(
    [
        ("camera", "<u2"),
        ("full", "u1"),
        ("capture_ns", "<i8"),
        ("ready_ns", "<i8"),
        ("rows", "<u2"),
        ("unlisted", "<u2"),
    ]
)
_TURN = np.dtype([("camera", "<u2"), ("turn", "<u4"), ("place", "<i4")])
_JOINED = np.dtype([("family", "<u2"), ("tag", "<i4"), ("height_m", "<f8")])
_KNOWN = np.dtype([*KNOWN.newbyteorder("<").descr, ("height_m", "<f8")])
_DETECTION = DETECTION.newbyteorder("<")


class NodeError(VsenseError):
    """A message between tracker and node that cannot be used."""


@dataclass(frozen=True, slots=True)
class Expectation:
    """What a tracker lets a node know.

    Attributes:
        session: Of the tracker, a number drawn at its start.
        number: Of the expectation, rising.
        sent_ns: When it was sent, by the tracker's clock.
        capture_ns: Capture time of the pictures that it is for, by the tracker's clock; 0: those
            that come, dated by the node's.
        offset_ns: How far the node's clock is ahead of the tracker's.
        is_key_frame, gone: See `Prediction`.
        known: KNOWN rows, and `heights_m` (n,) their markers'.
        turns: By the camera's number in the session, its turn (see `Prediction.turns`) and the
            place of its picture in its recording.
        joined: Families' numbers in the session with tags that have joined, and their heights [m].
    """

    session: int
    number: int
    sent_ns: int
    capture_ns: int
    offset_ns: int
    is_key_frame: bool
    gone: bool | None
    known: NDArray[np.void]
    heights_m: NDArray[np.float64]
    turns: Mapping[int, tuple[int, int]]
    joined: Sequence[tuple[int, int, float]] = ()


class SeenPicture(NamedTuple):
    """What a node has found in one picture.

    Attributes:
        camera: Its number in the session.
        capture_ns, ready_ns: See `Frame`; by the node's clock.
    """

    camera: int
    capture_ns: int
    ready_ns: int
    found: Found


@dataclass(frozen=True, slots=True)
class SeenRows:
    """What a node has found in a timestep's pictures.

    Attributes:
        session: Of the tracker that it is for.
        number: Of the message, rising.
        sent_ns: When it was sent, by the node's clock.
        echo_ns: `sent_ns` of the newest expectation that the node has; 0: none.
        held_ns: How long the node has had that one.
    """

    session: int
    number: int
    sent_ns: int
    echo_ns: int
    held_ns: int
    pictures: Sequence[SeenPicture] = field(default=())


def encode_expectation(expectation: Expectation) -> bytes:
    """Returns the message."""
    turns = np.zeros(len(expectation.turns), dtype=_TURN)
    for row, (camera, (turn, place)) in zip(turns, expectation.turns.items()):
        row["camera"], row["turn"], row["place"] = camera, turn, place
    known = np.zeros(len(expectation.known), dtype=_KNOWN)
    for name in KNOWN.names or ():
        known[name] = expectation.known[name]
    known["height_m"] = expectation.heights_m
    joined = np.array([tuple(row) for row in expectation.joined], dtype=_JOINED)
    head = _head(_EXPECT, expectation.session, expectation.number, expectation.sent_ns)
    head["first_ns"], head["second_ns"] = expectation.capture_ns, expectation.offset_ns
    flags = 4 * expectation.is_key_frame + _GONE.index(expectation.gone)
    head["counts"] = (len(turns), len(known), len(joined), flags)
    return b"".join(part.tobytes() for part in (head, turns, known, joined))


def decode_expectation(data: bytes) -> Expectation:
    """Reads the message; raises NodeError."""
    head, rest = _opened(data, _EXPECT)
    turns, known, joined, flags = (int(count) for count in head["counts"])
    (turn_rows, known_rows, joined_rows), rest = _cut(
        rest, (_TURN, turns), (_KNOWN, known), (_JOINED, joined)
    )
    if rest or flags not in (0, 1, 2, 4, 5, 6):
        raise NodeError("an expectation that does not end where it says")
    values = [known_rows[name] for name in ("x_m", "y_m", "yaw_rad", "velocity", "height_m")]
    if not all(np.isfinite(value).all() for value in (*values, joined_rows["height_m"])):
        raise NodeError("an expectation with a place that is no number")
    tags = known_rows["tag"]
    if len(tags) and (tags.min() < 0 or tags.max() > _MOST_TAG or (np.diff(tags) <= 0).any()):
        raise NodeError("an expectation whose tags are not in their order")
    rows = np.zeros(known, dtype=KNOWN)
    for name in KNOWN.names or ():
        rows[name] = known_rows[name]
    return Expectation(
        session=int(head["session"]),
        number=int(head["number"]),
        sent_ns=int(head["sent_ns"]),
        capture_ns=int(head["first_ns"]),
        offset_ns=int(head["second_ns"]),
        is_key_frame=flags >= 4,
        gone=_GONE[flags % 4],
        known=rows,
        heights_m=known_rows["height_m"].astype(np.float64),
        turns={int(r["camera"]): (int(r["turn"]), int(r["place"])) for r in turn_rows},
        joined=[(int(f), int(tag), float(height)) for f, tag, height in joined_rows],
    )


def encode_rows(seen: SeenRows) -> bytes:
    """Returns the message."""
    head = _head(_ROWS, seen.session, seen.number, seen.sent_ns)
    head["first_ns"], head["second_ns"] = seen.echo_ns, seen.held_ns
    head["counts"][0] = len(seen.pictures)
    pictures = np.zeros(len(seen.pictures), dtype=_PICTURE)
    parts = [head, pictures]
    for row, picture in zip(pictures, seen.pictures):
        rows, full, unlisted = picture.found
        row["camera"], row["full"] = picture.camera, full
        row["capture_ns"], row["ready_ns"] = picture.capture_ns, picture.ready_ns
        row["rows"], row["unlisted"] = len(rows), len(unlisted)
        parts += [rows.astype(_DETECTION), unlisted]
    return b"".join(part.tobytes() for part in parts)


def decode_rows(data: bytes, session: int, cameras: Sequence[Camera]) -> SeenRows:
    """Reads the message of a node that has these cameras; raises NodeError."""
    head, rest = _opened(data, _ROWS)
    if int(head["session"]) != session:
        raise NodeError("rows of another session")
    (heads,), rest = _cut(rest, (_PICTURE, int(head["counts"][0])))
    pictures, numbers = [], heads["camera"].tolist()
    if len(set(numbers)) < len(numbers) or max(numbers, default=-1) >= len(cameras):
        raise NodeError("rows of a camera that the node does not have, or of one twice")
    for row in heads:
        (rows, unlisted), rest = _cut(
            rest, (_DETECTION, int(row["rows"])), (UNLISTED, int(row["unlisted"]))
        )
        rows = rows.astype(DETECTION)
        _check(rows, unlisted, cameras[int(row["camera"])])
        found = Found(rows, bool(row["full"]), unlisted.copy())
        capture_ns, ready_ns = int(row["capture_ns"]), int(row["ready_ns"])
        pictures.append(SeenPicture(int(row["camera"]), capture_ns, ready_ns, found))
    if rest:
        raise NodeError("rows that do not end where they say")
    first_ns, second_ns = int(head["first_ns"]), int(head["second_ns"])
    return SeenRows(
        session, int(head["number"]), int(head["sent_ns"]), first_ns, second_ns, pictures
    )


def _check(rows: NDArray[np.void], unlisted: NDArray[np.void], camera: Camera) -> None:
    """Raises NodeError for rows that no detector makes of a picture of that camera."""
    finite = [rows[name] for name in ("x_px", "y_px", "yaw_rad", "covariance", "error")]
    finite += [unlisted["x_m"], unlisted["y_m"]]
    if not all(np.isfinite(values).all() for values in finite):
        raise NodeError("rows with a value that is no number")
    beside = [
        (rows[axis] < -_BESIDE_PX) | (rows[axis] > side - _BESIDE_PX)
        for axis, side in (("x_px", camera.width_px), ("y_px", camera.height_px))
    ]
    if any(outside.any() for outside in beside):
        raise NodeError("rows of markers outside of their picture")
    variances = np.diagonal(rows["covariance"], axis1=1, axis2=2)
    if (variances < 0.0).any() or np.isnan(rows["margin"]).any():
        raise NodeError("rows whose errors cannot be")
    for tags, least in ((rows["tag"], -1), (unlisted["tag"], 0)):
        if len(tags) and (tags.min() < least or tags.max() > _MOST_TAG):
            raise NodeError("rows of a tag that no marker has")


def _head(kind: int, session: int, number: int, sent_ns: int) -> NDArray[np.void]:
    head = np.zeros((), dtype=_HEAD)
    head["magic"], head["version"], head["kind"] = _MAGIC, NODE_FORMAT, kind
    head["session"], head["number"], head["sent_ns"] = session, number, sent_ns
    return head


def _opened(data: bytes, kind: int) -> tuple[NDArray[np.void], bytes]:
    """Returns the head of a message of a kind, and the rest."""
    if len(data) < _HEAD.itemsize or data[:4] != _MAGIC:
        raise NodeError(f"{len(data)} bytes that are no message of vsense")
    head = np.frombuffer(data, _HEAD, 1)[0]
    if head["version"] != NODE_FORMAT:
        raise NodeError(
            f"a message of format {head['version']}, this is {NODE_FORMAT}: expected the same"
            " vsense on both machines"
        )
    if head["kind"] != kind:
        raise NodeError("a message of another kind")
    return head, data[_HEAD.itemsize :]


def _cut(data: bytes, *parts: tuple[np.dtype[Any], int]) -> tuple[list[NDArray[np.void]], bytes]:
    """Returns so many rows of each dtype, and the rest."""
    arrays = []
    for dtype, count in parts:
        size = dtype.itemsize * count
        if count > MOST_ROWS or len(data) < size:
            raise NodeError("a message that is shorter than it says")
        arrays.append(np.frombuffer(data[:size], dtype, count))
        data = data[size:]
    return arrays, data
