"""Cameras that run freely: each on a thread of its own, the newest picture of each per timestep.

A camera that disappears is told, retried and taken back; the others go on without it.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from vsense.arena import Frame
from vsense.tracking.grabbers import CameraEvent, GrabberError
from vsense.tracking.grabbers_picture import Image, PictureError
from vsense.tracking.grabbers_recorded import wrong_size
from vsense.tracking.source import Source

RETRY_S = 1.0
PATIENCE_S = 0.05
"""So long a timestep waits for the other cameras once the first picture is there."""
MOST_EVENTS = 256
"""Nobody may listen for long: only the newest are kept."""
LATE_AFTER = 10
"""A camera that was waited for in vain this often is not waited for any more."""


@dataclass(slots=True)
class _Camera:
    """What is known of one camera; guarded by the grabber's lock."""

    source: Source
    size_px: tuple[int, int]
    newest: tuple[Image, int, int] | None = None
    present: bool = False
    told_gone: bool = False
    late: int = 0


class LiveGrabber:
    """A set of free-running cameras.

    A timestep is complete when every present camera has a picture that was not given before, or
    after `patience_s`. The capture time is when the picture arrived: OpenCV knows no better.

    Attributes:
        timesteps: None: nobody knows how many there will be.
        missed: 0: the newest pictures are always given.
    """

    timesteps: int | None = None
    missed = 0

    def __init__(
        self,
        sources: Mapping[str, Source],
        sizes_px: Mapping[str, tuple[int, int]],
        clock: Callable[[], int],
        patience_s: float = PATIENCE_S,
        retry_s: float = RETRY_S,
    ) -> None:
        """Starts one thread per camera, which opens it and takes pictures.

        Args:
            sources: By the camera's id.
            sizes_px: Width and height that each camera's pictures must have.
            clock: The host's monotonic clock [ns].
            patience_s: How long a timestep waits for missing cameras.
            retry_s: Time between attempts to open a camera.
        """
        self._clock = clock
        self._patience_s = patience_s
        self._retry_s = retry_s
        self._timestep = 0
        self._news = threading.Condition()
        self._ended = threading.Event()
        self._events: deque[CameraEvent] = deque(maxlen=MOST_EVENTS)
        self._cameras = {c: _Camera(source, sizes_px[c]) for c, source in sources.items()}
        self._threads = [
            threading.Thread(target=self._live, args=(c,), name=f"grab {c}", daemon=True)
            for c in self._cameras
        ]
        for thread in self._threads:
            thread.start()

    def next(self, timeout_s: float) -> Sequence[Frame]:
        """Waits for the newest picture of every camera that delivers.

        Raises:
            GrabberError: No camera delivered in `timeout_s`.
        """
        with self._news:
            if not self._news.wait_for(self._any_fresh, timeout_s) or self._ended.is_set():
                raise GrabberError(f"no camera gave a picture in {timeout_s:g} s")
            self._news.wait_for(self._all_fresh, self._patience_s)
            frames = [self._take(c, camera) for c, camera in self._cameras.items()]
            self._timestep += 1
        return [frame for frame in frames if frame is not None]

    def events(self) -> list[CameraEvent]:
        """Gives what happened since the last call."""
        with self._news:
            events = list(self._events)
            self._events.clear()
        return events

    def close(self) -> None:
        """Ends all threads; one that waits for its camera ends when that answers."""
        self._ended.set()
        with self._news:
            self._news.notify_all()
        for thread in self._threads:
            thread.join(self._retry_s + 1.0)

    def _any_fresh(self) -> bool:
        return self._ended.is_set() or any(c.newest is not None for c in self._cameras.values())

    def _all_fresh(self) -> bool:
        """Whether every camera that is worth waiting for has delivered."""
        return self._ended.is_set() or all(
            camera.newest is not None or not camera.present or camera.late >= LATE_AFTER
            for camera in self._cameras.values()
        )

    def _take(self, id: str, camera: _Camera) -> Frame | None:
        if camera.newest is None:
            camera.late += camera.present
            if camera.late == LATE_AFTER and camera.present:
                self._tell(id, "late", "is open but gives no pictures; not waiting for it")
            return None
        image, capture_ns, ready_ns = camera.newest
        camera.newest = None
        if camera.late >= LATE_AFTER:
            self._tell(id, "back", "gives pictures again")
        camera.late = 0
        return Frame(id, image, self._timestep, capture_ns, ready_ns)

    def _live(self, id: str) -> None:
        """One camera's thread: opens it as often as it takes, and keeps its newest picture."""
        camera = self._cameras[id]
        while not self._ended.is_set():
            try:
                said = camera.source.open()
                self._arrive(id, camera, said)
                while not self._ended.is_set():
                    self._grab(id, camera)
            except GrabberError as error:
                self._leave(id, camera, str(error))
            self._ended.wait(self._retry_s)
        camera.source.close()

    def _grab(self, id: str, camera: _Camera) -> None:
        """Waits for one picture; a damaged one is told and forgotten."""
        try:
            image = camera.source.read().image
        except PictureError as error:
            with self._news:
                self._tell(id, "damaged", str(error))
            return
        arrived_ns = self._clock()
        with self._news:
            if image.shape[::-1] != tuple(camera.size_px):
                self._tell(id, "size", wrong_size(image, camera.size_px))
                return
            camera.newest = (image, arrived_ns, arrived_ns)
            self._news.notify_all()

    def _arrive(self, id: str, camera: _Camera, said: list[str]) -> None:
        with self._news:
            for text in said:
                self._tell(id, "control", text)
            if camera.told_gone:
                self._tell(id, "back", "is back")
            camera.present, camera.told_gone, camera.late = True, False, 0

    def _leave(self, id: str, camera: _Camera, reason: str) -> None:
        with self._news:
            if not camera.told_gone:
                self._tell(id, "gone", f"is gone, trying again every {self._retry_s:g} s: {reason}")
            camera.present, camera.told_gone = False, True
            self._news.notify_all()

    def _tell(self, id: str, kind: str, text: str) -> None:
        self._events.append(CameraEvent(id, kind, text))
