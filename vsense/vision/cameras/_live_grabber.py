"""Live cameras together: their common trigger, and the newest picture of each per timestep.

A camera that disappears is reported and reopened; the others go on without it.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Protocol

from vsense.base.arena import Frame
from vsense.base.errors import GrabberError
from vsense.vision.cameras._live_camera import LiveCamera
from vsense.vision.cameras.grabber import CameraEvent
from vsense.vision.cameras.source import Source


class Triggered(Protocol):
    """A camera that takes a picture when it is triggered."""

    def trigger(self) -> None:
        """Triggers a picture; from any thread; does nothing while the camera is closed.

        Raises:
            GrabberError: It does not answer, or refuses.
        """


class SoftwareTrigger:
    """Triggers a set of cameras at a fixed rate, until it is closed.

    Each camera has a thread, so that none waits for another's answer. One that has not answered
    yet is left out; its silence is noticed where its pictures are awaited.
    """

    def __init__(
        self, cameras: Mapping[str, Triggered], rate_hz: float, clock: Callable[[], int]
    ) -> None:
        """Begins at once; `clock` is the host's monotonic clock [ns]."""
        self._cameras = dict(cameras)
        self._period_ns = round(1e9 / rate_hz)
        self._clock = clock
        self._ended = threading.Event()
        self._tellers = ThreadPoolExecutor(max(1, len(cameras)), "trigger")
        self._asked: dict[str, Future[None]] = {}
        self._thread = threading.Thread(target=self._run, name="trigger", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the trigger; can be called again."""
        self._ended.set()
        self._thread.join()
        self._tellers.shutdown(wait=False, cancel_futures=True)

    def _run(self) -> None:
        next_ns = self._clock()
        while not self._ended.is_set():
            for id, camera in self._cameras.items():
                asked = self._asked.get(id)
                if asked is None or asked.done():
                    self._asked[id] = self._tellers.submit(_trigger, camera)
            now_ns = self._clock()
            # Triggers missed during a pause are not made up for.
            next_ns = max(next_ns + self._period_ns, now_ns)
            self._ended.wait((next_ns - now_ns) / 1e9)


def _trigger(camera: Triggered) -> None:
    try:
        camera.trigger()
    except GrabberError:
        # The camera's own thread notices its silence and reports the reason.
        return


REOPEN_INTERVAL_S = 0.5
LATE_CAMERA_TIMEOUT_S = 0.05
MOST_UNREAD_EVENTS = 256
"""Only the newest events are kept while they are not read."""
CAMERA_JOIN_S = 1.5
"""Time that `close` waits for the cameras to answer."""


class LiveGrabber:
    """A set of cameras that run freely, or are triggered together.

    A timestep is complete when every camera that gives pictures has a new one, or after
    `patience_s`. The capture time is the camera's own, mapped to the host's clock, or else the
    arrival.
    """

    timesteps: int | None = None
    missed = 0

    def __init__(
        self,
        sources: Mapping[str, Source],
        sizes_px: Mapping[str, tuple[int, int]],
        clock: Callable[[], int],
        rates_hz: Mapping[str, float | None] | None = None,
        together_s: float | None = None,
        trigger: SoftwareTrigger | None = None,
        patience_s: float = LATE_CAMERA_TIMEOUT_S,
        retry_s: float = REOPEN_INTERVAL_S,
        in_order: bool = False,
    ) -> None:
        """Starts one thread per camera, which opens it and takes pictures.

        Mappings are by the camera's id, sizes (width, height), `clock` monotonic, the host's [ns].

        Args:
            together_s: Pictures taken further apart are not of one timestep; None: they may be.
            patience_s: How long a timestep waits for missing cameras after the first picture.
            retry_s: Time between attempts to open a camera.
            in_order: A picture of a timestep that is done is left out, and told.
        """
        self._clock = clock
        self._patience_s = patience_s
        self._together_ns = None if together_s is None else round(1e9 * together_s)
        self._trigger = trigger
        self._timestep, self._done_ns, self._in_order = 0, 0, in_order
        self._news = threading.Condition()
        self._ended = threading.Event()
        self._events: deque[CameraEvent] = deque(maxlen=MOST_UNREAD_EVENTS)
        rates, self._retry_s = rates_hz or {}, retry_s
        self._cameras = {
            c: self._camera(c, s, sizes_px[c], rates.get(c)) for c, s in sources.items()
        }
        runs = [camera.run for camera in self._cameras.values()]
        self._threads = [threading.Thread(target=run, daemon=True) for run in runs]
        for thread in self._threads:
            thread.start()

    def _camera(
        self, id: str, source: Source, size_px: tuple[int, int], rate_hz: float | None
    ) -> LiveCamera:
        notify = partial(self._notify, id)
        return LiveCamera(source, size_px, rate_hz, self._news, notify, self._clock, self._retry_s)

    def next(self, timeout_s: float) -> Sequence[Frame]:
        """See `Grabber.next`."""
        with self._news:
            is_fresh = (
                self._news.wait_for(self._any_in_time, timeout_s) and not self._ended.is_set()
            )
            if is_fresh:
                self._news.wait_for(self._all_fresh, self._patience_s)
            for camera in self._cameras.values():
                camera.watch(self._clock())
            if not is_fresh:
                raise GrabberError(f"no camera gave a picture in {timeout_s:g} s")
            frames = self._collect()
            self._timestep += 1
        return frames

    def events(self) -> list[CameraEvent]:
        """See `Grabber.events`."""
        with self._news:
            events = list(self._events)
            self._events.clear()
        return events

    def close(self) -> None:
        """Ends the trigger and the threads; those that wait for a camera end when it answers."""
        self._ended.set()
        if self._trigger is not None:
            self._trigger.close()
        for camera in self._cameras.values():
            camera.end()
        with self._news:
            self._news.notify_all()
        deadline_ns = self._clock() + round(1e9 * CAMERA_JOIN_S)
        for thread in self._threads:
            thread.join(max(deadline_ns - self._clock(), 0) / 1e9)

    def _any_fresh(self) -> bool:
        return self._ended.is_set() or any(c.newest is not None for c in self._cameras.values())

    def _all_fresh(self) -> bool:
        """Whether every camera that gives pictures has one for this timestep."""
        oldest_ns = self._oldest_ns()
        return self._ended.is_set() or all(
            camera.newest.capture_ns >= oldest_ns if camera.newest else not camera.present
            for camera in self._cameras.values()
        )

    def _oldest_ns(self) -> int:
        """Returns the earliest capture time that belongs to this timestep."""
        if self._together_ns is None:
            return 0
        times_ns = [c.newest.capture_ns for c in self._cameras.values() if c.newest is not None]
        return max(times_ns, default=0) - self._together_ns

    def _any_in_time(self) -> bool:
        """Whether there is a picture for a timestep; those of one that is done are left out."""
        if self._in_order and self._together_ns is not None:
            for camera in self._cameras.values():
                camera.leave_out_until(self._done_ns + self._together_ns)
        return self._any_fresh()

    def _collect(self) -> list[Frame]:
        oldest_ns = self._oldest_ns()
        self._done_ns = max(self._done_ns, oldest_ns + (self._together_ns or 0))
        taken = {c: camera.pop() for c, camera in self._cameras.items()}
        return [
            Frame(c, t.image, self._timestep, t.capture_ns, t.ready_ns, found=t.found)
            for c, t in taken.items()
            if t is not None and t.capture_ns >= oldest_ns
        ]

    def _notify(self, id: str, kind: str, text: str) -> None:
        self._events.append(CameraEvent(id, kind, text))
