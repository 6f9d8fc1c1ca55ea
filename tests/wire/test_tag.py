"""The tag of a packet, held against the vectors that Chaskey's authors give for 12 rounds.

Source: `vectors` of the reference of Chaskey-12 by N. Mouha (2015): the key is 00 11 22 .. ff, the
message of each length n the bytes 0 to n - 1; they have the first 8 of the 16 bytes.
"""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.golden.plain_encoder import chaskey
from vsense.base.native import ffi, lib

OFFICIAL = (
    *("dd3e1849d6824555", "ed1da89ec93179ca", "98fe20a343cd666f", "f6f418acdd7d9fa1"),
    *("4cf04960099949f3", "75c83252653d3b57", "964b0461fbe92273", "141fa08bbf399636"),
    *("412d98ed936d4ab2", "fb0d98bc70e305f9", "36f88e1fda86c8ab", "4d1a1815868a5aa8"),
    *("7a7912c1999eae81", "9ca11137b4a34601", "7905142f3be77e67", "6a3ee3d35c043397"),
    *("d13970d7be9b2350", "32acd914bfda3bc8", "8a58d816cb7a1483", "03f4d66638efad8d"),
    *("f9932237ff05e831", "f5fedb134862b471", "8bb55486f38d57ea", "8a3acb94b5ad591c"),
    *("7ce3708723f7495f", "f42f3d2f405710c2", "b3933a167e5636ac", "899a7945423a5e1b"),
    *("65e12df5a695fac8", "b82449d8c8a06ae9", "a850dfbadefa4229", "fd42c39d08ab71a0"),
    *("b465c2412610bf84", "89c4a9ddb53e6991"),
)


def tag(key: bytes, data: bytes) -> bytes:
    made = ffi.new("uint8_t[16]")
    lib.vs_tag_make(key, data, len(data), made)
    return bytes(made)


@pytest.mark.parametrize("length", range(len(OFFICIAL)))
def test_official_vectors(length: int) -> None:
    expected = bytes.fromhex(OFFICIAL[length])
    key, data = bytes(0x11 * i for i in range(16)), bytes(range(length))
    assert tag(key, data) == chaskey(key, data)
    assert tag(key, data)[:8] == expected


@given(st.binary(min_size=16, max_size=16), st.binary(max_size=1300), st.integers(0, 3))
def test_any_key_and_message_at_any_address(key: bytes, data: bytes, shift: int) -> None:
    room = ffi.new("uint8_t[]", bytes(shift) + data)
    made = ffi.new("uint8_t[16]")
    lib.vs_tag_make(key, room + shift, len(data), made)
    assert bytes(made) == chaskey(key, data)
