"""The page's end of a simulation's socket, where the simulation fails or does not listen."""

from __future__ import annotations

import os
import pickle
import struct
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from vsense.base.terminal import Console
from vsense.config.experiment import load
from vsense.modes.sim._room import SimRoom, WatchedRuns
from vsense.monitor.ui.access import WebAddress
from vsense.monitor.ui.room import ControlRoom, RoomOptions
from vsense.run.changes import MOST_WAITING
from vsense.run.changing import Change, ChangeKind
from vsense.run.control import State
from vsense.run.orders import Order, OrderError, OrderKind


@pytest.fixture
def room() -> Iterator[SimRoom]:
    shown = RoomOptions(WebAddress("127.0.0.1", 0))
    with (
        ControlRoom(shown, Console()) as control_room,
        SimRoom(control_room, load("foraging"), 7) as opened,
    ):
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


def test_a_simulation_that_does_not_listen_blocks_nobody(room: SimRoom, tmp_path: Path) -> None:
    room.begin_run(tmp_path)
    change = Change(kind=ChangeKind.MOVE, name="nest" * 50, controller="x" * 200, setting="y" * 200)
    with pytest.raises(OrderError, match="does not listen: try again"):
        for _ in range(MOST_WAITING):
            give(room, OrderKind.SPEED)
            room._ask(change, "viewer 1", lambda text, ok: None)
    with pytest.raises(OrderError, match="does not listen"):
        for _ in range(1000):
            give(room, OrderKind.SPEED)
    for kind in (OrderKind.PAUSE, OrderKind.STEP, OrderKind.RESET):
        with pytest.raises(OrderError, match="does not listen"):
            give(room, kind)
    assert room.control.state is State.RUNNING and not room.control.next_asked
    interrupted = threading.Event()
    interrupted.set()
    with WatchedRuns(room, interrupted) as runs:
        assert not runs.is_set(), "there is patience, and no trouble"
        assert "stop" not in {name for _, name, _ in heard(room)}
        assert not runs.is_set() and heard(room) == [(1, "stop", 0)]
        assert not runs.is_set() and give(room, OrderKind.PAUSE), "it is told once"
    assert heard(room) == [(1, "play", 0)]


def test_a_run_that_is_over_answers_what_was_asked_of_it(room: SimRoom, tmp_path: Path) -> None:
    room.begin_run(tmp_path)
    answers: list[tuple[str, bool]] = []
    change = Change(kind=ChangeKind.REMOVE, name="visitor 1")
    room._ask(change, "viewer 1", lambda *said: answers.append(said))
    assert answers == []
    room.end_run()
    assert answers == [("the run ended before it", False)]
    with pytest.raises(OrderError, match="nothing can be changed: run 1 is ended"):
        room._ask(change, "viewer 1", lambda *said: answers.append(said))


def test_what_a_failed_run_did_not_read_is_not_for_the_next(room: SimRoom, tmp_path: Path) -> None:
    room.begin_run(tmp_path)
    give(room, OrderKind.PAUSE)
    # It ended in the middle of an order, too.
    os.read(room.descriptor, 3)
    room.end_run()
    give(room, OrderKind.RESET)
    room.next_run(8)
    room.begin_run(tmp_path)
    assert heard(room) == [(2, "begin", (1.0, False, False))]
    assert room.control.state is State.PAUSED
