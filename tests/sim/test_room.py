"""The page's end of a simulation's socket, where the simulation fails or does not listen."""

from __future__ import annotations

import os
import pickle
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from vsense.config.experiment import load
from vsense.run.control import State
from vsense.run.orders import Order, OrderKind
from vsense.sim.room import SimRoom
from vsense.terminal import Console
from vsense.ui.access import WebAddress
from vsense.ui.room import page_access


@pytest.fixture
def room() -> Iterator[SimRoom]:
    access = page_access(WebAddress("127.0.0.1", 0))
    with SimRoom(access, load("foraging"), {"seed": 7}, Console()) as opened:
        yield opened


def give(room: SimRoom, kind: OrderKind) -> str:
    return room.control.give(Order(kind, "viewer 1"))


def heard(room: SimRoom) -> list[tuple[int, str, Any]]:
    """All that waits at the simulation's end."""
    said = []
    # No `Connection`, which would wait for what does not come.
    data = os.read(room.descriptor, 1 << 20)
    while data:
        (size,) = struct.unpack_from("!i", data)
        said.append(pickle.loads(data[4 : 4 + size]))
        data = data[4 + size :]
    return said


def test_what_a_failed_run_did_not_read_is_not_for_the_next(room: SimRoom, tmp_path: Path) -> None:
    room.begin_run(tmp_path)
    give(room, OrderKind.PAUSE)
    # It ended in the middle of an order, too.
    os.read(room.descriptor, 3)
    room.control.end()
    give(room, OrderKind.RESET)
    room.control.next_run(8)
    room.begin_run(tmp_path)
    assert heard(room) == [(2, "begin", (1.0, False, False))]
    assert room.control.state is State.PAUSED
