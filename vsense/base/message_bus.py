"""Passes messages of a run on to listeners: web pages, the recorder, a terminal.

No listener can hold the publisher up, and messages are made only if they are wanted. A replay
publishes the same messages again. `vsense/monitor/ui/MESSAGES.md` lists the topics.
"""

from __future__ import annotations

import csv
import struct
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from vsense.base.terminal import printable_lines

DAMAGED = (
    *(KeyError, TypeError, ValueError, IndexError, AttributeError, ArithmeticError),
    *(RecursionError, struct.error, csv.Error),
)
"""What reading somebody's message may raise: JSON has integers that no float holds, too."""


@dataclass(frozen=True, slots=True)
class Message:
    """One message on the bus.

    Attributes:
        topic: such as "/arena".
        time_ns: when it became so, host's monotonic clock.
        data: what JSON can hold; not changed any more.
        blob: a picture's bytes, where the topic is a picture.
    """

    topic: str
    time_ns: int
    data: Mapping[str, Any]
    blob: bytes = b""


@dataclass(eq=False, slots=True)
class Listener:
    """A subscriber of the bus.

    Attributes:
        receive: gets every wanted message, in the publisher's thread; must not wait.
        wants: whether it wants a topic now; any thread, must not wait.
    """

    receive: Callable[[Message], None] = field(repr=False)
    wants: Callable[[str], bool] = field(repr=False)


class MessageBus:
    """Passes messages on. Its methods may be called by any thread.

    `joined` counts the listeners that have ever joined. When it has grown, publishers publish
    again what changes rarely.
    """

    def __init__(self) -> None:
        self.joined = 0
        self._listeners: tuple[Listener, ...] = ()
        self._lock = threading.Lock()

    def join(self, receive: Callable[[Message], None], wants: Callable[[str], bool]) -> Listener:
        """Adds a listener; see `Listener` for the arguments."""
        listener = Listener(receive, wants)
        with self._lock:
            self._listeners = (*self._listeners, listener)
            self.joined += 1
        return listener

    def leave(self, listener: Listener) -> None:
        """Removes a listener; it may still get a message that is being published."""
        with self._lock:
            self._listeners = tuple(other for other in self._listeners if other is not listener)

    def wants(self, topic: str) -> bool:
        """Whether a listener wants a topic now."""
        return any(listener.wants(topic) for listener in self._listeners)

    def notify(self, topic: str, time_ns: int, make: Callable[[], Mapping[str, Any]]) -> None:
        """Publishes a message whose data is made only if it is wanted."""
        if self.wants(topic):
            self.publish(Message(topic, time_ns, make()))

    def event(self, text: str, level: str, time_ns: int, run_time_s: float | None = None) -> None:
        """Publishes a line for people, /event; `level` is "info", "warning" or "trouble".

        `run_time_s` is since the run's beginning, None: before it.
        """
        data = {"text": printable_lines(text), "level": level, "by": None, "time_s": run_time_s}
        self.publish(Message("/event", time_ns, data))

    def publish(self, message: Message) -> None:
        """Gives a message to all listeners that want it."""
        for listener in self._listeners:
            if listener.wants(message.topic):
                listener.receive(message)
