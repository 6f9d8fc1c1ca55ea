"""A live camera that does what a test says, on a clock of the test's own."""

from __future__ import annotations

import queue
import threading

import numpy as np

from vsense.vision.cameras.source import Shot

SIZE = (64, 48)
PERIOD_NS = 100_000_000


class Script:
    """A camera that does what a test says, one picture at a time, on a clock of the test's own."""

    def __init__(self) -> None:
        self.now_ns = 10**12
        self.stamp_ns = 5 * 10**11
        self.comes: queue.Queue[Shot | Exception] = queue.Queue()
        self.waits = threading.Semaphore(0)
        self.stuck_ns = 0
        self.closes: threading.Event | None = None
        self.opened = 0
        self.size = SIZE
        self.refuses: list[str] = []

    def open(self) -> list[str]:
        self.opened += 1
        self.size = SIZE
        return self.refuses

    def read(self) -> Shot:
        self.waits.release()
        thing = self.comes.get()
        if isinstance(thing, Exception):
            raise thing
        return thing

    def close(self) -> None:
        """Takes as long as a silent camera does, where a test says so."""
        if self.closes is not None:
            assert self.closes.wait(30.0)

    def give(self, thing: Shot | Exception) -> None:
        """Hands one thing over, and waits until it was judged."""
        self.comes.put(thing)
        assert self.waits.acquire(timeout=30.0)

    def wait(self, time_ns: int) -> None:
        """Lets time go by, for the host and for the camera."""
        self.now_ns += time_ns
        self.stamp_ns += time_ns

    def shot(self, after_ns: int = PERIOD_NS, stamp_ns: int | None = None) -> Shot:
        """The next picture; by default a good one, one period after the last."""
        self.now_ns += after_ns
        self.stamp_ns += after_ns if stamp_ns is None else stamp_ns
        return Shot(np.full(self.size[::-1], 90, np.uint8), self.stamp_ns, self.now_ns)
