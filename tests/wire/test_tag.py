"""The tag of a packet, held against the vectors that SipHash's authors give for 128 bits.

Source: `vectors_sip128` of the reference by J.-P. Aumasson and D. J. Bernstein: the key is the
bytes 0 to 15, the message of each length n the bytes 0 to n - 1.
"""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.golden.plain_encoder import siphash
from vsense.base.native import ffi, lib

OFFICIAL = (
    "a3817f04ba25a8e66df67214c7550293",
    "da87c1d86b99af44347659119b22fc45",
    "8177228da4a45dc7fca38bdef60affe4",
    "9c70b60c5267a94e5f33b6b02985ed51",
    "f88164c12d9c8faf7d0f6e7c7bcd5579",
    "1368875980776f8854527a07690e9627",
    "14eeca338b208613485ea0308fd7a15e",
    "a1f1ebbed8dbc153c0b84aa61ff08239",
    "3b62a9ba6258f5610f83e264f31497b4",
)


def tag(key: bytes, data: bytes) -> bytes:
    made = ffi.new("uint8_t[16]")
    lib.vs_tag_make(key, data, len(data), made)
    return bytes(made)


@pytest.mark.parametrize("length", range(len(OFFICIAL)))
def test_official_vectors(length: int) -> None:
    expected = bytes.fromhex(OFFICIAL[length])
    key, data = bytes(range(16)), bytes(range(length))
    assert tag(key, data) == siphash(key, data) == expected


@given(st.binary(min_size=16, max_size=16), st.binary(max_size=1300))
def test_any_key_and_message(key: bytes, data: bytes) -> None:
    assert tag(key, data) == siphash(key, data)
