"""What a tracker and the nodes of its cameras say to each other, as bytes.

An expectation says where robots were seen last, so that a node can expect them when its pictures
are taken; rows are what it has found there. Both are NumPy rows, little-endian, behind a head with
a version. Whatever comes is looked at before it is used: what is no message, or says what cannot
be, raises `NodeError`.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import DETECTION, UNLISTED, Found
from vsense.base.errors import VsenseError
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking._prediction import KNOWN, MarkerSearch

NODE_FORMAT = 1
"""Of all messages between nodes and trackers; both ends have the same."""
MOST_ROWS = 4096
"""Of one kind in one picture: more than a detector's tables hold."""
MOST_UNLISTED = 256
"""Tags of no roster in one picture: each is compared with all others."""
_MOST_TAG = 65_535
_MOST_NS = 2**62
_FAR = 1e4
"""[m, m/s, rad] No robot is so far away, or so fast."""
_BESIDE_PICTURE_PX, _NEAR_M = 2.0, 0.05
"""A tag of no roster is in its picture, and its place is found again from there: how exactly."""
_BESIDE_PX = 0.5
"""A marker's centre is in its picture, whose pixels reach so far around their middles."""

_MAGIC, _EXPECT, _ROWS = b"vsnd", 1, 2
_HEAD = struct.Struct("<4sHHQQqqq4H")
"""Magic, format, kind, session, number, when it was sent; two times, four counts of the kind's."""
_GONE = (None, False, True)
_PICTURE = struct.Struct("<HBqHH")
_TURN = np.dtype([("camera", "<u2"), ("turn", "<u4"), ("place", "<i4")])
_JOINED = np.dtype([("family", "<u2"), ("tag", "<i4"), ("height_m", "<f8")])
_KNOWN = np.dtype([*KNOWN.newbyteorder("<").descr, ("height_m", "<f8")])
_DETECTION = DETECTION.newbyteorder("<")


class NodeError(VsenseError):
    """A message between tracker and node that cannot be used."""


class Expectation(NamedTuple):
    """What a tracker lets a node know.

    Attributes:
        session: A number that is drawn when the node is opened.
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
    """What a node has found in a picture of a camera, known by its number in the session.

    `capture_ns` is the `Frame`'s, by the node's clock.
    """

    camera: int
    capture_ns: int
    found: Found


class SeenRows(NamedTuple):
    """What a node has found in a timestep's pictures; `number` rises.

    `sent_ns` is by the node's clock. `echo_ns` is that of the newest expectation that it has, which
    it has had for `held_ns`; 0: it has none.
    """

    session: int
    number: int
    sent_ns: int
    echo_ns: int
    held_ns: int
    pictures: Sequence[SeenPicture] = ()


def encode_expectation(it: Expectation) -> bytes:
    """Returns the message."""
    turns = np.array([(camera, *pair) for camera, pair in it.turns.items()], dtype=_TURN)
    joined = np.array([tuple(row) for row in it.joined], dtype=_JOINED)
    known = np.zeros(len(it.known), dtype=_KNOWN)
    for name in KNOWN.names or ():
        known[name] = it.known[name]
    known["height_m"] = it.heights_m
    counts = len(turns), len(known), len(joined), 4 * it.is_key_frame + _GONE.index(it.gone)
    times = it.sent_ns, it.capture_ns, it.offset_ns
    head = _HEAD.pack(_MAGIC, NODE_FORMAT, _EXPECT, it.session, it.number, *times, *counts)
    return head + turns.tobytes() + known.tobytes() + joined.tobytes()


def decode_expectation(data: bytes) -> Expectation:
    """Reads the message; raises NodeError."""
    head, place = _opened(data, _EXPECT)
    session, number, sent_ns, capture_ns, offset_ns, turns, known, joined, flags = head
    turn_rows, place = _cut(data, place, _TURN, turns)
    known_rows, place = _cut(data, place, _KNOWN, known)
    joined_rows, place = _cut(data, place, _JOINED, joined)
    if place != len(data) or flags not in (0, 1, 2, 4, 5, 6):
        raise NodeError("an expectation that does not end where it says")
    values = [known_rows[name] for name in ("x_m", "y_m", "yaw_rad", "velocity", "height_m")]
    if not all((np.abs(value) <= _FAR).all() for value in (*values, joined_rows["height_m"])):
        raise NodeError("an expectation with a place where no robot is")
    if max(map(abs, (capture_ns, offset_ns))) > _MOST_NS:
        raise NodeError("an expectation of a time that no clock has")
    tags = known_rows["tag"]
    if len(tags) and (tags.min() < 0 or tags.max() > _MOST_TAG or (np.diff(tags) <= 0).any()):
        raise NodeError("an expectation whose tags are not in their order")
    rows = np.zeros(known, dtype=KNOWN)
    for name in KNOWN.names or ():
        rows[name] = known_rows[name]
    heights_m = known_rows["height_m"].astype(np.float64)
    by_camera = {camera: (turn, at) for camera, turn, at in turn_rows.tolist()}
    about = session, number, sent_ns, capture_ns, offset_ns, flags >= 4, _GONE[flags % 4]
    return Expectation(*about, rows, heights_m, by_camera, joined_rows.tolist())


def encode_rows(it: SeenRows) -> bytes:
    """Returns the message."""
    head = it.session, it.number, it.sent_ns, it.echo_ns, it.held_ns
    parts = [_HEAD.pack(_MAGIC, NODE_FORMAT, _ROWS, *head, len(it.pictures), 0, 0, 0)]
    for camera, capture_ns, (rows, full, unlisted) in it.pictures:
        sizes = len(rows), len(unlisted)
        parts.append(_PICTURE.pack(camera, full, capture_ns, *sizes))
        parts += [rows.astype(_DETECTION).tobytes(), unlisted.tobytes()]
    return b"".join(parts)


def decode_rows(
    data: bytes, session: int, cameras: Sequence[Camera], searches: Sequence[MarkerSearch]
) -> SeenRows:
    """Reads the message of a node whose cameras search so; raises NodeError."""
    head, place = _opened(data, _ROWS)
    sent_for, number, sent_ns, echo_ns, held_ns, count, *_ = head
    if sent_for != session:
        raise NodeError("rows of another session")
    pictures: dict[int, SeenPicture] = {}
    for _ in range(count):
        if len(data) < place + _PICTURE.size:
            raise NodeError("a message that is shorter than it says")
        camera, full, capture_ns, *sizes = _PICTURE.unpack_from(data, place)
        if camera >= len(cameras) or camera in pictures:
            raise NodeError("rows of a camera that the node does not have, or of one twice")
        found, place = _cut(data, place + _PICTURE.size, _DETECTION, sizes[0])
        unlisted, place = _cut(data, place, UNLISTED, sizes[1])
        rows = found.astype(DETECTION)
        _check(rows, cameras[camera])
        _check_unlisted(unlisted, cameras[camera], searches[camera])
        seen = Found(rows, bool(full), unlisted.copy())
        pictures[camera] = SeenPicture(camera, capture_ns, seen)
    if place != len(data):
        raise NodeError("rows that do not end where they say")
    return SeenRows(session, number, sent_ns, echo_ns, held_ns, list(pictures.values()))


def _check(rows: NDArray[np.void], camera: Camera) -> None:
    """Raises NodeError for rows that no detector makes of a picture of that camera."""
    finite = [rows[name] for name in ("x_px", "y_px", "yaw_rad", "covariance", "error")]
    if not all(np.isfinite(value).all() for value in finite):
        raise NodeError("rows with a value that is no number")
    for axis, side in (("x_px", camera.width_px), ("y_px", camera.height_px)):
        if ((rows[axis] < -_BESIDE_PX) | (rows[axis] > side - _BESIDE_PX)).any():
            raise NodeError("rows of markers outside of their picture")
    variances = np.diagonal(rows["covariance"], axis1=1, axis2=2)
    if (variances < 0.0).any() or np.isnan(rows["margin"]).any():
        raise NodeError("rows whose errors cannot be")
    tags = rows["tag"]
    if len(tags) and (tags.min() < -1 or tags.max() > _MOST_TAG):
        raise NodeError("rows of a tag that no marker has")


def _check_unlisted(rows: NDArray[np.void], camera: Camera, search: MarkerSearch) -> None:
    """Raises NodeError for tags of no roster that a picture of that camera cannot show."""
    if len(rows) > MOST_UNLISTED:
        raise NodeError(f"{len(rows)} tags of no roster, expected at most {MOST_UNLISTED}")
    tags, places = rows["tag"], np.stack((rows["x_m"], rows["y_m"]), axis=-1)
    if len(tags) and (tags.min() < 0 or tags.max() >= search.family.tags):
        raise NodeError(f"rows of a tag that the family {search.family.name} does not have")
    if not (np.abs(places) <= _FAR).all():
        raise NodeError("rows of a place where no robot is")
    points = np.column_stack((places, np.full(len(places), search.height_m)))
    with np.errstate(all="ignore"):  # what is beside a camera, or behind it, has no pixel
        pixels = camera.project(points)
        again = camera.to_plane(pixels, search.height_m)
    off_m = np.abs(again - places).max(axis=-1, initial=0.0)
    if not (camera.contains(pixels, -_BESIDE_PICTURE_PX) & (off_m <= _NEAR_M)).all():
        raise NodeError("rows of tags outside of their picture")


def _opened(data: bytes, kind: int) -> tuple[list[int], int]:
    """Returns what the head of a message of a kind says, and where the rest begins."""
    if len(data) < _HEAD.size or data[:4] != _MAGIC:
        raise NodeError(f"{len(data)} bytes that are no message of vsense")
    _, version, sent_kind, *head = _HEAD.unpack_from(data)
    if version != NODE_FORMAT:
        raise NodeError(
            f"a message of format {version}, this is {NODE_FORMAT}: expected the same vsense on"
            " both computers"
        )
    if sent_kind != kind:
        raise NodeError("a message of another kind")
    return head, _HEAD.size


def _cut(data: bytes, place: int, dtype: np.dtype[Any], count: int) -> tuple[NDArray[np.void], int]:
    """Returns so many rows of a dtype from a place on, and where the rest begins."""
    end = place + dtype.itemsize * count
    if count > MOST_ROWS or len(data) < end:
        raise NodeError("a message that is shorter than it says")
    return np.frombuffer(data, dtype, count, place), end
