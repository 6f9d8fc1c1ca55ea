"""Recordings at the pace in which they were taken."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import replace

from vsense.base.arena import Frame
from vsense.base.errors import GrabberError
from vsense.vision.cameras._recorded_grabber import PICTURE_TIMEOUT_S, RecordedGrabber
from vsense.vision.cameras.grabber import CameraEvent


class PacedGrabber:
    """Gives the timesteps of a recording as if they happened now, from the first `next` on."""

    def __init__(self, recorded: RecordedGrabber, clock: Callable[[], int]) -> None:
        """Takes the recording and the host's monotonic clock [ns]."""
        self._recorded = recorded
        self._clock = clock
        self._shift_ns: int | None = None
        self._ended = threading.Event()
        self.timesteps = recorded.timesteps

    @property
    def missed(self) -> int:
        """See `Grabber.missed`."""
        return self._recorded.missed

    def go_on(self) -> None:
        """After a pause: what is next is due now; in the thread of `next`."""
        self._shift_ns = None

    def next(self, timeout_s: float = PICTURE_TIMEOUT_S) -> Sequence[Frame]:
        """Waits until the next timestep is due; see `Grabber.next`."""
        due_ns = self._recorded.due_ns()
        if due_ns is None:
            return self._recorded.next(timeout_s)
        if self._shift_ns is None:
            self._shift_ns = self._clock() - due_ns
        wait_s = (due_ns + self._shift_ns - self._clock()) / 1e9
        if wait_s > timeout_s:
            self._ended.wait(timeout_s)
            raise GrabberError(f"no picture of the recording was due in {timeout_s:g} s")
        if wait_s > 0.0:
            self._ended.wait(wait_s)
        # Timesteps after which another one is due already are left out.
        now_ns = self._clock() - self._shift_ns
        while (after_ns := self._recorded.due_ns(1)) is not None and after_ns <= now_ns:
            self._recorded.skip()
        return self._recorded.next(timeout_s)

    def events(self) -> list[CameraEvent]:
        """See `Grabber.events`."""
        return self._recorded.events()

    def close(self) -> None:
        """Ends all waiting and closes the recording; can be called again."""
        self._ended.set()
        self._recorded.close()


class HeldPlayer:
    """Repeats a recording's first pictures until `play`, then gives all at their own pace; in a
    pause it repeats the last ones.

    `held` is whether the pictures given last were repeated, or the first ones, not played yet.
    """

    def __init__(
        self, recorded: RecordedGrabber, period_s: float, clock: Callable[[], int]
    ) -> None:
        """Begins with the first pictures of a recording that is this player's alone.

        They are given every `period_s`; `clock` is the host's monotonic clock [ns].
        """
        self.timesteps = recorded.timesteps
        self.held = True
        self._recorded = recorded
        self._period_s = period_s
        self._clock = clock
        self._started = threading.Event()
        self._first: Sequence[Frame] = ()
        self._last: Sequence[Frame] = ()
        self._paced: PacedGrabber | None = None
        self._restarted, self._pauses = True, False
        self._closed = threading.Event()
        self._shift_ns = 0
        self._timestep = -1

    @property
    def missed(self) -> int:
        """See `Grabber.missed`."""
        return self._recorded.missed

    def play(self) -> None:
        """Goes on from now; any thread."""
        self._started.set()

    def pause(self) -> None:
        """Stands still until `go_on`; in the thread of `next`."""
        self._pauses = self._paced is not None

    def go_on(self) -> None:
        """Goes on where it stood; in the thread of `next`."""
        if self._pauses and self._paced is not None:
            self._paced.go_on()
            self._restarted, self._pauses = True, False

    def next(self, timeout_s: float) -> Sequence[Frame]:
        """Waits until the next pictures are due, dated as if taken now; see `Grabber.next`."""
        if not self._first:
            self._first = self._recorded.next(timeout_s)
        elif self._pauses:
            self._closed.wait(min(self._period_s, timeout_s))
            self.held = True
            return self._dated(self._last, restarted=True)
        elif self._started.wait(min(self._period_s, timeout_s)):
            return self._played(timeout_s)
        return self._dated(self._first, restarted=True)

    def events(self) -> list[CameraEvent]:
        """See `Grabber.events`."""
        return self._recorded.events()

    def close(self) -> None:
        """Ends all waiting and closes the recording; can be called again."""
        self._started.set()
        self._closed.set()
        if self._paced is not None:
            self._paced.close()
        self._recorded.close()

    def _played(self, timeout_s: float) -> Sequence[Frame]:
        if self._paced is None:
            self._paced = PacedGrabber(self._recorded, self._clock)
        self._last = self._paced.next(timeout_s)
        frames = self._dated(self._last, self._restarted)
        self.held = self._restarted = False
        return frames

    def _dated(self, frames: Sequence[Frame], restarted: bool = False) -> Sequence[Frame]:
        """Moves pictures to the host's clock; `restarted`: the newest was taken just now."""
        now_ns = self._clock()
        if restarted:
            self._shift_ns = now_ns - max(frame.capture_ns for frame in frames)
        self._timestep += 1
        return [
            replace(
                frame,
                timestep=self._timestep,
                capture_ns=frame.capture_ns + self._shift_ns,
                ready_ns=now_ns,
            )
            for frame in frames
        ]
