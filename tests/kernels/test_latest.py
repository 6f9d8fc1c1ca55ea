"""The exchange of slots against the plainest model: one variable."""

from __future__ import annotations

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from vsense.base.native import kernel_ffi, kernels


class Exchange(RuleBasedStateMachine):
    """Writer and reader take turns in any order, between any two of their steps."""

    def __init__(self) -> None:
        super().__init__()
        self.exchange = kernel_ffi.new("struct vs_latest *")
        kernels.vs_latest_init(self.exchange)
        self.slots: list[int | None] = [None] * kernels.VS_LATEST_SLOTS
        self.newest: int | None = None
        self.held: tuple[int, int] | None = None

    @rule(value=st.integers(0, 2**64 - 1))
    def fill(self, value: int) -> None:
        """The writer fills its slot; nobody may see that yet."""
        self.slots[kernels.vs_latest_write_slot(self.exchange)] = value

    @rule(value=st.integers(0, 2**64 - 1))
    def commit(self, value: int) -> None:
        self.fill(value)
        kernels.vs_latest_write_commit(self.exchange)
        self.newest = value

    @rule()
    def read(self) -> None:
        """The reader gets the newest value once, not one before and not half of one."""
        slot = kernels.vs_latest_read(self.exchange)
        if self.newest is None:
            assert slot == -1
            return
        assert self.slots[slot] == self.newest
        self.held, self.newest = (slot, self.newest), None

    @invariant()
    def what_the_reader_holds_does_not_change(self) -> None:
        if self.held is not None:
            slot, value = self.held
            assert self.slots[slot] == value
            assert slot != kernels.vs_latest_write_slot(self.exchange)


TestExchange = Exchange.TestCase
