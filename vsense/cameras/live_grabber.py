"""Live cameras together: their common trigger, and the newest picture of each per timestep.

A camera that disappears is reported, tried again and taken back; the others go on without it.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Protocol

from vsense.arena import Frame
from vsense.cameras.grabber import CameraEvent, GrabberError
from vsense.cameras.live_camera import LiveCamera
from vsense.cameras.source import Source


class Triggered(Protocol):
    """A camera that takes a picture when it is told to."""

    def trigger(self) -> None:
        """Has a picture taken now; from any thread. A camera that is not open takes none.

        Raises:
            GrabberError: It does not answer, or refuses.
        """


class SoftwareTrigger:
    """Triggers a set of cameras at a fixed rate, until it is closed.

    Every camera is triggered by a thread of its own, so that none waits for another's answer. One
    that has not answered yet is left out; its silence is noticed where its pictures are awaited.
    """

    def __init__(
        self, cameras: Mapping[str, Triggered], rate_hz: float, clock: Callable[[], int]
    ) -> None:
        """Begins at once.

        Args:
            rate_hz: Pictures per second.
            clock: The host's monotonic clock [ns].
        """
        self._cameras = dict(cameras)
        self._period_ns = round(1e9 / rate_hz)
        self._clock = clock
        self._ended = threading.Event()
        self._tellers = ThreadPoolExecutor(max(1, len(cameras)), "trigger")
        self._asked: dict[str, Future[None]] = {}
        self._thread = threading.Thread(target=self._run, name="trigger", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Triggers no more; can be called again."""
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
            # After a pause the moments that were missed are not made up for.
            next_ns = max(next_ns + self._period_ns, now_ns)
            self._ended.wait((next_ns - now_ns) / 1e9)


def _trigger(camera: Triggered) -> None:
    try:
        camera.trigger()
    except GrabberError:
        # Its own thread finds it silent, and tells why.
        return


RETRY_S = 0.5
PATIENCE_S = 0.05
"""So long a timestep waits for the other cameras once the first picture is there."""
MOST_EVENTS = 256
"""Nobody may listen for long: only the newest are kept."""
JOIN_S = 1.5
"""Cameras that answer end within this; those that do not are left to themselves."""


class LiveGrabber:
    """A set of cameras that run freely, or are triggered together.

    A timestep is complete when every camera that gives pictures has one that was not given before,
    or after `patience_s`. The capture time is the camera's own, mapped to the host's clock, or
    else when the picture arrived.

    Attributes:
        timesteps: None: unknown.
        missed: 0: the newest pictures are always given.
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
        patience_s: float = PATIENCE_S,
        retry_s: float = RETRY_S,
    ) -> None:
        """Starts one thread per camera, which opens it and takes pictures.

        Args:
            sources: By the camera's id.
            sizes_px: Width and height that each camera's pictures must have.
            clock: The host's monotonic clock [ns].
            rates_hz: Pictures per second that each camera should give, where known.
            together_s: Pictures taken further apart are not of one timestep; None: they may be.
            trigger: What has them taken; is closed together with this.
            patience_s: How long a timestep waits for missing cameras.
            retry_s: Time between attempts to open a camera.
        """
        self._clock = clock
        self._patience_s = patience_s
        self._together_ns = None if together_s is None else round(1e9 * together_s)
        self._trigger = trigger
        self._timestep = 0
        self._news = threading.Condition()
        self._ended = threading.Event()
        self._events: deque[CameraEvent] = deque(maxlen=MOST_EVENTS)
        rates = rates_hz or {}
        self._cameras = {
            c: self._camera(c, s, sizes_px[c], rates.get(c), retry_s) for c, s in sources.items()
        }
        self._threads = [
            threading.Thread(target=camera.run, daemon=True) for camera in self._cameras.values()
        ]
        for thread in self._threads:
            thread.start()

    def _camera(
        self,
        id: str,
        source: Source,
        size_px: tuple[int, int],
        rate_hz: float | None,
        retry_s: float,
    ) -> LiveCamera:
        notify = partial(self._notify, id)
        return LiveCamera(source, size_px, rate_hz, self._news, notify, self._clock, retry_s)

    def next(self, timeout_s: float) -> Sequence[Frame]:
        """Waits for the newest picture of every camera that delivers.

        Raises:
            GrabberError: No camera delivered in `timeout_s`.
        """
        with self._news:
            found = self._news.wait_for(self._any_fresh, timeout_s) and not self._ended.is_set()
            if found:
                self._news.wait_for(self._all_fresh, self._patience_s)
            for camera in self._cameras.values():
                camera.watch(self._clock())
            if not found:
                raise GrabberError(f"no camera gave a picture in {timeout_s:g} s")
            frames = self._collect()
            self._timestep += 1
        return frames

    def events(self) -> list[CameraEvent]:
        """Gives what happened since the last call."""
        with self._news:
            events = list(self._events)
            self._events.clear()
        return events

    def close(self) -> None:
        """Ends all threads; one that waits for its camera ends when that answers."""
        self._ended.set()
        if self._trigger is not None:
            self._trigger.close()
        for camera in self._cameras.values():
            camera.end()
        with self._news:
            self._news.notify_all()
        deadline_ns = self._clock() + round(1e9 * JOIN_S)
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
        """Gives when a picture must have been taken to be one of this timestep."""
        if self._together_ns is None:
            return 0
        times_ns = [c.newest.capture_ns for c in self._cameras.values() if c.newest is not None]
        return max(times_ns, default=0) - self._together_ns

    def _collect(self) -> list[Frame]:
        oldest_ns = self._oldest_ns()
        taken = {c: camera.pop() for c, camera in self._cameras.items()}
        return [
            Frame(c, t.image, self._timestep, t.capture_ns, t.ready_ns)
            for c, t in taken.items()
            if t is not None and t.capture_ns >= oldest_ns
        ]

    def _notify(self, id: str, kind: str, text: str) -> None:
        self._events.append(CameraEvent(id, kind, text))
