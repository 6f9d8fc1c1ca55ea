"""Recordings of several cameras, combined by timestep and read ahead."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import median
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Frame, Image
from vsense.base.errors import GrabberError, NoMorePictures
from vsense.vision.cameras._lateness import jump_in_words
from vsense.vision.cameras._recordings import CaptureTime
from vsense.vision.cameras.grabber import CameraEvent
from vsense.vision.cameras.picture import PictureError

READ_AHEAD = 2
"""Timesteps that are read ahead."""
READERS = 2

PICTURE_TIMEOUT_S = 60.0
"""Default time to wait for a picture that is being read."""


class CameraRecording(Protocol):
    """One camera's pictures in the order in which they were taken."""

    taken: Sequence[CaptureTime]

    def read(self, place: int) -> Image:
        """Reads the picture of a place in `taken`, (h, w) uint8; may raise PictureError."""

    def close(self) -> None:
        """Closes the files; can be called again."""


@dataclass(frozen=True, slots=True)
class RecordedTimestep:
    """One timestep of a recording.

    `places` are the places of the pictures in the recordings of the cameras that have one;
    `capture_ns` is their earliest capture time.
    """

    timestep: int
    places: Mapping[str, int]
    capture_ns: int


def moments(taken: Mapping[str, Sequence[CaptureTime]]) -> list[RecordedTimestep]:
    """Groups the pictures of several cameras into timesteps.

    Where every picture has a timestep, that is the group; otherwise pictures less than half a
    period after the first of a group belong to it.
    """
    everything = [t.timestep for times in taken.values() for t in times]
    by_timestep = all(timestep is not None for timestep in everything)
    return _by_number(taken) if by_timestep else _by_time(taken)


def _by_number(taken: Mapping[str, Sequence[CaptureTime]]) -> list[RecordedTimestep]:
    groups: dict[int, dict[str, int]] = {}
    for camera, times in taken.items():
        for place, moment in enumerate(times):
            groups.setdefault(moment.timestep or 0, {})[camera] = place
    return [
        RecordedTimestep(timestep, places, min(taken[c][p].capture_ns for c, p in places.items()))
        for timestep, places in sorted(groups.items())
    ]


def _by_time(taken: Mapping[str, Sequence[CaptureTime]]) -> list[RecordedTimestep]:
    gaps = [b.capture_ns - a.capture_ns for t in taken.values() for a, b in pairwise(t)]
    window_ns = median(gaps) / 2 if gaps else 0.0
    pictures = sorted(
        (t.capture_ns, c, p) for c, times in taken.items() for p, t in enumerate(times)
    )
    groups: list[RecordedTimestep] = []
    places: dict[str, int] = {}
    first_ns = 0
    for capture_ns, camera, place in pictures:
        if places and (camera in places or capture_ns - first_ns > window_ns):
            groups.append(RecordedTimestep(len(groups), places, first_ns))
            places = {}
        first_ns = first_ns if places else capture_ns
        places[camera] = place
    if places:
        groups.append(RecordedTimestep(len(groups), places, first_ns))
    return groups


STAMP_JUMP_NS = 1_000_000_000
"""Stamps so much, and three periods, later than what was taken later are another clock's."""
JUMP_PERIODS = 3
LONG_NS = 10_000_000_000
"""A pause in which the others go on, and after which none is there, is a jump, where timesteps do
not tell."""


def undo_jumps(
    taken: Mapping[str, Sequence[CaptureTime]],
) -> tuple[dict[str, Sequence[CaptureTime]], list[CameraEvent]]:
    """Takes the jumps of single cameras' clocks out of the times of their pictures.

    A jump would put a camera's pictures into timesteps of their own, or make the tracker forget
    the other cameras' robots. Where all cameras pause alike, time has passed.

    Returns:
        The times, and an event for each jump.
    """
    when = {c: np.array([t.capture_ns for t in times]) for c, times in taken.items() if times}
    steps = {c: [t.timestep for t in taken[c]] for c in when}
    numbered = all(step is not None for column in steps.values() for step in column)
    numbers = {c: np.array(column, dtype=np.int64) for c, column in steps.items() if numbered}
    events: list[CameraEvent] = []
    # The second time with what the first has mended: several may have jumped.
    for _ in range(2):
        before = len(events)
        for camera in when:
            jumps = _numbered_jumps(camera, when, numbers) if numbered else _jumps(camera, when)
            for place, jump_ns in jumps:
                when[camera][place:] -= jump_ns
                events.append(CameraEvent(camera, "clock", _text(taken[camera], place, jump_ns)))
        if len(events) == before:
            break
    mended = {event.camera for event in events}
    return {
        camera: [replace(t, capture_ns=int(ns)) for t, ns in zip(times, when[camera])]
        if camera in mended
        else times
        for camera, times in taken.items()
    }, events


def _text(times: Sequence[CaptureTime], place: int, jump_ns: int) -> str:
    last = times[place - 1].picture or f"picture {place - 1}"
    where = f"after {last}" if place else "from the first on"
    return f"its stamps jump {jump_in_words(jump_ns)} {where}: taken as if they did not"


def _jumps(camera: str, when: Mapping[str, NDArray[np.int64]]) -> list[tuple[int, int]]:
    """Returns the places from which on a camera's clock is ahead, and how much more [ns]."""
    own, steps = when[camera], np.diff(when[camera])

    def present(after_ns: int, within_ns: int) -> int:
        """How many other cameras have a picture in the time after a moment."""
        bounds = (after_ns, after_ns + within_ns)
        ranges = [np.searchsorted(t, bounds, "right") for c, t in when.items() if c != camera]
        return sum(bool(last > first) for first, last in ranges)

    return [
        (place + 1, int(steps[place] - np.median(steps)))
        for place in np.flatnonzero(steps > LONG_NS).tolist()
        if present(own[place], LONG_NS) > present(own[place + 1] - LONG_NS, 2 * LONG_NS)
    ]


def _numbered_jumps(
    camera: str, when: Mapping[str, NDArray[np.int64]], numbers: Mapping[str, NDArray[np.int64]]
) -> list[tuple[int, int]]:
    """Returns the same by the timesteps' numbers: what comes later has a later stamp."""
    own, peers = when[camera], [other for other in when if other != camera]
    ahead = np.full((len(peers), len(own)), np.nan)
    for row, other in zip(ahead, peers):
        # The other's picture of the same timestep, or of the next that it has.
        place = np.searchsorted(numbers[other], numbers[camera])
        shared = (place < len(when[other])) & (numbers[camera] >= numbers[other][0])
        row[shared] = own[shared] - when[other][place[shared]]
    judged = np.flatnonzero(~np.isnan(ahead).all(axis=0))
    usual_ns = float(np.median(np.diff(own))) if len(own) > 1 else 0.0
    limit_ns = max(STAMP_JUMP_NS, JUMP_PERIODS * usual_ns)
    median_ns = np.nanmedian(ahead[:, judged], axis=0) if peers else np.zeros(0)
    jumps, shift_ns = [], 0
    if (median_ns > limit_ns).any():
        for place, ahead_ns in zip(judged.tolist(), median_ns.tolist()):
            jump_ns = round(ahead_ns) - shift_ns
            # What came about bit by bit is no jump, and to undo it would turn time back.
            is_step = place == 0 or own[place] - own[place - 1] > jump_ns
            if jump_ns > limit_ns and is_step:
                jumps.append((place, jump_ns))
                shift_ns += jump_ns
    return jumps


class RecordedGrabber:
    """A recorded set of cameras, as fast as it is asked for.

    The next timesteps are read while the caller works on the last ones. Unreadable pictures are
    left out and reported in `events`; so are clocks that jumped, see `undo_jumps`. `missed` counts
    what `skip` has left out.
    """

    def __init__(
        self,
        recordings: Mapping[str, CameraRecording],
        sizes_px: Mapping[str, tuple[int, int]],
        clock: Callable[[], int],
        readers: int = READERS,
    ) -> None:
        """Groups the timesteps and begins to read.

        Mappings are by the camera's id, sizes (width, height); the host's monotonic `clock` [ns]
        says when a picture was in memory. Each of `readers` threads reads its own cameras in order.
        """
        self._recordings = dict(recordings)
        self._sizes_px = sizes_px
        self._clock = clock
        self._taken, self._events = undo_jumps({c: r.taken for c, r in recordings.items()})
        self._moments = moments(self._taken)
        self.timesteps: int | None = len(self._moments)
        self.missed = 0
        cameras = list(self._recordings)
        self._shares = [cameras[r::readers] for r in range(min(readers, len(cameras)))]
        self._readers = [ThreadPoolExecutor(1, "reading") for _ in self._shares]
        self._coming: deque[tuple[RecordedTimestep, list[Future[list[Frame]]]]] = deque()
        self._place = 0
        self._lock = threading.Lock()

    def next(self, timeout_s: float = PICTURE_TIMEOUT_S) -> Sequence[Frame]:
        """See `Grabber.next`; timesteps without any picture are left out."""
        while True:
            self._read_ahead()
            if not self._coming:
                raise NoMorePictures(f"the recording ends after {self.timesteps} timesteps")
            _, parts = self._coming[0]
            try:
                frames = [frame for part in parts for frame in part.result(timeout_s)]
            except FutureTimeout:
                raise GrabberError(f"no pictures from the recording in {timeout_s:g} s") from None
            self._coming.popleft()
            self._read_ahead()
            if frames:
                return frames

    def due_ns(self, after: int = 0) -> int | None:
        """Capture time [ns] of the next timestep or one up to `READ_AHEAD` later; None: none."""
        self._read_ahead()
        return self._coming[after][0].capture_ns if after < len(self._coming) else None

    def skip(self) -> None:
        """Leaves out the next timestep; pictures whose reading has not begun stay unread."""
        self._read_ahead()
        if self._coming:
            for part in self._coming.popleft()[1]:
                part.cancel()
            self.missed += 1

    def events(self) -> list[CameraEvent]:
        """See `Grabber.events`."""
        with self._lock:
            events, self._events = self._events, []
        return events

    def close(self) -> None:
        """Stops reading and closes the files; can be called again."""
        for reader in self._readers:
            reader.shutdown(cancel_futures=True)
        self._coming.clear()
        self._place = len(self._moments)
        for recording in self._recordings.values():
            recording.close()

    def _read_ahead(self) -> None:
        while self._place < len(self._moments) and len(self._coming) <= READ_AHEAD:
            moment = self._moments[self._place]
            self._place += 1
            parts = [
                reader.submit(self._read, moment, cameras)
                for reader, cameras in zip(self._readers, self._shares)
            ]
            self._coming.append((moment, parts))

    def _read(self, moment: RecordedTimestep, cameras: list[str]) -> list[Frame]:
        frames = []
        for camera in cameras:
            place = moment.places.get(camera)
            if place is None:
                continue
            recording = self._recordings[camera]
            try:
                image = recording.read(place)
            except PictureError as error:
                self._report(camera, "damaged", str(error))
                continue
            if image.shape[::-1] != tuple(self._sizes_px[camera]):
                self._report(camera, "size", wrong_size(image, self._sizes_px[camera]))
                continue
            capture_ns = self._taken[camera][place].capture_ns
            now_ns = self._clock()
            frames.append(Frame(camera, image, moment.timestep, capture_ns, now_ns, place))
        return frames

    def _report(self, camera: str, kind: str, text: str) -> None:
        with self._lock:
            self._events.append(CameraEvent(camera, kind, text))


def wrong_size(image: Image, size_px: tuple[int, int]) -> str:
    """Error text for a picture whose size is not that of its calibration."""
    height, width = image.shape
    return f"a picture of {width} x {height} px, its calibration is for {size_px[0]} x {size_px[1]}"
