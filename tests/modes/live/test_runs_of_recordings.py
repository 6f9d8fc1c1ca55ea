"""The runs of recordings, which are opened anew for each, and what is said of all at the end."""

from __future__ import annotations

import io
import threading
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tests.system.recording import make_recording
from vsense.base.arena import POSE, ArenaState, Frame
from vsense.base.errors import NoMorePictures, VsenseError
from vsense.base.interruption import Interruption
from vsense.base.terminal import Console
from vsense.config import tracking_session
from vsense.modes.live._talk import Talk
from vsense.modes.live.track import Making, TrackingRun, TrackOptions
from vsense.monitor.ui.room import RoomOptions
from vsense.run.control import State
from vsense.run.orders import Order, OrderKind
from vsense.vision.cameras.grabber import Troubles
from vsense.vision.tracking.arena_tracker import TrackerCounters


class Player:
    """Stands in for an opened recording of two timesteps, which leaves out one more."""

    def __init__(self, theatre: Theatre) -> None:
        self.grabber = SimpleNamespace(missed=0)
        counters = TrackerCounters()
        self.tracker = SimpleNamespace(counters=counters, markers={}, cameras=(), heights_m={})
        self._theatre, self._played = theatre, 0

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        if self._theatre.waits():
            return ArenaState(0, 0, np.zeros(0, POSE), 0), ()
        if self._theatre.fails:
            raise VsenseError("the tracker has failed")
        if self._played == 2:
            raise NoMorePictures("the end")
        self._played += 1
        self.grabber.missed += self._played == 2
        self.tracker.counters.overflows += 1
        self.tracker.markers = {"top": self._theatre.opened}
        return ArenaState(self._played, self._played, np.zeros(0, POSE), 0), ()

    def figures(self) -> dict[str, int]:
        return {}

    def start(self) -> None: ...

    def stop(self) -> None: ...

    def check_cameras(self) -> None: ...

    def close(self) -> None: ...


class Theatre:
    """Plays a recording in `runs` runs, each begun by an order, and is interrupted thereafter."""

    def __init__(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch, runs: int = 2, fails: bool = False
    ) -> None:
        make_recording(folder, 1)
        self.picture = folder / "last.png"
        options = TrackOptions(
            str(folder / "resources.xml"),
            None,
            json=True,
            snapshot=self.picture,
            room=RoomOptions(hold=True),
        )
        self.said, self.fails = io.StringIO(), fails
        console = Console(self.said)
        session = tracking_session.load_whole(options.resources)
        made = Making(options, session, console, Talk(console, lambda: 0, None), Troubles())
        self.opened = 0
        monkeypatch.setattr(Making, "tracking", lambda made: self.open())
        self._left, self._interrupted = runs, threading.Event()
        self.run = TrackingRun(made, self.open(), cast(Interruption, self._interrupted))

    def open(self) -> Any:
        self.opened += 1
        return Player(self)

    def waits(self) -> bool:
        """Whether no run is on; begins the next one, or says that it is enough."""
        runs = self.run._runs
        if runs.running:
            return False
        if runs.control.state in (State.READY, State.ENDED):
            if self._left:
                self._left -= 1
                runs.control.give(Order(OrderKind.START, "me"))
            else:
                self._interrupted.set()
        return True


def test_the_summary_is_that_of_all_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And not of the recording that was opened for a run that never came; nor is the picture."""
    drawn: list[object] = []

    def draw(state: ArenaState, frames: object, cameras: object, found: object, m: object) -> Any:
        drawn.append(found)
        return np.zeros((4, 4, 3), np.uint8)

    monkeypatch.setattr("vsense.monitor.pictures.snapshot.draw", draw)
    theatre = Theatre(tmp_path, monkeypatch)
    theatre.run.run()
    assert drawn == [{"top": 2}] and theatre.picture.exists()
    said = theatre.said.getvalue()
    assert "vsense: 4 timesteps" in said and theatre.opened == 3
    assert "vsense: 2 timesteps were left out to keep pace" in said
    assert "vsense: 4 pictures held more than the detector's tables" in said


def test_a_tracker_that_fails_opens_nothing_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    theatre = Theatre(tmp_path, monkeypatch, fails=True)
    with pytest.raises(VsenseError, match="the tracker has failed"):
        theatre.run.run()
    assert theatre.opened == 1
