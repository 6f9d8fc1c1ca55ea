"""Recordings of several cameras: put together by timestep, read ahead, at their pace."""

from __future__ import annotations

import csv
import threading
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.rigs.places import DATA
from vsense.base.errors import GrabberError, NoMorePictures
from vsense.vision.cameras._paced_grabber import PacedGrabber
from vsense.vision.cameras._recorded_grabber import RecordedGrabber, moments
from vsense.vision.cameras._recordings import CaptureTime
from vsense.vision.cameras.grabber import Grabber
from vsense.vision.cameras.picture import PictureError

SIZE = (4, 3)
MS = 1_000_000


class Pictures:
    """A recording in memory: picture k shows k; some places hold none."""

    def __init__(
        self, times_ms: list[int], damaged: set[int] = frozenset(), numbered: bool = False
    ):
        self.taken = [
            CaptureTime("", k if numbered else None, t * MS) for k, t in enumerate(times_ms)
        ]
        self.damaged = damaged
        self.shape = SIZE[::-1]
        self.reads: list[int] = []
        self.closed = False

    def read(self, place: int) -> np.ndarray:
        self.reads.append(place)
        if place in self.damaged:
            raise PictureError(f"picture {place} is damaged")
        return np.full(self.shape, place, np.uint8)

    def close(self) -> None:
        self.closed = True


class Clock:
    """A clock that a test winds."""

    def __init__(self) -> None:
        self.now_ns = 0

    def __call__(self) -> int:
        return self.now_ns


def grabber(clock: Clock | None = None, **recordings: Pictures) -> RecordedGrabber:
    return RecordedGrabber(recordings, dict.fromkeys(recordings, SIZE), clock or Clock())


def everything(source: Grabber) -> list[dict[str, int]]:
    """Which picture of which camera came in each timestep."""
    sets = []
    while True:
        try:
            sets.append({f.camera: int(f.image[0, 0]) for f in source.next(10.0)})
        except NoMorePictures:
            return sets


def test_pictures_come_together_by_their_times() -> None:
    source = grabber(a=Pictures([0, 100, 200, 300]), b=Pictures([40, 141, 338]))
    assert everything(source) == [{"a": 0, "b": 0}, {"a": 1, "b": 1}, {"a": 2}, {"a": 3, "b": 2}]
    source.close()


def test_numbered_pictures_come_together_by_their_numbers() -> None:
    early, late = Pictures([0, 100], numbered=True), Pictures([500, 600, 700], numbered=True)
    source = grabber(a=early, b=late)
    frames = source.next(10.0)
    assert [(f.camera, f.timestep, f.capture_ns) for f in frames] == [
        ("a", 0, 0), ("b", 0, 500 * MS),
    ]  # fmt: skip
    assert everything(source) == [{"a": 1, "b": 1}, {"b": 2}]
    source.close()


@given(
    st.lists(
        st.lists(st.integers(0, 2000), unique=True, max_size=12).map(sorted), min_size=1, max_size=4
    )
)
def test_every_picture_is_in_one_timestep_and_time_does_not_go_back(
    cameras: list[list[int]],
) -> None:
    taken = {str(n): [CaptureTime("", None, t) for t in times] for n, times in enumerate(cameras)}
    groups = moments(taken)
    places = [(camera, place) for group in groups for camera, place in group.places.items()]
    assert sorted(places) == [(c, p) for c, times in taken.items() for p in range(len(times))]
    assert len(set(places)) == len(places)
    for camera in taken:
        mine = [group.places[camera] for group in groups if camera in group.places]
        assert mine == sorted(mine)
    assert [group.timestep for group in groups] == list(range(len(groups)))
    assert all(a.capture_ns <= b.capture_ns for a, b in pairwise(groups))


def test_four_real_cameras_with_jitter_and_gaps_come_together_as_their_makers_say() -> None:
    data = DATA / "four-cameras" / "xy.csv"
    with data.open() as file:
        seen = {
            (row["cam_id"], float(row["frame_time"]), int(row["sync_index"]))
            for row in csv.DictReader(file)
        }
    cameras: dict[str, list[tuple[float, int]]] = {}
    for camera, time_s, group in sorted(seen):
        cameras.setdefault(camera, []).append((time_s, group))
    taken = {
        c: [CaptureTime("", None, round(1e9 * t)) for t, _ in rows] for c, rows in cameras.items()
    }
    ours = [{c: cameras[c][p][1] for c, p in moment.places.items()} for moment in moments(taken)]
    assert len(cameras) == 4 and len(ours) > 40
    assert all(len(set(groups.values())) == 1 for groups in ours)
    assert len(ours) == len({group for _, _, group in seen})


def test_what_is_damaged_or_has_another_size_is_left_out_and_told() -> None:
    small = Pictures([0, 100])
    small.shape = (2, 2)
    source = grabber(a=Pictures([0, 100, 200], {1}), b=small)
    assert everything(source) == [{"a": 0}, {"a": 2}]
    told = sorted(str(event) for event in source.events())
    wrong = "camera b: a picture of 2 x 2 px, its calibration is for 4 x 3"
    assert told == ["camera a: picture 1 is damaged", wrong, wrong]
    assert source.events() == []
    source.close()


def test_a_recording_of_which_nothing_can_be_read_ends() -> None:
    source = grabber(a=Pictures([0, 100, 200], {0, 1, 2}))
    with pytest.raises(NoMorePictures, match="3 timesteps"):
        source.next(10.0)
    source.close()


def test_the_next_timesteps_are_read_while_this_one_is_processed() -> None:
    recording = Pictures([0, 100, 200, 300, 400])
    arrived = threading.Event()
    read = recording.read

    def notice(place: int) -> np.ndarray:
        if place == 2:
            arrived.set()
        return read(place)

    recording.read = notice  # type: ignore[method-assign]
    source = grabber(a=recording)
    source.next(10.0)
    assert arrived.wait(10.0)
    source.close()
    assert recording.closed and 4 not in recording.reads


def test_a_picture_that_takes_too_long_is_an_error_and_comes_later() -> None:
    recording = Pictures([0])
    gate = threading.Event()
    read = recording.read
    recording.read = lambda place: (gate.wait(), read(place))[1]  # type: ignore[method-assign]
    source = grabber(a=recording)
    with pytest.raises(GrabberError, match=r"0\.01 s"):
        source.next(0.01)
    gate.set()
    assert len(source.next(10.0)) == 1
    source.close()
    source.close()


def test_at_its_pace_late_timesteps_are_left_out() -> None:
    clock = Clock()
    source = PacedGrabber(grabber(clock, a=Pictures([1000, 1100, 1200, 1300, 1400])), clock)
    assert [f.timestep for f in source.next(1.0)] == [0]
    clock.now_ns = 310 * MS
    assert [f.timestep for f in source.next(1.0)] == [3]
    assert source.missed == 2
    clock.now_ns = 400 * MS
    assert [f.timestep for f in source.next(1.0)] == [4]
    with pytest.raises(NoMorePictures):
        source.next(1.0)
    source.close()


def test_at_its_pace_a_timestep_that_is_not_due_waits() -> None:
    clock = Clock()
    source = PacedGrabber(grabber(clock, a=Pictures([0, 5000])), clock)
    source.next(1.0)
    with pytest.raises(GrabberError, match=r"0\.001 s"):
        source.next(0.001)
    source.close()
