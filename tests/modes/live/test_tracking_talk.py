"""What a person is told while robots are tracked."""

from __future__ import annotations

import io

import numpy as np

from vsense.base.arena import POSE, ArenaState
from vsense.base.terminal import Console
from vsense.modes.live._talk import Talk
from vsense.vision.cameras.grabber import CameraEvent, Troubles
from vsense.vision.tracking.arena_tracker import TrackerCounters


def state(timestep: int, *joined: int) -> ArenaState:
    return ArenaState(timestep, timestep, np.zeros(0, dtype=POSE), 0, joined=joined)


def talk(timesteps: int | None = None) -> tuple[Talk, io.StringIO]:
    heard, ticks = io.StringIO(), iter(range(0, 10**12, 10**8))
    return Talk(Console(heard), lambda: next(ticks), timesteps), heard


def test_who_joins_is_told_once() -> None:
    talking, heard = talk(4)
    for timestep in range(4):
        talking.timestep(
            state(timestep, *((77,) if timestep else ()), *((9,) if timestep > 2 else ())), 2
        )
    said = [line for line in heard.getvalue().splitlines() if "joined" in line]
    assert said == [f"vsense: robot {tag} was not on the roster and has joined" for tag in (77, 9)]


def test_the_summary_says_all_that_was_dropped_and_nothing_that_was_not() -> None:
    talking, heard = talk()
    talking.timestep(state(1), 2)
    troubles, froze = Troubles(), CameraEvent("cam 7", "frozen", "froze")
    troubles.lines([froze] * 4)
    talking.summary(5, TrackerCounters(old_frames=3, overflows=2, out_of_reach=4), troubles)
    said = heard.getvalue()
    assert "1 timesteps, 2 pictures" in said
    assert "5 timesteps were left out to keep pace" in said
    assert "3 pictures older than the newest were dropped" in said
    assert "2 pictures held more than the detector's tables" in said
    assert "4 sightings were out of their robot's reach" in said
    assert "camera cam 7: 4 times frozen" in said
    assert "delivered already" not in said and "two places" not in said
