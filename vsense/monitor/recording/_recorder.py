"""Records the bus's messages and the cameras' pictures, on a thread of its own.

Publishers only put messages into a queue. The thread encodes them and brings them to the disk twice
a second, so that a killed process loses less than the last second. Where it cannot keep up,
pictures are left out first; where the disk is full, everything that the queue does not hold; both
leave a mark in the recording.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2

from vsense.base.arena import Frame
from vsense.base.clock import host_ns
from vsense.base.message_bus import Listener, Message, MessageBus
from vsense.base.terminal import Level
from vsense.base.writing import has_ended
from vsense.monitor.foxglove.channels import Channels
from vsense.monitor.recording import form, megabytes
from vsense.monitor.recording._waiting import Waiting, WaitingBounds, WaitingItem, WaitingPicture
from vsense.monitor.recording.pictures import png_of
from vsense.monitor.recording.writer import FLUSH_S, RecordingWriter, gap_message
from vsense.vision.tracking import recorded_tracker
from vsense.vision.tracking.arena_tracker import ArenaTracker

WRITE_RETRY_S = 1.0
TRIAL_S = 1.0
FORETELL_S = 10.0
"""After so long it is known what a minute costs."""
_CLOSE_S = 30.0
_FIRST_SIZE = 2_048
"""Assumed size of a topic's first message."""


@dataclass(slots=True)
class _Load:
    """What the recorder's thread has spent its time with [ns].

    Attributes:
        busy: it did not wait for something to record.
        disk: of that, writing took; `ran`: it had a processor, for encoding.
        writes_since: it writes since then; None: it does not.
    """

    busy: int = 0
    disk: int = 0
    ran: int = 0
    writes_since: int | None = None

    @contextmanager
    def at_work(self, writes: bool = False) -> Iterator[None]:
        """It encodes in here, or `writes` to the disk."""
        begun, ran_before = time.monotonic_ns(), time.thread_time_ns()
        self.writes_since = begun if writes else None
        try:
            yield
        finally:
            spent, ran = time.monotonic_ns() - begun, time.thread_time_ns() - ran_before
            self.busy, self.ran = self.busy + spent, self.ran + ran
            self.disk, self.writes_since = self.disk + (spent - ran if writes else 0), None

    def in_words(self) -> str:
        """Why it could not keep up: what it was busy with, the most of it first; any thread."""
        since = self.writes_since
        writing = 0 if since is None else time.monotonic_ns() - since
        busy, disk = self.busy + writing, self.disk + writing
        parts = {
            "waiting for a processor": busy - disk - self.ran,
            "encoding": self.ran,
            "writing to the disk": disk,
        }
        shares = [
            f"{100 * max(spent, 0) // max(busy, 1)} % {what}"
            for what, spent in sorted(parts.items(), key=lambda part: -part[1])
        ]
        return f"recording did not keep up; of its time it spent {', '.join(shares)}"


class Recorder:
    """One recording of one run; all methods may be called by any thread.

    Args:
        bus: what it carries is recorded; trouble with the disk is published there.
        path: of a new file.
        pictures: whether pictures that are given to `pictures` are kept.
        say: takes a line for people and its level, from any thread, and publishes it; None: the
            bus takes it.
        bounds: how much may wait.
        clock: the host's monotonic clock [ns].

    Raises:
        RecordingError: the file cannot be made, or there is one already.
    """

    def __init__(
        self,
        bus: MessageBus,
        path: Path,
        pictures: bool = False,
        say: Callable[[str, Level], None] | None = None,
        bounds: WaitingBounds | None = None,
        clock: Callable[[], int] = host_ns,
    ) -> None:
        self.path = path
        self._bus, self._say = bus, say
        self._keeps_pictures = pictures
        self._clock = clock
        self._load = _Load()
        self._trouble: str | None = None
        why = lambda: self._trouble or self._load.in_words()  # noqa: E731
        self._waiting = Waiting(bounds or WaitingBounds(), why)
        utc_shift_ns = time.time_ns() - clock()
        self._writer = RecordingWriter(path, clock(), utc_shift_ns)
        self._channels: Channels | None = Channels(utc_shift_ns, full_size=pictures)
        self._sizes: dict[str, int] = {}
        self._tracker: Mapping[str, Any] | None = None
        self._updates, self._has_memory = 0, False
        self._on_since_ns, self._recorded_ns = clock(), 0
        self._off_since_ns: int | None = None
        self._foretold = self._said_lost = False
        self._unfit: set[str] = set()
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self._listener: Listener | None = bus.join(self.receive, form.is_recorded)
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()

    def receive(self, message: Message) -> None:
        """Queues a message of the bus."""
        size = self._sizes.get(message.topic, _FIRST_SIZE)
        self._waiting.put([message], [size], self._clock())

    def describe_tracker(self, description: Mapping[str, Any]) -> None:
        """Sets what the tracker is made from, before the first pictures; see `tracker_made`."""
        self._tracker, self._has_memory = description, False

    def pictures(self, frames: Sequence[Frame], tracker: ArenaTracker | None = None) -> None:
        """Copies all pictures that the tracker is about to be given, in that order.

        To be called in the tracker's thread, right before `tracker.update(frames)`. At the
        beginning and after a gap, the tracker's memory is recorded, too: from there on, the same
        pictures make the same arena states.
        """
        wanted = self._keeps_pictures and self._off_since_ns is None
        if not wanted or not frames or self._closing.is_set():
            return
        now_ns = self._clock()
        items: list[WaitingItem] = []
        sizes: list[int] = []
        if not self._has_memory and tracker is not None and self._tracker is not None:
            data = {"made": self._tracker, "memory": recorded_tracker.freeze(tracker)}
            items.append(Message(form.TRACKER_TOPIC, now_ns, data))
            sizes.append(_FIRST_SIZE)
        for frame in frames:
            copy = replace(frame, image=frame.image.copy())
            items.append(WaitingPicture(copy, now_ns, self._updates, len(frames)))
            sizes.append(frame.image.nbytes)
        self._updates += 1
        self._has_memory = self._waiting.put(items, sizes, now_ns)

    def pause(self) -> None:
        """Stops recording until `resume`; can be called again."""
        with self._lock:
            if self._listener is not None:
                self._bus.leave(self._listener)
                self._listener, self._off_since_ns = None, self._clock()
                self._recorded_ns += self._off_since_ns - self._on_since_ns

    def resume(self) -> None:
        """Goes on recording; the recording says what is missing."""
        with self._lock:
            if self._listener is not None or self._closing.is_set():
                return
            self._end_pause()
            # Publishers repeat for a new listener what changes rarely.
            self._listener = self._bus.join(self.receive, form.is_recorded)

    @property
    def seconds(self) -> float:
        """For how long it has recorded, pauses left out."""
        since_ns = self._clock() - self._on_since_ns if self._off_since_ns is None else 0
        return (self._recorded_ns + since_ns) / 1e9

    def state(self) -> dict[str, Any]:
        """The "recording" of the message `/run`."""
        return {
            "on": self._listener is not None,
            "file": str(self.path),
            "bytes": self._writer.bytes,
            "lost_messages": self._waiting.lost,
            "lost_why": self._waiting.lost_why or None,
            "trouble": self._trouble,
        }

    def close(self) -> None:
        """Writes what waits, and the index, as far as the disk takes them; can be called again."""
        with self._lock:
            listener, self._listener = self._listener, None
            if listener is not None:
                self._bus.leave(listener)
            if not self._closing.is_set():
                self._end_pause()
                self._waiting.end(self._clock())
            self._closing.set()
        self._waiting.wake()
        if not has_ended(self._thread, _CLOSE_S):
            self._report(f"the end of the recording is missing: {self.path}: no answer of the disk")

    def _end_pause(self) -> None:
        """Marks the gap since `pause`."""
        since_ns, now_ns = self._off_since_ns, self._clock()
        if since_ns is not None:
            why = "recording was switched off"
            self._waiting.mark(gap_message(now_ns, since_ns, now_ns, (0, 0), why))
            self._has_memory, self._off_since_ns, self._on_since_ns = False, None, now_ns

    def _run(self) -> None:
        """The thread. An internal fault ends the recording, and is published."""
        try:
            self._record()
        except Exception as error:
            self._trouble = f"recording has failed: {error!r}"
            self._report(f"recording has failed: {self.path}: {error!r}")
            self.pause()

    def _record(self) -> None:
        due_s = time.monotonic() + FLUSH_S
        while not self._closing.is_set():
            item = self._waiting.pop(max(due_s - time.monotonic(), 0.0))
            if item is not None:
                with self._load.at_work():
                    self._add(item)
            if time.monotonic() >= due_s or self._writer.is_full:
                due_s = time.monotonic() + FLUSH_S
                # However long the disk is full.
                while not self._flush() and not self._closing.wait(WRITE_RETRY_S):
                    pass
                self._say_how()
        self._finish()

    def _say_how(self) -> None:
        """Says once what a minute costs, and once that something is lost."""
        seconds, size = self.seconds, self._writer.bytes
        if not self._foretold and seconds >= FORETELL_S:
            self._foretold = True
            with suppress(OSError):
                free = shutil.disk_usage(self.path.parent).free
                cost = megabytes(60.0 * size / seconds)
                self._report(f"recording: about {cost} a minute; {megabytes(free)} free", "info")
        if self._waiting.lost and not self._said_lost:
            self._said_lost = True
            self._report(f"pictures and messages are left out: {self._load.in_words()}", "warning")

    def _add(self, item: WaitingItem) -> None:
        """Encodes one item into the present chunk."""
        topic = (
            f"{form.PICTURE}{item.frame.camera}" if isinstance(item, WaitingPicture) else item.topic
        )
        try:
            message = _encoded(item, topic) if isinstance(item, WaitingPicture) else item
            self._sizes[topic] = self._writer.add(message)
            self._derive(message)
        except (TypeError, ValueError, RecursionError, cv2.error) as error:
            self._waiting.lost += 1
            if topic not in self._unfit:
                self._unfit.add(topic)
                self._report(f"messages {topic} cannot be recorded: {error}")

    def _derive(self, message: Message) -> None:
        """Adds what other tools show of a message; a fault in that ends it, and nothing else."""
        if self._channels is None:
            return
        try:
            for derived in self._channels.convert(message):
                self._writer.add_derived(derived)
        except Exception as error:
            self._channels = None
            self._report(f"the recording goes on without what is for Foxglove: {error!r}")

    def _flush(self) -> bool:
        """Brings the chunk to the disk; gives whether the disk took it."""
        try:
            with self._load.at_work(writes=True):
                self._writer.flush()
        except OSError as error:
            if self._trouble is None:
                self._said_lost = True
                self._trouble = str(error.strerror)
                self._report(
                    f"recording is suspended: {self.path} cannot be written: {error.strerror};"
                    " the run goes on without it, and so does the recording as soon as it can"
                )
            return False
        if self._trouble is not None:
            self._trouble = None
            self._rejoin()
            self._report(f"recording goes on: {self.path} can be written again", "info")
        return True

    def _finish(self) -> None:
        """Writes what waits, if the disk takes it, and the index."""
        while self._flush() and (item := self._waiting.pop(0.0)) is not None:
            self._add(item)
            while not self._writer.is_full and (item := self._waiting.pop(0.0)) is not None:
                self._add(item)
        self._waiting.abandon()
        try:
            self._writer.close()
        except OSError as error:
            self._trouble = str(error.strerror)
            self._report(f"the end of the recording is missing: {self.path}: {error.strerror}")

    def _rejoin(self) -> None:
        """Joins the bus anew: publishers repeat for a new listener what changes rarely."""
        with self._lock:
            if self._listener is not None:
                self._bus.leave(self._listener)
                self._listener = self._bus.join(self.receive, form.is_recorded)

    def _report(self, text: str, level: Level = "trouble") -> None:
        if self._say is None:
            self._bus.event(text, level, self._clock())
        else:
            self._say(text, level)


def _encoded(picture: WaitingPicture, topic: str) -> Message:
    """Makes the message of a picture."""
    frame = picture.frame
    blob = png_of(frame.image)
    height_px, width_px = frame.image.shape
    data = {
        "camera": frame.camera,
        "timestep": frame.timestep,
        "capture_ns": frame.capture_ns,
        "ready_ns": frame.ready_ns,
        "format": "png",
        "width_px": width_px,
        "height_px": height_px,
        "scale": 1,
        "update": picture.update,
        "pictures": picture.pictures,
    }
    return Message(topic, picture.time_ns, data, blob)


def try_pictures(frames: Sequence[Frame], folder: Path) -> tuple[float, float]:
    """Writes pictures into a folder for `TRIAL_S`, as a recording does; nothing is left of it.

    Returns:
        How many were written in a second, and the bytes of one on the disk.

    Raises:
        RecordingError, OSError: the folder cannot be written.
    """
    path = folder / f".trial-{time.monotonic_ns()}.mcap"
    writer = RecordingWriter(path, 0, 0)
    path.unlink()
    begun, written, flushes = time.monotonic(), 0, 1
    try:
        while (spent := time.monotonic() - begun) < TRIAL_S:
            frame = frames[written % len(frames)]
            item = WaitingPicture(frame, 0, 0, len(frames))
            writer.add(_encoded(item, f"{form.PICTURE}{frame.camera}"))
            written += 1
            if spent > flushes * FLUSH_S or writer.is_full:
                writer.flush()
                flushes += 1
        writer.flush()
        return written / (time.monotonic() - begun), writer.bytes / written
    finally:
        writer.close()
