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
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._node_rows import (
    MOST_UNLISTED,
    Expectation,
    NodeError,
    SeenPicture,
    SeenRows,
    decode_expectation,
    decode_rows,
    encode_expectation,
    encode_rows,
)
from vsense.vision.tracking._prediction import KNOWN, MarkerSearch

CAMERAS = [
    Camera.looking_down(n, x, 0.0, 2.4, 1600.0, (600, 480)) for n, x in (("a", -1), ("b", 1))
]
SEARCHES = 2 * [MarkerSearch(load_family("arrow4x4"), {31: 0.06})]
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
    x_m = (-0.75, 1.25)[min(camera, 1)]
    unlisted = np.array([(tag, x_m, -0.25) for tag in tags], dtype=UNLISTED)
    return SeenPicture(camera, 1_000, Found(found, True, unlisted))


def test_rows_come_as_they_went() -> None:
    sent = seen(picture(1, rows((10.5, 20.25), (599.4, 479.4))), picture(0, rows(), (7, 65_535)))
    got = decode_rows(encode_rows(sent), SESSION, CAMERAS, SEARCHES)
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


@pytest.mark.parametrize(
    "what",
    [{"offset_ns": -(2**63)}, {"capture_ns": 2**63 - 1}, {"x_m": 1e5}, {"velocity": np.inf},
     {"joined": [(0, 31, 1e300)]}],
    ids=str,
)  # fmt: skip
def test_an_expectation_of_what_cannot_be_is_refused(what: dict[str, Any]) -> None:
    known = np.zeros(1, dtype=KNOWN)
    about: dict[str, Any] = {"capture_ns": 12, "offset_ns": -13, "joined": []}
    for name, value in what.items():
        if name in about:
            about[name] = value
        else:
            known[name] = value
    times = about["capture_ns"], about["offset_ns"]
    it = Expectation(SESSION, 9, 11, *times, True, None, known, np.zeros(1), {}, about["joined"])
    with pytest.raises(NodeError, match="an expectation"):
        decode_expectation(encode_expectation(it))


def test_the_bytes_by_hand() -> None:
    """Worked out by hand: little-endian, nothing between fields."""
    data = encode_rows(seen(picture(1, rows((10.5, 20.25)), (7,))))
    head = struct.pack("<4sHHQQqqq4H", b"vsnd", 1, 2, SESSION, 7, 5_000, 4_000, 300, 1, 0, 0, 0)
    one = struct.pack("<HBqHH", 1, 1, 1_000, 1, 1)
    covariance = (1e-8, 0, 0, 0, 1e-8, 0, 0, 0, 1e-6)
    marker = struct.pack("<i3d9d2f??", 31, 10.5, 20.25, 0.25, *covariance, 0.02, 9.0, True, False)
    assert data == head + one + marker + struct.pack("<idd", 7, 1.25, -0.25)


BAD = {
    "a value that is no number": rows((10.0, float("nan"))),
    "outside": rows((600.0, 20.0)),
    "a tag": rows((10.0, 10.0), tag=70_000),
    "errors": rows((10.0, 10.0), covariance=-np.eye(3)),
}


@pytest.mark.parametrize("words", BAD)
def test_what_no_detector_says_is_refused(words: str) -> None:
    with pytest.raises(NodeError, match=words):
        decode_rows(encode_rows(seen(picture(0, BAD[words]))), SESSION, CAMERAS, SEARCHES)


@pytest.mark.parametrize(
    ("tag", "x_m", "y_m", "count", "words"),
    [
        (7, -0.75, -0.25, MOST_UNLISTED + 1, "expected at most 256"),
        (70_000, -0.75, -0.25, 1, "does not have"),
        (-1, -0.75, -0.25, 1, "does not have"),
        (7, float("nan"), -0.25, 1, "where no robot is"),
        (7, 1e300, -0.25, 1, "where no robot is"),
        (7, 0.75, -0.25, 1, "outside of their picture"),
        (7, 5e3, 5e3, 1, "outside of their picture"),
    ],
)
def test_tags_of_no_roster_are_where_the_picture_shows_them(
    tag: int, x_m: float, y_m: float, count: int, words: str
) -> None:
    unlisted = np.array(count * [(tag, x_m, y_m)], dtype=UNLISTED)
    sent = seen(SeenPicture(0, 1_000, Found(rows(), True, unlisted)))
    with pytest.raises(NodeError, match=words):
        decode_rows(encode_rows(sent), SESSION, CAMERAS, SEARCHES)


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
            decode_rows(changed, SESSION, CAMERAS, SEARCHES)


@given(st.binary(max_size=400), st.integers(0, 200), st.binary(min_size=1, max_size=8))
def test_any_bytes_are_rows_or_one_error(data: bytes, place: int, patch: bytes) -> None:
    whole = encode_rows(seen(picture(0, rows((10.0, 10.0)), (7,)), picture(1, rows((1.0, 1.0)))))
    patched = whole[:place] + patch + whole[place + len(patch) :]
    for attempt in (data, whole[:60] + data, patched):
        for read in (
            lambda d: decode_rows(d, SESSION, CAMERAS, SEARCHES),
            decode_expectation,
        ):
            try:
                read(attempt)
            except NodeError:
                continue
