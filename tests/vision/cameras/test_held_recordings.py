"""A recording in the place of cameras: still at first, then at its own pace."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import pytest

from tests.system.recording import TAGS, make_recording
from vsense.base.arena import ArenaState
from vsense.base.errors import GrabberError, NoMorePictures
from vsense.config import tracking_session
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.vision.tracking.opening import open_tracking

MS = 1_000_000
PERIOD_NS = 50 * MS
PICTURES = 12
PATIENCE_S = 20.0


class Tick:
    """A clock that gets on by 10 ms whenever it is read."""

    def __init__(self) -> None:
        self.now_ns = 5_000 * 1_000 * MS

    def __call__(self) -> int:
        self.now_ns += 10 * MS
        return self.now_ns


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    make_recording(folder, PICTURES)
    return folder


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def source(recording: Path, told: list[str]) -> Iterator[CameraTracking]:
    session = tracking_session.load(recording / "resources.xml", recording / "experiment.xml")
    made = open_tracking(session, Tick(), told.append, PERIOD_NS / 1e9)
    yield made
    made.close()


def place(state: ArenaState) -> float:
    """Where the robot is that drives along x."""
    return float(state.robots["x_m"][state.robots["tag"] == 31][0])


def test_it_stands_still_until_the_run_and_then_plays_from_its_beginning(
    source: CameraTracking, told: list[str]
) -> None:
    before = [source.next(PATIENCE_S)[0] for _ in range(4)]
    assert all(sorted(state.robots["tag"]) == sorted(TAGS) for state in before)
    assert all(state.robots["seen"].all() for state in before)
    assert [place(state) for state in before] == pytest.approx([0.0] * 4, abs=0.002)
    captures = [state.capture_ns for state in before]
    assert captures == sorted(set(captures)), "every look is a new one"
    source.start()
    played = []
    while len(played) < PICTURES - 1:
        try:
            played.append(source.next(PATIENCE_S)[0])
        except NoMorePictures:
            break
    captures += [state.capture_ns for state in played]
    assert captures == sorted(set(captures)), "times never go back"
    x_m = [place(state) for state in played]
    assert x_m == sorted(x_m) and x_m[-1] == pytest.approx(0.01 * (PICTURES - 1), abs=0.003)
    with pytest.raises(NoMorePictures, match="12 timesteps"):
        source.next(PATIENCE_S)
    figures = source.figures()
    assert figures["pictures"] + figures["left_out"] == PICTURES - 1
    assert not any("froze" in line for line in told), "standing still is no trouble"


def test_played_pictures_keep_their_distances(source: CameraTracking) -> None:
    source.next(PATIENCE_S)
    source.start()
    first = source.next(PATIENCE_S)[0].capture_ns
    second = source.next(PATIENCE_S)[0].capture_ns
    assert (second - first) % PERIOD_NS == 0 and second > first


def test_closing_ends_it(source: CameraTracking) -> None:
    source.next(PATIENCE_S)
    source.close()
    with pytest.raises(GrabberError):
        source.next(PATIENCE_S)


def test_in_a_pause_it_stands_still_and_then_leaves_nothing_out(source: CameraTracking) -> None:
    source.next(PATIENCE_S)
    source.pause()  # before it plays there is nothing to hold
    source.start()
    states = []
    while len(states) < PICTURES - 1:
        if len(states) == 5:
            source.pause()
            stood = [source.next(PATIENCE_S)[0] for _ in range(3)]
            assert [place(state) for state in stood] == pytest.approx(
                [place(states[-1])] * 3, abs=0.002
            )
            source.go_on()
        with suppress(GrabberError):
            states.append(source.next(PATIENCE_S)[0])
    steps = [place(after) - place(before) for before, after in pairwise(states)]
    assert steps == pytest.approx([0.01] * len(steps), abs=0.003), "no picture was left out"
    captures = [state.capture_ns for state in states]
    assert captures == sorted(set(captures))
    with pytest.raises(NoMorePictures):
        source.next(PATIENCE_S)
