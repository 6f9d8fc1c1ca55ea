"""The recorder's queue, which has bounds, and the marks of what was left out where it was full."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from vsense.base.arena import Frame
from vsense.base.message_bus import Message
from vsense.monitor.recording.writer import gap_message


@dataclass(frozen=True, slots=True)
class WaitingPicture:
    """A picture that is not encoded yet: when it came, and a frame in memory of its own.

    `update` is the call of the tracker that it belongs to, counted from 0; `pictures` is
    how many pictures belong to that call.
    """

    frame: Frame
    time_ns: int
    update: int
    pictures: int


WaitingItem = Message | WaitingPicture

_MESSAGES, _PICTURES = "messages", "pictures"
_SMALL = 200
"""About how many bytes the mark of a gap is."""


@dataclass(frozen=True, slots=True)
class WaitingBounds:
    """How much may wait: bytes, and the age of the oldest; pictures are left out first."""

    message_bytes: int = 16 << 20
    picture_bytes: int = 128 << 20
    message_ns: int = 10_000_000_000
    picture_ns: int = 3_000_000_000


@dataclass(slots=True)
class _Gap:
    from_ns: int
    to_ns: int
    why: str
    left_out: int = 0


@dataclass(slots=True)
class _Queue:
    """What of one kind waits: item, size, and when it was put."""

    items: deque[tuple[WaitingItem, int, int]] = field(default_factory=deque)
    bytes: int = 0

    def append(self, item: WaitingItem, size: int, now_ns: int) -> None:
        self.items.append((item, size, now_ns))
        self.bytes += size

    def pop(self) -> WaitingItem:
        item, size, _ = self.items.popleft()
        self.bytes -= size
        return item


class Waiting:
    """The queue; any thread may put, one takes: messages first, since pictures take long to encode.

    `why` gives the reason that a gap gets which begins now.

    Attributes:
        lost: messages and pictures that were left out.
        lost_why: that of the newest gap, "": there was none.
    """

    KEEP_UP = "it could not be written as fast as it came"

    def __init__(
        self, bounds: WaitingBounds, why: Callable[[], str] = lambda: Waiting.KEEP_UP
    ) -> None:
        self.lost, self.lost_why, self._why = 0, "", why
        self._bounds = bounds
        self._queues = {_MESSAGES: _Queue(), _PICTURES: _Queue()}
        self._gaps: dict[str, _Gap] = {}
        self._changed = threading.Condition()

    def put(self, items: Sequence[WaitingItem], sizes: Sequence[int], now_ns: int) -> bool:
        """Puts items of about `sizes` bytes, all or none; with a picture all wait as pictures do.

        Gives whether there was room; where not, a `/gap` precedes the next that finds room.
        """
        kind = _PICTURES if any(isinstance(item, WaitingPicture) for item in items) else _MESSAGES
        with self._changed:
            if not self._has_room(kind, sum(sizes), now_ns):
                self._leave_out(kind, len(items), now_ns)
                return False
            self._end_gap(kind, now_ns)
            for item, size in zip(items, sizes):
                self._queues[kind].append(item, size, now_ns)
            self._changed.notify()
        return True

    def mark(self, message: Message) -> None:
        """Puts the mark of a gap, for which there is always room."""
        with self._changed:
            self._queues[_MESSAGES].append(message, _SMALL, message.time_ns)
            self._changed.notify()

    def pop(self, timeout_s: float) -> WaitingItem | None:
        """Takes the oldest message, or picture, or nothing where nothing comes in `timeout_s`."""
        with self._changed:
            if timeout_s > 0.0 and not any(queue.items for queue in self._queues.values()):
                self._changed.wait(timeout_s)
            for queue in self._queues.values():
                if queue.items:
                    return queue.pop()
            return None

    def wake(self) -> None:
        """Makes `pop` return now."""
        with self._changed:
            self._changed.notify()

    def end(self, now_ns: int) -> None:
        """Marks gaps that are still open, at the end."""
        with self._changed:
            for kind in list(self._gaps):
                self._end_gap(kind, now_ns)

    def abandon(self) -> None:
        """Leaves out everything that waits."""
        with self._changed:
            for queue in self._queues.values():
                while queue.items:
                    queue.pop()
                    self.lost += 1

    def _has_room(self, kind: str, size: int, now_ns: int) -> bool:
        queue, bounds = self._queues[kind], self._bounds
        oldest_ns = queue.items[0][2] if queue.items else now_ns
        most, patience_ns = bounds.message_bytes, bounds.message_ns
        if kind == _PICTURES:
            most, patience_ns = bounds.picture_bytes, bounds.picture_ns
        return queue.bytes + size <= most and now_ns - oldest_ns <= patience_ns

    def _leave_out(self, kind: str, number: int, now_ns: int) -> None:
        self.lost += number
        gap = self._gaps.setdefault(kind, _Gap(now_ns, now_ns, self._why()))
        self.lost_why = gap.why
        gap.to_ns = now_ns
        gap.left_out += number

    def _end_gap(self, kind: str, now_ns: int) -> None:
        gap = self._gaps.pop(kind, None)
        if gap is not None:
            counts = (0, gap.left_out) if kind == _PICTURES else (gap.left_out, 0)
            message = gap_message(now_ns, gap.from_ns, gap.to_ns, counts, gap.why)
            self._queues[kind].append(message, _SMALL, now_ns)
