"""One open page: what it wants, and what waits to be sent to it.

Of every topic only the newest message waits, so a slow page skips and never lags; events wait in
a line of their own. The publisher's thread only puts messages in; they become text later, once
for all viewers, in the web server's thread.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections import deque

from vsense.hub import Hub, Listener, Message

EVENTS_MAX = 200
"""Events that wait for one page; the oldest go first."""
UNDERWAY_MAX = 48
"""Frames on their way to a page that tells what it got: the rest waits here, where newer ones
replace it, and not in the buffers of two operating systems."""

IDLE = frozenset({"/experiment", "/run", "/event", "/robots"})
"""What a hidden page, or one without refresh, still shows."""
LIVE = IDLE | {"/arena", "/world", "/signals", "/fields", "/cameras"}
PICTURE = "/picture/"
READINGS = "/readings/"


class Viewer:
    """The hub's end of one page. `take` and `wants` may be called by any thread."""

    def __init__(self, hub: Hub, name: str, loop: asyncio.AbstractEventLoop) -> None:
        """Joins the hub.

        Args:
            hub: where messages come from.
            name: who it is, for people.
            loop: the web server's.
        """
        self.name = name
        self._hub = hub
        self._loop = loop
        self._ready = asyncio.Event()
        self._lock = threading.Lock()
        self._letters: deque[Message] = deque(maxlen=EVENTS_MAX)
        self._news: dict[str, Message] = {}
        self._woken = False
        self._topics = LIVE
        self._extra: frozenset[str] = frozenset()
        self._look: int | None = None
        self._pictures: tuple[str, ...] = ()
        self._sent = 0
        self._got: int | None = None
        self._listener: Listener | None = hub.join(self.take, self.wants)

    def leave(self) -> None:
        """Leaves the hub; more than once is fine."""
        listener, self._listener = self._listener, None
        if listener is not None:
            self._hub.leave(listener)

    def wants(self, topic: str) -> bool:
        """Whether the page shows what this topic tells."""
        return topic in self._topics or topic in self._extra

    def take(self, message: Message) -> None:
        """Keeps a message for the page, in the place of an older one that still waits."""
        with self._lock:
            if message.topic == "/event":
                self._letters.append(message)
            else:
                self._news[message.topic] = message
            wakes, self._woken = not self._woken, True
        if wakes:
            # The loop is closed when the server ends while the run goes on.
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._ready.set)

    def post(self, message: Message) -> None:
        """Puts an answer in the line of events; the web server's thread only."""
        with self._lock:
            self._letters.append(message)
        self._ready.set()

    async def next(self) -> Message:
        """Waits for what is to be sent next: events and answers first, then the longest waiting."""
        while True:
            self._ready.clear()
            # While too many are underway nobody has to wake this one: `got` will.
            if self._got is None or self._sent - self._got < UNDERWAY_MAX:
                message = self._pop()
                if message is not None:
                    self._sent += 1
                    return message
            await self._ready.wait()

    def _pop(self) -> Message | None:
        with self._lock:
            self._woken = False
            if self._letters:
                return self._letters.popleft()
            topic = next(iter(self._news), None)
            return None if topic is None else self._news.pop(topic)

    def got(self, frames: int) -> None:
        """The page has dealt with so many frames since it came."""
        self._got = min(max(frames, self._got or 0), self._sent)
        self._ready.set()

    def look(self, tag: int | None) -> None:
        """The page shows what this robot senses; None: no robot's."""
        self._look = tag
        self._choose()

    def pictures(self, cameras: tuple[str, ...]) -> None:
        """The page shows these cameras' pictures."""
        self._pictures = cameras
        self._choose()

    def refresh(self, on: bool) -> None:
        """The page is seen and refreshes, or not.

        When it begins again it has missed changes that are told once only: the viewer joins the
        hub as a newcomer.
        """
        again = on and self._topics is IDLE
        self._topics = LIVE if on else IDLE
        self._choose()
        if again and self._listener is not None:
            self.leave()
            self._listener = self._hub.join(self.take, self.wants)

    def _choose(self) -> None:
        """Puts together what is wanted beside the fixed topics."""
        topics = {f"{PICTURE}{camera}" for camera in self._pictures}
        if self._look is not None:
            topics.add(f"{READINGS}{self._look}")
        self._extra = frozenset(topics) if self._topics is LIVE else frozenset()
        with self._lock:
            for topic in [topic for topic in self._news if not self.wants(topic)]:
                del self._news[topic]
