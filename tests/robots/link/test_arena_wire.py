"""The original tracking server's bytes, against encoders written from its description alone."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.robots.link.arena_rig import locate, message, state
from vsense.robots.link.status import LinkError
from vsense.robots.link.trackers.protocol import (
    ROBOTS_MAX,
    STATE_MAX,
    StateInbox,
    TrackerCommand,
    TrackerReport,
    decode_state,
    encode_command,
    encode_state,
)

TAGS = st.integers(0, 2**32 - 1)
PLACES = st.floats(-9999.0, 9999.0)
TURNS = st.floats(-math.pi, math.pi, exclude_min=True)
ROBOTS = st.lists(st.tuples(TAGS, PLACES, PLACES, TURNS), max_size=5)


def test_commands_are_three_big_endian_words() -> None:
    assert encode_command(TrackerCommand.START_EXPERIMENT) == b"\0\0\0\0"
    assert encode_command(TrackerCommand.STOP_EXPERIMENT) == b"\0\0\0\1"
    assert encode_command(TrackerCommand.ONE_SHOT) == b"\0\0\0\2"


def test_state_is_length_and_seven_tokens_per_robot() -> None:
    arena = state(4, (23, 0.1, -0.2, math.pi / 2), (24, 1.0, 2.0, math.pi))
    text = "7 23 23.50 46.25 -45.000 0.10000 -0.20000 90.000"
    text += " 24 24.50 48.25 -45.000 1.00000 2.00000 180.000"
    assert encode_state(7, arena.robots, locate(arena.robots)) == message(text)


def test_state_without_robots_is_the_timestep() -> None:
    arena = state(0)
    assert encode_state(0, arena.robots, locate(arena.robots)) == b"\0\0\0\x010"


def test_robots_that_are_not_seen_are_left_out() -> None:
    arena = state(0, (1, 0.0, 0.0, 0.0), (2, 0.0, 0.0, 0.0), unseen=(1,))
    assert encode_state(0, arena.robots, locate(arena.robots))[4:].split(b" ")[1] == b"2"


@given(st.integers(0, 2**32 - 1), ROBOTS)
def test_decoding_gives_back_what_was_encoded(timestep: int, robots: list) -> None:
    arena = state(0, *robots)
    body = encode_state(timestep, arena.robots, locate(arena.robots))[4:]
    theirs, reports = decode_state(body)
    assert theirs == timestep and [r.tag for r in reports] == [r[0] for r in robots]
    for report, (_, x_m, y_m, yaw_rad) in zip(reports, robots):
        assert report.x_m == pytest.approx(x_m, abs=1e-5)
        assert report.y_m == pytest.approx(y_m, abs=1e-5)
        assert math.cos(report.yaw_rad - yaw_rad) == pytest.approx(1.0, abs=1e-9)
        assert -math.pi < report.yaw_rad <= math.pi


@given(st.floats(-1e5, 1e5))
def test_defect_10_angles_wrap_at_half_a_turn(degrees: float) -> None:
    (report,) = decode_state(f"1 5 0 0 0 0.5 0.5 {degrees!r}".encode())[1]
    assert -math.pi < report.yaw_rad <= math.pi
    assert math.cos(report.yaw_rad - math.radians(degrees)) == pytest.approx(1.0, abs=1e-9)


def test_other_ways_to_write_numbers_are_understood() -> None:
    body = b"12 5 -1 nonsense 3.5e2 1e-1 +2 -180 "
    assert decode_state(body) == (12, [TrackerReport(5, 0.1, 2.0, math.pi)])


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (b"", "timestep ''|0 tokens"),
        (b"x", "timestep 'x'"),
        (b"-1", "timestep '-1'"),
        (b"4294967296", "timestep '4294967296'"),
        (b"1 2 3", "3 tokens.*1 [+] 7"),
        (b"1 5 0 0 0 nan 0 0", "place 'nan'"),
        (b"1 5 0 0 0 0 inf 0", "place 'inf'"),
        (b"1 5 0 0 0 0 1e9 0", "place '1e9'"),
        (b"1 5 0 0 0 0 0 north", "angle 'north'"),
        (b"1 5.0 0 0 0 0 0 0", "'5.0'"),
        (b"1  5 0 0 0 0 0 0", "9 tokens"),
        (b"\xff\xfe", "expected a whole number"),
    ],
)
def test_what_is_no_state_is_refused_with_its_token(body: bytes, reason: str) -> None:
    with pytest.raises(LinkError, match=reason):
        decode_state(body)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_state_or_one_named_error(body: bytes) -> None:
    try:
        decode_state(body)
    except LinkError as error:
        assert str(error)


@given(st.lists(st.text("0123456789 .-", max_size=40), max_size=6), st.data())
def test_defect_1_any_chunking_gives_the_same_states(texts: list[str], data: st.DataObject) -> None:
    stream = b"".join(map(message, texts))
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=8).map(sorted))
    inbox, found = StateInbox(), []
    for start, end in zip([0, *cuts], [*cuts, len(stream)]):
        found += inbox.feed(stream[start:end])
    assert found == [text.encode() for text in texts]


@given(st.integers(STATE_MAX + 1, 2**32 - 1))
def test_defect_7_a_length_that_no_state_has_is_refused_at_once(length: int) -> None:
    with pytest.raises(LinkError, match=f"of {length} bytes"):
        StateInbox().feed(struct.pack(">I", length))


def test_states_are_bounded_by_robots_too() -> None:
    arena = state(0, *[(2**32 - 1, -1234.5, -1234.5, -3.1)] * (ROBOTS_MAX + 1))
    body = encode_state(2**32 - 1, arena.robots, np.full((ROBOTS_MAX + 1, 3), -12345.0))[4:]
    assert len(body) < STATE_MAX
    with pytest.raises(LinkError, match=r"1025 robots.*1024"):
        decode_state(body)
    assert len(decode_state(body[: body.rindex(b" 4294967295")])[1]) == ROBOTS_MAX
