"""One camera on its own thread: reopened as often as needed, its pictures checked."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from vsense.base.arena import Found, Image
from vsense.base.errors import GrabberError
from vsense.vision.cameras._lateness import PICTURES, FrameTiming, jump_in_words
from vsense.vision.cameras._recorded_grabber import wrong_size
from vsense.vision.cameras.picture import LatePicture, PictureError
from vsense.vision.cameras.source import FIRST_S, Shot, Source, silence_s

WHOLE = 10
"""Good pictures after a damaged one that end the trouble."""

Notify = Callable[[str, str], None]
"""Receives the kind of an event and its text."""


@dataclass(frozen=True, slots=True)
class TakenPicture:
    """A good picture, (h, w) uint8; times are the host's, `ready_ns` is when it was in memory."""

    image: Image
    capture_ns: int
    ready_ns: int
    found: Found | None = None


class LiveCamera:
    """One camera on a thread of its own.

    Attributes:
        newest: The newest picture that was not taken out yet.
        present: Whether it gives pictures now.
        opened: Whether it is open, even if it gives none.
    """

    def __init__(
        self,
        source: Source,
        size_px: tuple[int, int],
        rate_hz: float | None,
        news: threading.Condition,
        notify: Notify,
        clock: Callable[[], int],
        retry_s: float,
    ) -> None:
        """Begins with the camera closed.

        Its pictures must have `size_px` (width, height), and should come at `rate_hz`; None:
        unknown. `news` guards this object's state and is notified of changes; `notify` is called
        with events while `news` is held. `clock` is the host's monotonic clock [ns]; `retry_s`
        passes between attempts to open.
        """
        self._source = source
        self._size_px = tuple(size_px)
        self._news = news
        self._notify = notify
        self._clock = clock
        self._retry_s = retry_s
        self._ended = threading.Event()
        self._timing = FrameTiming(rate_hz)
        self._silence_ns = round(1e9 * silence_s(rate_hz))
        self._first_ns = max(round(1e9 * FIRST_S), self._silence_ns)
        self._due_ns = 0
        self._said: set[str] = set()
        self._gone = False
        self._damaged = self._good_since = self._misfits = 0
        self._frozen = self._reopened = self._overdue = False
        self.newest: TakenPicture | None = None
        self.present = False
        self.opened = False

    def run(self) -> None:
        """Opens the camera and takes pictures until `end`; the camera's thread."""
        try:
            while not self._ended.is_set():
                try:
                    self._use()
                except GrabberError as error:
                    self._leave(str(error))
                except Exception as error:
                    # An error of one camera must neither end its thread nor be hidden.
                    self._leave(f"{type(error).__name__}: {error}")
                self._ended.wait(self._retry_s)
        finally:
            self._source.close()

    def _use(self) -> None:
        """Opens the camera and takes pictures, until it must be reopened."""
        self._arrive(self._source.open())
        while not self._ended.is_set():
            if not self._read_picture():
                # Outside the lock, because a silent camera closes slowly.
                self._source.close()
                return

    def end(self) -> None:
        """Ends the thread as soon as the camera answers."""
        self._ended.set()

    def watch(self, now_ns: int) -> None:
        """Reports a camera that has fallen silent; to be called with `news` held."""
        if self.opened and not self._gone and now_ns > self._due_ns:
            self._lose("gives no pictures any more")

    def pop(self) -> TakenPicture | None:
        """Takes the newest picture out; to be called with `news` held."""
        taken, self.newest = self.newest, None
        return taken

    def leave_out_until(self, capture_ns: int) -> None:
        """Leaves out a picture that was taken before; to be called with `news` held."""
        if self.newest is not None and self.newest.capture_ns < capture_ns:
            self.newest = None
            self._leave_out("comes after its timestep is done: what it shows is left out")

    def _read_picture(self) -> bool:
        """Waits for one picture and checks it; returns whether the camera stays open."""
        try:
            shot = self._source.read()
        except LatePicture as error:
            with self._news:
                self._leave_out(str(error))
            return True
        except PictureError as error:
            with self._news:
                self._spoiled(str(error))
            return True
        arrived_ns = self._clock()
        with self._news:
            self._due_ns = arrived_ns + self._silence_ns
            if shot.image.shape[::-1] != self._size_px:
                return self._misfit(shot.image)
            self._fits()
            if self._timing.repeated(shot):
                return self._repeat()
            self._accept(shot, arrived_ns)
        return True

    def _accept(self, shot: Shot, arrived_ns: int) -> None:
        """Keeps a good picture, and reports the troubles that it ends."""
        first_ns = arrived_ns if shot.arrived_ns is None else shot.arrived_ns
        capture_ns, jump_ns = self._timing.capture_ns(shot, first_ns)
        if jump_ns:
            how = jump_in_words(jump_ns)
            text = f"its clock has jumped {how}; the times of its pictures are right again"
            self._notify("clock", text)
        rate_hz = self._timing.rate_change()
        if rate_hz is not None:
            rate = f"{rate_hz:.1f} pictures per second"
            if self._timing.slow:
                self._notify("slow", f"gives only {rate}")
            else:
                self._notify("prompt", f"gives {rate} again")
        if self._frozen:
            self._notify("running", "runs again")
            self._frozen = self._reopened = False
        self._good_since += 1
        if self._overdue and self._good_since >= WHOLE:
            self._notify("punctual", "comes in time again")
            self._overdue = False
        if self._damaged and self._good_since >= WHOLE:
            text = f"gives whole pictures again, after {self._damaged} damaged ones"
            self._notify("whole", text)
            self._damaged = 0
        if self._gone:
            self._notify("back", "is back")
        self._gone, self.present = False, True
        self.newest = TakenPicture(shot.image, capture_ns, self._clock(), shot.found)
        self._news.notify_all()

    def _leave_out(self, reason: str) -> None:
        """Skips a picture that came too late; timesteps do not wait for its camera."""
        self._due_ns = self._clock() + self._silence_ns
        self._miss()
        if not self._overdue:
            self._notify("overdue", reason)
        self._overdue, self._good_since = True, 0

    def _spoiled(self, reason: str) -> None:
        self._due_ns = self._clock() + self._silence_ns
        self._miss()
        self._good_since = 0
        self._damaged += 1
        self._notify("damaged", reason)

    def _repeat(self) -> bool:
        """Skips a picture whose stamp is that of the one before; reopens the camera once."""
        self._miss()
        if self._timing.repeats < PICTURES:
            return True
        if not self._frozen:
            self._frozen = True
            self._notify("frozen", f"froze: the same picture {PICTURES + 1} times")
        return not self._reopen()

    def _misfit(self, image: Image) -> bool:
        """Skips a picture of a wrong size; reopens the camera once."""
        self._misfits += 1
        self._miss()
        if self._misfits == 1:
            self._notify("size", wrong_size(image, (self._size_px[0], self._size_px[1])))
        return self._misfits < PICTURES or not self._reopen()

    def _reopen(self) -> bool:
        """Whether the camera is to be reopened: once for each trouble."""
        if self._reopened:
            return False
        self._reopened, self.opened = True, False
        return True

    def _miss(self) -> None:
        """Notes an unusable picture: a timestep does not wait for this camera."""
        self.present = False
        self._timing.skip()

    def _fits(self) -> None:
        if self._misfits:
            self._notify("fits", "has the size of its calibration again")
            self._misfits, self._reopened = 0, False

    def _arrive(self, said: list[str]) -> None:
        """Notes that the camera is open; it is back when it gives a picture."""
        with self._news:
            for text in said:
                if text not in self._said:
                    self._notify("control", text)
            self._said.update(said)
            self._timing.forget()
            self._due_ns, self.opened = self._clock() + self._first_ns, True
            # Timesteps wait for it, unless it opened before and gave nothing.
            self.present = not self._gone

    def _leave(self, reason: str) -> None:
        with self._news:
            self.opened = False
            self._lose(f"{reason}; trying again every {self._retry_s:g} s")
            self._news.notify_all()

    def _lose(self, reason: str) -> None:
        if not self._gone:
            self._notify("gone", f"is gone: {reason}")
        self._timing.skip()
        self._gone, self.present, self.newest = True, False, None
