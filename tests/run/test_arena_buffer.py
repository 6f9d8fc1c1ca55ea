"""The newest arena state between two threads: whole, newest, and stamped."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.arena import IMAGE_POSE, POSE, SIGHTING, ArenaState
from vsense.native import WireError
from vsense.run.watch import ArenaBuffer

NUMBERS = st.integers(0, 2**62)


def state(timestep: int, robots: int, duplicates: tuple[int, ...] = ()) -> ArenaState:
    poses = np.zeros(robots, POSE)
    poses["tag"] = np.arange(robots)
    poses["x_m"] = timestep
    sightings = np.zeros(2 * robots, SIGHTING)
    sightings["y_m"] = timestep
    images = np.zeros(3 * robots, IMAGE_POSE)
    images["x_px"] = timestep
    return ArenaState(
        timestep=timestep,
        capture_ns=1000 + timestep,
        robots=poses,
        detected=robots,
        unnamed=timestep % 3,
        duplicates=duplicates,
        sightings=sightings,
        joined=duplicates[:3],
        cameras=tuple(f"Kamera {n} \u00fc" for n in range(robots)),
        images=images,
    )


@given(NUMBERS, st.integers(0, 20), st.lists(st.integers(0, 2**32 - 1), max_size=20), NUMBERS)
def test_state_comes_out_as_it_went_in(
    timestep: int, robots: int, duplicates: list[int], done_ns: int
) -> None:
    buffer = ArenaBuffer(20)
    written = state(timestep, robots, tuple(duplicates))
    buffer.write(written, done_ns // 2, done_ns)
    read = buffer.read()
    assert read is not None
    assert (read.ready_ns, read.done_ns, read.sequence) == (done_ns // 2, done_ns, 1)
    assert read.state.sightings.tobytes() == written.sightings.tobytes()
    assert read.state.robots.tobytes() == written.robots.tobytes()
    assert read.state.images.tobytes() == written.images.tobytes()
    for name in (
        "timestep",
        "capture_ns",
        "detected",
        "unnamed",
        "duplicates",
        "joined",
        "cameras",
    ):
        assert getattr(read.state, name) == getattr(written, name)


def test_empty_buffer_has_no_state_and_a_full_one_refuses_more() -> None:
    buffer = ArenaBuffer(2)
    assert buffer.read() is None
    with pytest.raises(WireError):
        buffer.write(state(1, 30), 0, 0)
    assert buffer.read() is None


def test_defect_05_reader_never_sees_a_torn_state_and_knows_what_it_missed() -> None:
    """Defect 5 of the original: the buffer locked its writer only, and nothing had a sequence."""
    buffer = ArenaBuffer(50)
    total = 3000

    def write() -> None:
        for timestep in range(1, total + 1):
            buffer.write(state(timestep, timestep % 50), timestep, timestep)

    writer = threading.Thread(target=write)
    writer.start()
    newest = 0
    while newest < total:
        read = buffer.read()
        if read is None:
            continue
        timestep = read.state.timestep
        assert read.sequence == timestep >= newest
        assert len(read.state.robots) == timestep % 50
        assert (read.state.robots["x_m"] == timestep).all()
        assert (read.state.sightings["y_m"] == timestep).all()
        newest = timestep
    writer.join()
