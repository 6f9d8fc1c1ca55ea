"""All open pages: what each says and wants, what waits to be sent to it (`MESSAGES.md`).

Of every topic only the newest message waits, so a slow page skips and never lags; events have a
queue of their own. The publisher's thread only puts messages in; the web server's thread makes them
text, once for all viewers.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Collection, Mapping
from typing import Any

from aiohttp import WSMsgType, web

from vsense.base.clock import host_ns
from vsense.base.errors import VsenseError
from vsense.base.message_bus import Listener, Message, MessageBus
from vsense.base.terminal import printable_json
from vsense.config.casting import Pair
from vsense.monitor.recording.form import (
    ORDERS_TOPIC,
    PARTS,
    PICTURE,
    SETTINGS_TOPIC,
    without_nan,
)
from vsense.monitor.ui._arena_file import ArenaFile
from vsense.monitor.ui._sentences import ChangeReadError, read
from vsense.monitor.ui.access import Rights
from vsense.robots.link.strangers import RateLimit
from vsense.run.changes import Ask
from vsense.run.changing import Change
from vsense.run.orders import Give, Order, OrderKind

FRAMES_MAX = 64
"""Frames that are kept for other viewers of the same message."""


class Frames:
    """Makes frames, each once for all viewers. The web server's thread only."""

    def __init__(self) -> None:
        self._encoded: OrderedDict[int, tuple[Message, str | bytes]] = OrderedDict()

    def frame(self, message: Message) -> str | bytes:
        """Text, or bytes where the message has a blob."""
        # Messages cannot be hashed; while one is kept here, no other has its id.
        cached = self._encoded.get(id(message))
        if cached is not None:
            return cached[1]
        encoded = _frame(message)
        self._encoded[id(message)] = (message, encoded)
        if len(self._encoded) > FRAMES_MAX:
            self._encoded.popitem(last=False)
        return encoded


def _frame(message: Message) -> str | bytes:
    head = [message.topic, message.time_ns, message.data]
    try:
        text = json.dumps(head, separators=(",", ":"), allow_nan=False)
    except ValueError:
        text = json.dumps(without_nan(head), separators=(",", ":"))
    text = printable_json(text)
    if not message.blob:
        return text
    encoded = text.encode()
    return len(encoded).to_bytes(4, "big") + encoded + message.blob


EVENTS_MAX = 200
"""Events that wait for one page; the oldest go first."""
UNDERWAY_MAX = 48
"""Frames on their way to a page that reports what it got. The rest waits here, where newer ones
replace it, and not in the buffers of two operating systems."""

IDLE = frozenset({"/experiment", "/run", "/event", "/robots", PARTS, SETTINGS_TOPIC})
"""What a hidden page, or one without refresh, still shows."""
LIVE = IDLE | {"/arena", "/world", "/signals", "/history", "/fields", "/cameras"}


class WebClient:
    """The bus's end of one page. `receive` and `wants` may be called by any thread."""

    def __init__(self, bus: MessageBus, name: str, loop: asyncio.AbstractEventLoop) -> None:
        self.name = name
        self._bus = bus
        self._loop = loop
        self._ready = asyncio.Event()
        self._lock = threading.Lock()
        self._letters: deque[Message] = deque(maxlen=EVENTS_MAX)
        self._news: dict[str, Message] = {}
        self._woken = False
        self._topics = LIVE
        self._extra: frozenset[str] = frozenset()
        self._look: tuple[int, ...] = ()
        self._pictures: tuple[str, ...] = ()
        self._sent = 0
        self._got: int | None = None
        self._listener: Listener | None = bus.join(self.receive, self.wants)

    def leave(self) -> None:
        """Leaves the bus; more than once is fine."""
        listener, self._listener = self._listener, None
        if listener is not None:
            self._bus.leave(listener)

    def wants(self, topic: str) -> bool:
        """Whether the page shows this topic."""
        return topic in self._topics or topic in self._extra

    def receive(self, message: Message) -> None:
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

    def hear(self, message: Message) -> None:
        """Puts an answer in the line of events, from any thread."""
        # The loop is closed when the server ends while the run goes on.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self.post, message)

    async def next(self) -> Message:
        """Waits for the next message to send: events and answers first, then the oldest."""
        while True:
            self._ready.clear()
            # While too many are underway nothing is sent: `got` sets the event.
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
        """The page has handled so many frames since it came."""
        self._got = min(max(frames, self._got or 0), self._sent)
        self._ready.set()

    def look(self, tags: tuple[int, ...]) -> None:
        """The page shows these robots' readings."""
        self._look = tags
        self._choose()

    def pictures(self, cameras: tuple[str, ...]) -> None:
        """The page shows these cameras' pictures."""
        self._pictures = cameras
        self._choose()

    def refresh(self, on: bool) -> None:
        """The page is visible and refreshes, or not.

        When it begins again it has missed changes that are published once: it joins the bus anew.
        """
        resumed = on and self._topics is IDLE
        self._topics = LIVE if on else IDLE
        self._choose()
        if resumed and self._listener is not None:
            self.leave()
            self._listener = self._bus.join(self.receive, self.wants)

    def _choose(self) -> None:
        """Sets what is wanted beside the fixed topics."""
        topics = {f"{PICTURE}{camera}" for camera in self._pictures}
        topics |= {f"/readings/{tag}" for tag in self._look}
        self._extra = frozenset(topics) if self._topics is LIVE else frozenset()
        with self._lock:
            for topic in [topic for topic in self._news if not self.wants(topic)]:
                del self._news[topic]


HISTORY = 50
"""Events that a later viewer is sent."""
HEARTBEAT_S = 10.0
"""A page that does not answer for this long is gone."""
BEAT_S = 2.0
"""A page is sent something at least this often, so that it notices when the network is gone."""
SENTENCE_MAX = 65536
"""Bytes of one sentence of a page."""
SENTENCES_HZ, SENTENCES_BURST = 1000.0, 1000
"""Sentences of one page; more wait. A page says one for a frame that it got."""
LOOKING = "you are looking only: open the page with the control token to press buttons"


class WebClients:
    """All viewers, and the orders that they give. The web server's thread only.

    Attributes:
        arena_file: the experiment's file with what was changed.
    """

    def __init__(self, bus: MessageBus, give: Give, ask: Ask | None = None) -> None:
        """For `give` and `ask` see `WebServer`."""
        self._bus = bus
        self._give, self._ask = give, ask
        self._frames = Frames()
        self._viewers: dict[WebClient, Rights] = {}
        self._sockets: set[web.WebSocketResponse] = set()
        self._came = 0
        self._history: deque[Message] = deque(maxlen=HISTORY)
        self.arena_file = ArenaFile()
        self._listener = bus.join(self._keep, ("/event", ORDERS_TOPIC).__contains__)
        self._does: Mapping[str, Callable[[WebClient, Any], None]] = {
            "order": self._carry_out,
            "change": self._change,
            "look": WebClient.look,
            "refresh": WebClient.refresh,
            "pictures": WebClient.pictures,
            "got": WebClient.got,
        }

    def _keep(self, message: Message) -> None:
        """Keeps events for later viewers, and changes of the world for who saves the arena."""
        keep = self._history.append if message.topic == "/event" else self.arena_file.receive
        keep(message)

    @property
    def viewers(self) -> int:
        """How many pages are open."""
        return len(self._viewers)

    async def close(self) -> None:
        """Closes all pages."""
        self._bus.leave(self._listener)
        for socket in list(self._sockets):
            with contextlib.suppress(asyncio.TimeoutError, OSError):
                await asyncio.wait_for(socket.close(message=b"vsense ended"), 1.0)

    async def serve(self, request: web.Request, rights: Rights) -> web.WebSocketResponse:
        """Serves one page, which has LOOK or CONTROL, until it goes."""
        socket = web.WebSocketResponse(
            heartbeat=HEARTBEAT_S, max_msg_size=SENTENCE_MAX, compress=False
        )
        await socket.prepare(request)
        self._came += 1
        name = f"viewer {self._came} ({request.remote or 'unknown'})"
        viewer = WebClient(self._bus, name, asyncio.get_running_loop())
        for event in list(self._history):
            viewer.post(event)
        self._viewers[viewer] = rights
        self._sockets.add(socket)
        self._introduce()
        tasks = [asyncio.create_task(work(socket, viewer)) for work in (self._send, self._listen)]
        try:
            # A page that is sent nothing any more is closed: it opens again by itself.
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            await _end(tasks)
            viewer.leave()
            del self._viewers[viewer]
            self._sockets.discard(socket)
            self._introduce()
        for task in tasks:
            if not task.cancelled() and (failed := task.exception()) is not None:
                raise failed
        return socket

    def _introduce(self) -> None:
        """Sends every viewer its name and the number of viewers."""
        for viewer in self._viewers:
            viewer.post(self._about(viewer))

    def _about(self, viewer: WebClient) -> Message:
        control = self._viewers[viewer] is Rights.CONTROL
        data = {"viewer": viewer.name, "control": control, "viewers": self.viewers}
        return Message("/you", 0, data)

    async def _send(self, socket: web.WebSocketResponse, viewer: WebClient) -> None:
        """Sends messages to a page, as fast as the page takes them."""
        while not socket.closed:
            try:
                message = await asyncio.wait_for(viewer.next(), BEAT_S)
            except asyncio.TimeoutError:
                message = self._about(viewer)
            if message.topic == "/experiment":
                self.arena_file.receive(message)
            frame = self._frames.frame(message)
            try:
                if isinstance(frame, str):
                    await socket.send_str(frame)
                else:
                    await socket.send_bytes(frame)
            except (ConnectionError, RuntimeError):
                return  # it goes in the middle of something: no news

    async def _listen(self, socket: web.WebSocketResponse, viewer: WebClient) -> None:
        """Reads a page's sentences."""
        limit = RateLimit(SENTENCES_HZ, SENTENCES_BURST)
        with contextlib.suppress(ConnectionError):
            async for message in socket:
                delay_s = limit.delay_s(None, time.monotonic())
                if delay_s:
                    await asyncio.sleep(delay_s)
                if message.type is WSMsgType.TEXT:
                    self._hear(viewer, message.data)
                elif message.type is WSMsgType.BINARY:
                    self._answer(viewer, "not understood: a page says text", False)

    def _hear(self, viewer: WebClient, text: str) -> None:
        """Carries out one sentence."""
        try:
            name, value = read(text)
        except ValueError as error:
            viewer.post(_answer(str(error), False, isinstance(error, ChangeReadError)))
            return
        self._does[name](viewer, value)

    def _carry_out(self, viewer: WebClient, order: tuple[OrderKind, float, Pair]) -> None:
        """Carries out an order, or says why not."""
        kind, value, pair = order
        if self._viewers[viewer] is not Rights.CONTROL:
            self._answer(viewer, LOOKING, False)
            return
        try:
            text = self._give(Order(kind, viewer.name, value, pair))
        except VsenseError as error:
            self._answer(viewer, str(error), False)
            return
        self._answer(viewer, text, True)

    def _change(self, viewer: WebClient, change: Change) -> None:
        """Has the world changed before its next timestep, or says why not.

        The answer comes after that of later orders, which counts their answers: it says so.
        """

        def answer(text: str, ok: bool) -> None:
            viewer.hear(_answer(text, ok, True))

        if self._viewers[viewer] is not Rights.CONTROL:
            answer(LOOKING, False)
        elif self._ask is None:
            answer("nothing can be changed here: no world is running", False)
        else:
            try:
                self._ask(change, viewer.name, answer)
            except VsenseError as error:
                answer(str(error), False)

    def _answer(self, viewer: WebClient, text: str, ok: bool) -> None:
        viewer.post(_answer(text, ok))


async def _end(tasks: Collection[asyncio.Task[None]]) -> None:
    """Ends tasks. Before Python 3.12 a `wait_for` that is over loses the cancellation."""
    pending = set(tasks)
    while pending:
        for task in pending:
            task.cancel()
        _, pending = await asyncio.wait(pending, timeout=0.1)


def _answer(text: str, ok: bool, change: bool = False) -> Message:
    """What became of a page's order, or of a `change`."""
    data: dict[str, Any] = {"text": text, "ok": ok}
    return Message("/answer", host_ns(), data | ({"change": True} if change else {}))
