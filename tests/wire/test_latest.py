"""The latest-value buffer against the plainest model: one variable."""

from __future__ import annotations

import struct
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from vsense.native import ffi, lib

SLOT = 8


class LatestBuffer(RuleBasedStateMachine):
    """Writer and reader take turns in any order, between any two of their steps."""

    def __init__(self) -> None:
        super().__init__()
        self.memory = ffi.new("uint8_t[]", lib.VS_LATEST_SLOTS * SLOT)
        self.buffer = ffi.new("struct vs_latest *")
        lib.vs_latest_init(self.buffer, self.memory, SLOT)
        self.stamp = ffi.new("struct vs_latest_stamp *")
        self.slot: Any = None
        self.begun = 0
        self.newest = (0, 0, 0)  # sequence, value, capture_ns
        self.held: tuple[Any, bytes] | None = None

    @rule(value=st.integers(0, 2**64 - 1))
    def begin(self, value: int) -> None:
        """The writer fills its slot; nobody may see that yet."""
        self.slot = lib.vs_latest_write_begin(self.buffer)
        self.begun = value
        ffi.memmove(self.slot, struct.pack("<Q", value), SLOT)

    @rule(capture_ns=st.integers(0, 2**63))
    def commit(self, capture_ns: int) -> None:
        if self.slot is None:
            return
        assert lib.vs_latest_write_commit(self.buffer, SLOT, capture_ns) == 0
        self.newest = (self.newest[0] + 1, self.begun, capture_ns)
        self.slot = None

    @rule()
    def commit_too_much(self) -> None:
        assert lib.vs_latest_write_commit(self.buffer, SLOT + 1, 0) == lib.VS_ERR_SPACE

    @rule()
    def read(self) -> None:
        """The reader gets the newest value, not one before and not half of one."""
        pointer = lib.vs_latest_read(self.buffer, self.stamp)
        sequence, value, capture_ns = self.newest
        if sequence == 0:
            assert pointer == ffi.NULL
            return
        data = bytes(ffi.buffer(pointer, SLOT))
        assert struct.unpack("<Q", data) == (value,)
        assert (self.stamp.sequence, self.stamp.capture_ns) == (sequence, capture_ns)
        assert self.stamp.size == SLOT
        self.held = (pointer, data)

    @invariant()
    def what_the_reader_holds_does_not_change(self) -> None:
        if self.held is not None:
            pointer, data = self.held
            assert bytes(ffi.buffer(pointer, SLOT)) == data


TestLatestBuffer = LatestBuffer.TestCase


def test_a_value_has_an_age() -> None:
    stamp = ffi.new("struct vs_latest_stamp *", {"capture_ns": 1000})
    assert lib.vs_latest_age_ns(stamp, 1250) == 250
    assert lib.vs_latest_age_ns(stamp, 999) == 0
