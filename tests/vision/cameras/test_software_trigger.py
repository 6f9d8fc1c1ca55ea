"""One signal for all cameras, again and again."""

from __future__ import annotations

import threading

from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError
from vsense.vision.cameras._live_grabber import SoftwareTrigger


class Camera:
    """Counts its triggers; may refuse, or not answer until it is let."""

    def __init__(self, refuses: bool = False, stuck: threading.Event | None = None) -> None:
        self.refuses = refuses
        self.stuck = stuck
        self.count = 0
        self.seen = threading.Condition()

    def trigger(self) -> None:
        with self.seen:
            self.count += 1
            self.seen.notify_all()
        if self.stuck is not None:
            self.stuck.wait()
        if self.refuses:
            raise GrabberError("is not there")

    def wait(self, count: int) -> None:
        with self.seen:
            assert self.seen.wait_for(lambda: self.count >= count, 30.0)


def test_all_are_triggered_and_none_waits_for_another() -> None:
    free = threading.Event()
    good, gone, stuck = Camera(), Camera(refuses=True), Camera(stuck=free)
    trigger = SoftwareTrigger({"a": good, "b": gone, "c": stuck}, 200.0, host_ns)
    try:
        good.wait(20)
        gone.wait(20)
        assert stuck.count == 1
        free.set()
        stuck.wait(5)
    finally:
        free.set()
        trigger.close()
    ended = good.count
    trigger.close()
    assert good.count == ended


def test_what_was_missed_is_not_made_up_for() -> None:
    now_ns, camera = iter([0, *[10**10] * 10_000]), Camera()
    trigger = SoftwareTrigger({"a": camera}, 1.0, lambda: next(now_ns))
    try:
        # After the first signal the clock leaps by ten seconds: nine signals are lost.
        camera.wait(2)
    finally:
        trigger.close()
    assert camera.count == 2
