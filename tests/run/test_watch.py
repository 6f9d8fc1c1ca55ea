"""The newest arena state with its pictures between two threads: whole, newest, and stamped."""

from __future__ import annotations

import gc
import sys
import threading
import weakref
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.arena import POSE, ArenaState, Frame
from vsense.run.watch import ArenaBuffer, NoArenaState, Stamped, Watch

NUMBERS = st.integers(0, 2**62)
PATIENCE_S = 20.0


def state(timestep: int, robots: int) -> ArenaState:
    poses = np.zeros(robots, POSE)
    poses["x_m"] = timestep
    return ArenaState(timestep, 1000 + timestep, poses, detected=robots)


def pictures(timestep: int) -> list[Frame]:
    image = np.full((8, 8), timestep % 251, np.uint8)
    return [Frame("top", image, timestep, 1000 + timestep, 2000 + timestep)]


def whole(taken: Stamped) -> bool:
    """Whether state and pictures are of one timestep."""
    timestep = taken.state.timestep
    (frame,) = taken.frames
    return (
        taken.sequence == timestep == frame.timestep
        and len(taken.state.robots) == timestep % 50
        and bool((taken.state.robots["x_m"] == timestep).all())
        and bool((frame.image == timestep % 251).all())
    )


@given(NUMBERS, NUMBERS)
def test_a_state_of_any_size_comes_out_as_it_went_in_once(ready_ns: int, done_ns: int) -> None:
    buffer = ArenaBuffer()
    assert buffer.read() is None
    written, frames = state(7, 5000), pictures(7)
    buffer.write(written, frames, ready_ns, done_ns)
    assert buffer.read() == (written, frames, ready_ns, done_ns, 1)
    assert buffer.read() is None


def test_defect_05_reader_never_sees_a_torn_state_and_knows_what_it_missed() -> None:
    """Defect 5 of the original: the buffer locked its writer only, and nothing had a sequence."""
    buffer = ArenaBuffer()
    total = 20_000

    def write() -> None:
        for timestep in range(1, total + 1):
            buffer.write(state(timestep, timestep % 50), pictures(timestep), timestep, timestep)

    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    writer = threading.Thread(target=write)
    writer.start()
    newest = 0
    try:
        while newest < total:
            taken = buffer.read()
            if taken is not None:
                assert taken.sequence > newest and whole(taken)
                newest = taken.sequence
    finally:
        writer.join()
        sys.setswitchinterval(interval_s)
    assert buffer.read() is None


def test_a_writer_far_ahead_touches_nothing_that_the_reader_holds_and_keeps_nothing_else() -> None:
    buffer = ArenaBuffer()
    written: list[weakref.ref[np.ndarray]] = []
    alive = lambda: sum(image() is not None for image in written)  # noqa: E731

    def write(timestep: int) -> None:
        frames = pictures(timestep)
        written.append(weakref.ref(frames[0].image))
        buffer.write(state(timestep, timestep % 50), frames, 0, 0)

    write(1)
    held = buffer.read()
    assert held is not None
    for timestep in range(2, 300):
        write(timestep)
        gc.collect(0)
        assert whole(held)
        assert alive() == 2, "what the reader holds, and the newest"
    held = buffer.read()
    assert held is not None and held.sequence == 299 and alive() == 1
    held = None
    gc.collect()
    assert alive() == 0


class Source:
    """Gives timesteps as a test lets it."""

    def __init__(self) -> None:
        self.due = threading.Semaphore(0)
        self.waiting = threading.Semaphore(0)
        self.failure: Exception | None = None
        self.given: list[weakref.ref[np.ndarray]] = []
        self._timestep = 0

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        self.waiting.release()
        assert self.due.acquire(timeout=PATIENCE_S)
        if self.failure is not None:
            raise self.failure
        self._timestep += 1
        frames = pictures(self._timestep)
        self.given.append(weakref.ref(frames[0].image))
        return state(self._timestep, self._timestep % 50), frames

    def start(self) -> None:
        """See `ArenaSource`."""

    def stop(self) -> None:
        """See `ArenaSource`."""


def test_the_newest_is_given_once_and_a_failure_to_every_caller() -> None:
    source = Source()
    watch = Watch(source, lambda: 5000)
    with pytest.raises(NoArenaState, match=r"arena state.*0 s"):
        watch.next(0.0)
    watch.start()
    source.due.release(3)
    for _ in range(4):
        assert source.waiting.acquire(timeout=PATIENCE_S)
    newest = watch.next(PATIENCE_S)
    assert whole(newest) and (newest.sequence, newest.done_ns) == (3, 5000)
    assert newest.ready_ns == 2003, "when the last picture was in memory"
    with pytest.raises(NoArenaState):
        watch.next(0.0)
    source.failure = ValueError("the tracker")
    source.due.release()
    for _ in range(2):
        with pytest.raises(ValueError, match="the tracker"):
            watch.next(PATIENCE_S)
    watch.close()


def test_a_watch_whose_source_waits_keeps_no_pictures() -> None:
    source = Source()
    watch = Watch(source, lambda: 5000)
    watch.start()
    source.due.release()
    for _ in range(2):
        assert source.waiting.acquire(timeout=PATIENCE_S)
    newest: Stamped | None = watch.next(PATIENCE_S)
    assert newest is not None and whole(newest) and source.given[0]() is not None
    newest = None
    gc.collect()
    assert source.given[0]() is None
    source.failure = ValueError("the end")
    source.due.release()
    watch.close()
