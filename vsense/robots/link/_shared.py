"""What the server's thread and the runtime's thread have in common, and how a defect is told.

A defect is an exception that nobody expected where a packet of one robot was handled: a bug in
vsense. It ends the session of that robot, whose wheels then stop, and nobody else's; it is told
with its cause and place, and counted, so that it is found and mended.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from vsense.base.files import PACKAGE_FOLDER
from vsense.robots.link._roster import SessionTable
from vsense.robots.link._session import HostSession
from vsense.robots.link.status import LinkEvent
from vsense.robots.link.wire import GoodbyeCause

CAUSE_MAX = 200
"""Characters of an exception's own text that are told."""


def cause_of(error: Exception) -> str:
    """An exception in one line of ASCII: its type, its text, and where in vsense it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if PACKAGE_FOLDER in Path(frame.filename).parents]
    text = " ".join(str(error).split())[:CAUSE_MAX].encode("ascii", "backslashreplace").decode()
    message = ": ".join(filter(None, (type(error).__name__, text)))
    if not frames:
        return message
    place = (ours or list(frames))[-1]
    path = Path(place.filename)
    name = path.relative_to(PACKAGE_FOLDER.parent) if ours else path.name
    return f"{message} ({name}:{place.lineno}, {place.name})"


class Waker:
    """Wakes a thread that waits for sockets; it is registered like one, by its `fileno`."""

    def __init__(self) -> None:
        self._in, self._out = socket.socketpair()
        for sock in (self._in, self._out):
            sock.setblocking(False)

    def fileno(self) -> int:
        """What becomes readable after `wake`."""
        return self._in.fileno()

    def wake(self) -> None:
        """Wakes the thread; any thread, also after `close`."""
        # Full: the thread is about to wake. Closed: it has ended.
        with contextlib.suppress(OSError):
            self._out.send(b"\0")

    def drain(self) -> None:
        """Forgets all calls of `wake`; never waits."""
        with contextlib.suppress(OSError):
            self._in.recv(4096)

    def close(self) -> None:
        """Closes both ends; can be called again."""
        self._in.close()
        self._out.close()


@dataclass(frozen=True, slots=True)
class ServerState:
    """What both threads use.

    Attributes:
        roster: robots and orders.
        lock: guards the roster and the connections' outboxes; held for few packets at a time.
        clock: the host's monotonic clock [ns].
        notify: takes events; never called under the lock.
        tick: is called often, with the time.
    """

    roster: SessionTable
    lock: threading.Lock
    clock: Callable[[], int]
    notify: Callable[[LinkEvent], None]
    tick: Callable[[int], None] = lambda now_ns: None

    def notify_all(self, events: Iterable[LinkEvent]) -> None:
        """Notifies of events in their order."""
        for event in events:
            self.notify(event)

    def last_word(self, robot: HostSession | None, error: Exception, now_ns: int) -> bytes:
        """The GOODBYE that a robot gets after a defect; b"" where there is none to send."""
        if robot is None or not robot.open:
            return b""
        text = f"the host failed at a packet: {type(error).__name__}"
        try:
            return robot.goodbye(GoodbyeCause.PROTOCOL, text, self.roster.orders.run, now_ns)
        except Exception:  # whatever the defect has left behind: what it was is told all the same
            return b""

    def tell_defect(self, error: Exception, robot: HostSession | None, origin: str) -> None:
        """Tells a defect that has ended a robot's session, or the connection of a stranger."""
        if robot is None:
            text = f"{origin}: a defect in vsense has ended the connection: {cause_of(error)}"
            self.notify(LinkEvent("defect", None, text, self.clock(), origin))
            return
        text = "a defect in vsense has ended its session, and it may come again"
        text = f"{robot.label}: {text}: {cause_of(error)}"
        self.notify(LinkEvent("defect", robot.tag, text, self.clock()))
