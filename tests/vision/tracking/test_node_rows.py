"""Messages between trackers and nodes: what goes in comes out, and nothing else gets in."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.arena import DETECTION, UNLISTED, Found
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking._node_rows import (
    Expectation,
    NodeError,
    SeenPicture,
    SeenRows,
    decode_expectation,
    decode_rows,
    encode_expectation,
    encode_rows,
)
from vsense.vision.tracking._prediction import KNOWN

CAMERAS = [
    Camera.looking_down(n, x, 0.0, 2.4, 1600.0, (600, 480)) for n, x in (("a", -1), ("b", 1))
]
SESSION = 0x1122334455667788


def rows(*places_px: tuple[float, float], **values: Any) -> np.ndarray:
    """DETECTION rows of markers at places in a picture."""
    made = np.zeros(len(places_px), dtype=DETECTION)
    for row, (x, y) in zip(made, places_px):
        row["tag"], row["x_px"], row["y_px"], row["yaw_rad"] = 31, x, y, 0.25
        row["covariance"] = np.diag((1e-8, 1e-8, 1e-6))
        row["error"], row["margin"], row["read"] = 0.02, 9.0, True
    for name, value in values.items():
        made[name] = value
    return made


def seen(*pictures: SeenPicture, number: int = 7, session: int = SESSION) -> SeenRows:
    return SeenRows(session, number, 5_000, 4_000, 300, pictures)


def picture(camera: int, found: np.ndarray, tags: tuple[int, ...] = ()) -> SeenPicture:
    unlisted = np.array([(tag, 0.5, -0.5) for tag in tags], dtype=UNLISTED)
    return SeenPicture(camera, 1_000, Found(found, True, unlisted))


def test_rows_come_as_they_went() -> None:
    sent = seen(picture(1, rows((10.5, 20.25), (599.4, 479.4))), picture(0, rows(), (7, 65_535)))
    got = decode_rows(encode_rows(sent), SESSION, CAMERAS)
    assert (got.number, got.sent_ns, got.echo_ns, got.held_ns) == (7, 5_000, 4_000, 300)
    for one, other in zip(sent.pictures, got.pictures, strict=True):
        assert one[:2] == other[:2] and one.found.full == other.found.full
        assert one.found.rows.tobytes() == other.found.rows.tobytes()
        assert one.found.unlisted.tobytes() == other.found.unlisted.tobytes()


@pytest.mark.parametrize("gone", [None, False, True])
def test_an_expectation_comes_as_it_went(gone: bool | None) -> None:
    known = np.zeros(2, dtype=KNOWN)
    known["tag"], known["x_m"], known["velocity"][1] = (3, 31), (0.1, -0.7), (0.01, 0.02, 0.3)
    heights_m = np.array([0.06, 0.12])
    sent = Expectation(
        SESSION,
        9,
        11,
        12,
        -13,
        True,
        gone,
        known,
        heights_m,
        {0: (5, 40), 1: (6, -1)},
        [(1, 700, 0.06)],
    )
    got = decode_expectation(encode_expectation(sent))
    assert got.known.tobytes() == known.tobytes()
    assert got.heights_m.tolist() == heights_m.tolist()
    for name in ("session", "number", "sent_ns", "capture_ns", "offset_ns", "is_key_frame", "gone"):
        assert getattr(got, name) == getattr(sent, name)
    assert (got.turns, list(got.joined)) == (sent.turns, list(sent.joined))


def test_the_bytes_by_hand() -> None:
    """Worked out by hand: little-endian, nothing between fields."""
    data = encode_rows(seen(picture(1, rows((10.5, 20.25)), (7,))))
    head = struct.pack("<4sHHQQqqq4H", b"vsnd", 1, 2, SESSION, 7, 5_000, 4_000, 300, 1, 0, 0, 0)
    one = struct.pack("<HBqHH", 1, 1, 1_000, 1, 1)
    covariance = (1e-8, 0, 0, 0, 1e-8, 0, 0, 0, 1e-6)
    marker = struct.pack("<i3d9d2f??", 31, 10.5, 20.25, 0.25, *covariance, 0.02, 9.0, True, False)
    assert data == head + one + marker + struct.pack("<idd", 7, 0.5, -0.5)


BAD = {
    "a value that is no number": rows((10.0, float("nan"))),
    "outside": rows((600.0, 20.0)),
    "a tag": rows((10.0, 10.0), tag=70_000),
    "errors": rows((10.0, 10.0), covariance=-np.eye(3)),
}


@pytest.mark.parametrize("words", BAD)
def test_what_no_detector_says_is_refused(words: str) -> None:
    with pytest.raises(NodeError, match=words):
        decode_rows(encode_rows(seen(picture(0, BAD[words]))), SESSION, CAMERAS)


def test_another_session_version_or_camera_is_refused() -> None:
    data = encode_rows(seen(picture(0, rows((10.0, 10.0)))))
    for changed, words in (
        (data[:4] + b"\2" + data[5:], "format 2, this is 1"),
        (b"vsns" + data[4:], "no message"),
        (data[:6] + b"\1" + data[7:], "another kind"),
        (encode_rows(seen(session=1)), "another session"),
        (encode_rows(seen(picture(2, rows()))), "does not have"),
        (encode_rows(seen(picture(1, rows()), picture(1, rows()))), "twice"),
        (data + b"\0", "do not end"),
        (data[:-1], "shorter"),
    ):
        with pytest.raises(NodeError, match=words):
            decode_rows(changed, SESSION, CAMERAS)


@given(st.binary(max_size=400), st.integers(0, 200), st.binary(min_size=1, max_size=8))
def test_any_bytes_are_rows_or_one_error(data: bytes, place: int, patch: bytes) -> None:
    whole = encode_rows(seen(picture(0, rows((10.0, 10.0)), (7,)), picture(1, rows((1.0, 1.0)))))
    patched = whole[:place] + patch + whole[place + len(patch) :]
    for attempt in (data, whole[:60] + data, patched):
        for read in (
            lambda d: decode_rows(d, SESSION, CAMERAS),
            decode_expectation,
        ):
            try:
                read(attempt)
            except NodeError:
                continue
