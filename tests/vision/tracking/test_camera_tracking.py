"""The camera step: a state for every timestep, and cameras that are checked after it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pytest

from vsense.base.arena import DETECTION, Frame
from vsense.base.errors import GrabberError, NoMorePictures
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.grabber import REPEATS, CameraEvent, Troubles
from vsense.vision.tracking._workers import Picture
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.vision.tracking.marker_detector import Detected

CAMERA = Camera.looking_down("top", 0.0, 0.0, 2.4, 400.0, (320, 240))
CROWDED = "camera top: shows more dark things than the detector can hold: markers may be missed"

Make = Callable[..., CameraTracking]


class Full:
    """A detector whose tables are always full."""

    def detect_all(self, pictures: Sequence[Picture]) -> list[Detected]:
        """Finds nothing."""
        return [Detected(np.zeros(0, dtype=DETECTION), True) for _ in pictures]


class Script:
    """A grabber whose timesteps come as it is told, with a silence for each -1."""

    def __init__(self, timesteps: Sequence[int], period_ns: int) -> None:
        self.timesteps = len(timesteps)
        self.missed = 0
        self._left = list(timesteps)
        self._last = -1
        self._period_ns = period_ns
        self._rng = np.random.default_rng(2)
        self._events: list[CameraEvent] = []

    def next(self, timeout_s: float) -> list[Frame]:
        """Gives the next timestep, and counts those before it."""
        if not self._left:
            raise NoMorePictures("all were given")
        timestep = self._left.pop(0)
        if timestep < 0:
            self._events.append(CameraEvent("top", "gone", "is gone"))
            raise GrabberError("nothing")
        self.missed += max(timestep - self._last - 1, 0)
        self._last = timestep
        image = self._rng.integers(90, 130, (240, 320)).astype(np.uint8)
        return [Frame("top", image, timestep, timestep * self._period_ns, 0)]

    def events(self) -> list[CameraEvent]:
        """Gives what happened."""
        events, self._events = self._events, []
        return events

    def close(self) -> None:
        """Has no more pictures."""
        self._left.clear()


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def make(told: list[str]) -> Iterator[Make]:
    """Makes a tracking on timesteps that come as a test says."""
    made: list[CameraTracking] = []

    def on(
        timesteps: Sequence[int], check_all: bool = False, period_ns: int = 100_000_000
    ) -> CameraTracking:
        grabber = Script(timesteps, period_ns)
        tracker = ArenaTracker([CAMERA], Full(), {1: 0.06})
        made.append(CameraTracking(grabber, tracker, told.append, None, check_all))
        return made[-1]

    yield on
    for tracking in made:
        tracking.close()
        tracking.close()


def test_cameras_are_checked_only_when_somebody_has_the_time(make: Make, told: list[str]) -> None:
    tracking = make(range(8))
    tracking.check_cameras()
    for _ in range(5):
        tracking.next(1.0)
    assert told == [] and tracking.tracker.overflowed == ("top",)
    tracking.check_cameras()
    for _ in range(2):
        tracking.next(1.0)
        assert told == []
        tracking.check_cameras()
        tracking.check_cameras()
    assert told == [CROWDED], "three were checked, each once"
    assert tracking.troubles.counts == {("top", "crowded"): 1}


def test_pictures_of_live_cameras_that_come_fast_are_not_all_checked(
    make: Make, told: list[str]
) -> None:
    tracking = make(range(17), period_ns=10_000_000)
    for timestep in range(17):
        assert told == [], "two checks in 160 ms are too few to tell"
        tracking.next(1.0)
        tracking.check_cameras()
        assert bool(told) == (timestep == 16)


@pytest.mark.parametrize("somebody_checks", [False, True])
def test_of_recordings_every_timestep_is_checked_after_it_was_handed_on(
    make: Make, told: list[str], somebody_checks: bool
) -> None:
    tracking = make(range(4), check_all=True, period_ns=10_000_000)
    for _ in range(3):
        assert told == []
        tracking.next(1.0)
        assert told == [], "the third state does not wait for what it shows"
        if somebody_checks:
            tracking.check_cameras()
    tracking.next(1.0)
    assert told == [CROWDED]


def test_the_last_timestep_of_a_recording_is_checked_at_its_end(
    make: Make, told: list[str]
) -> None:
    tracking = make(range(3), check_all=True)
    with pytest.raises(NoMorePictures):
        while True:
            assert told == []
            tracking.next(1.0)
    assert told == [CROWDED]


def test_silence_is_told_at_once(make: Make, told: list[str]) -> None:
    tracking = make([0, -1, 1])
    tracking.next(1.0)
    with pytest.raises(GrabberError, match="nothing"):
        tracking.next(1.0)
    assert told == ["camera top: is gone"]
    assert tracking.next(1.0)[0].timestep == 1


def test_what_is_left_out_counts_from_the_start_of_the_run(make: Make) -> None:
    tracking = make([0, 3, 4, 6, 5, 10])
    seen = []
    for turn in range(6):
        if turn == 2:
            tracking.start()
        state, frames = tracking.next(1.0)
        assert len(frames) == 1
        seen.append(state.timestep)
    tracking.stop()
    assert seen == [0, 3, 4, 6, 6, 10]
    assert tracking.figures() == {
        "pictures": 6, "left_out": 5, "old_pictures": 1, "overflows": 5, "camera_events": 0,
    }  # fmt: skip


def test_who_records_sees_the_pictures_before_the_tracker(make: Make) -> None:
    tracking = make(range(3))
    before: list[tuple[int, int]] = []
    tracking.record = lambda frames: before.append(
        (frames[0].timestep, tracking.tracker.state.timestep)
    )
    for _ in range(3):
        tracking.next(1.0)
    assert before == [(0, -1), (1, 0), (2, 1)]


def test_the_same_trouble_is_told_a_few_times_and_then_counted() -> None:
    troubles = Troubles()
    event = CameraEvent("c7", "gone", "does not answer")
    lines = [line for _ in range(REPEATS + 2) for line in troubles.lines([event])]
    assert len(lines) == REPEATS and lines[0] == "camera c7: does not answer"
    assert lines[-1].endswith("(more of this is only counted)")
    assert troubles.lines([CameraEvent("c8", "gone", "does not answer")]) != []
    assert troubles.summary() == [f"camera c7: {REPEATS + 2} times gone"]


def test_every_setting_that_a_camera_refuses_is_told() -> None:
    troubles = Troubles()
    settings = [CameraEvent("c7", "control", f"has no Feature{n}") for n in range(REPEATS + 2)]
    assert troubles.lines(settings) == [str(event) for event in settings]
    assert troubles.summary() == []


class TwoRates:
    """A grabber of two cameras at 20 and 5 Hz, each picture a timestep of its own."""

    timesteps = None
    missed = 0

    def __init__(self) -> None:
        fast = [("top", 50_000_000 * n) for n in range(40)]
        slow = [("side", 200_000_000 * n + 10_000_000) for n in range(10)]
        self._left = sorted(fast + slow, key=lambda picture: picture[1])
        self._timestep = -1
        self._rng = np.random.default_rng(3)

    def next(self, timeout_s: float) -> list[Frame]:
        """Gives the next picture."""
        if not self._left:
            raise NoMorePictures("all were given")
        camera, capture_ns = self._left.pop(0)
        self._timestep += 1
        image = self._rng.integers(90, 130, (240, 320)).astype(np.uint8)
        return [Frame(camera, image, self._timestep, capture_ns, 0)]

    def events(self) -> list[CameraEvent]:
        """Nothing happens."""
        return []

    def close(self) -> None:
        """Has no more pictures."""


@pytest.mark.parametrize("every", [1, 3])
def test_a_slow_camera_beside_a_fast_one_is_checked(told: list[str], every: int) -> None:
    side = Camera.looking_down("side", 1.0, 0.0, 2.4, 400.0, (320, 240))
    tracker = ArenaTracker([CAMERA, side], Full(), {1: 0.06})
    tracking = CameraTracking(TwoRates(), tracker, told.append)
    for timestep in range(50):
        tracking.next(1.0)
        if timestep % every == 0:
            tracking.check_cameras()
    tracking.close()
    assert {("top", "crowded"), ("side", "crowded")} <= tracking.troubles.counts.keys()


class OldPicture(TwoRates):
    """A grabber whose second camera gives the same old picture beside each new one of the first."""

    def next(self, timeout_s: float) -> list[Frame]:
        """Gives both."""
        self._timestep += 1
        image = self._rng.integers(90, 130, (240, 320)).astype(np.uint8)
        new = Frame("top", image, self._timestep, 100_000_000 * self._timestep, 0)
        return [new, Frame("side", image, 0, 0, 0)]


def test_a_picture_that_the_tracker_leaves_out_ends_nothing(told: list[str]) -> None:
    side = Camera.looking_down("side", 1.0, 0.0, 2.4, 400.0, (320, 240))
    tracker = ArenaTracker([CAMERA, side], Full(), {1: 0.06})
    tracking = CameraTracking(OldPicture(), tracker, told.append, check_all=True)
    for _ in range(5):
        tracking.next(1.0)
        tracking.check_cameras()
    tracking.close()
    assert tracking.figures()["old_pictures"] == 4
    assert tracking.troubles.counts["top", "crowded"] == 1


class HourAhead(TwoRates):
    """Three cameras, of which the clock of one is an hour ahead for a while."""

    def next(self, timeout_s: float) -> list[Frame]:
        """Gives a timestep."""
        self._timestep += 1
        image = self._rng.integers(90, 130, (240, 320)).astype(np.uint8)
        step, now_ns = self._timestep, 100_000_000 * self._timestep
        off_ns = {"side": 3_600_000_000_000 if 5 <= step < 15 else 0}
        names = ("top", "side", "back")
        return [Frame(name, image, step, now_ns + off_ns.get(name, 0), 0) for name in names]


def test_a_camera_whose_clock_is_an_hour_ahead_is_told_and_so_is_the_end(told: list[str]) -> None:
    more = [
        Camera.looking_down(name, 1.0, 0.0, 2.4, 400.0, (320, 240)) for name in ("side", "back")
    ]
    tracking = CameraTracking(
        HourAhead(), ArenaTracker([CAMERA, *more], Full(), {1: 0.06}), told.append, check_all=True
    )
    for step in range(20):
        state, _ = tracking.next(1.0)
        assert state.capture_ns == 100_000_000 * step
        tracking.check_cameras()
        present = ("side", "untimely") in tracking.troubles.present
        assert present == (7 <= step < 17)
    tracking.close()
    assert [line for line in told if "clock" in line or "time" in line] == [
        "camera side: its clock is 3600.00 s ahead of the other cameras':"
        " its pictures are left out",
        "camera side: has the other cameras' time again",
    ]
    assert tracking.figures()["old_pictures"] == 10
