"""Has all cameras of a set take their pictures at the same moment, again and again."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol

from vsense.tracking.grabbers import GrabberError


class Triggered(Protocol):
    """A camera that takes a picture when it is told to."""

    def trigger(self) -> None:
        """Has a picture taken now; from any thread. A camera that is not open takes none.

        Raises:
            GrabberError: It does not answer, or refuses.
        """


class SoftwareTrigger:
    """Triggers a set of cameras at a fixed rate, until it is closed.

    Every camera is told by a thread of its own, so that none waits for another's answer. One that
    has not answered yet is left out; that it is gone is noticed by whoever waits for its pictures.
    """

    def __init__(
        self, cameras: Mapping[str, Triggered], rate_hz: float, clock: Callable[[], int]
    ) -> None:
        """Begins at once.

        Args:
            cameras: By their ids.
            rate_hz: Pictures per second.
            clock: The host's monotonic clock [ns].
        """
        self._cameras = dict(cameras)
        self._period_ns = round(1e9 / rate_hz)
        self._clock = clock
        self._ended = threading.Event()
        self._tellers = ThreadPoolExecutor(max(1, len(cameras)), "trigger")
        self._asked: dict[str, Future[None]] = {}
        self._thread = threading.Thread(target=self._live, name="trigger", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Triggers no more; can be called again."""
        self._ended.set()
        self._thread.join()
        self._tellers.shutdown(wait=False, cancel_futures=True)

    def _live(self) -> None:
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
