"""All open pages: the conversation with each, from its WebSocket's opening to its end."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import deque

from aiohttp import WSMsgType, web

from vsense.errors import VsenseError
from vsense.message_bus import Message, MessageBus
from vsense.run.control import Give, Order, OrderKind
from vsense.ui.access import Rights
from vsense.ui.viewer import Frames, WebClient, read

HISTORY = 50
"""Events that somebody who comes later is told."""
HEARTBEAT_S = 10.0
"""A page that does not answer for this long is gone."""
BEAT_S = 2.0
"""A page hears something at least this often, so that it notices when the network is gone."""
SENTENCE_MAX = 65536
"""Bytes that a page may say at once."""
LOOKING = "you are looking only: open the page with the control token to press buttons"


class WebClients:
    """All viewers, and the orders that they give. The web server's thread only."""

    def __init__(self, bus: MessageBus, give: Give) -> None:
        self._bus = bus
        self._give = give
        self._frames = Frames()
        self._viewers: dict[WebClient, Rights] = {}
        self._sockets: set[web.WebSocketResponse] = set()
        self._came = 0
        self._history: deque[Message] = deque(maxlen=HISTORY)
        self._listener = bus.join(self._history.append, "/event".__eq__)

    @property
    def viewers(self) -> int:
        """How many pages are open."""
        return len(self._viewers)

    async def close(self) -> None:
        """Sends everybody away."""
        self._bus.leave(self._listener)
        for socket in list(self._sockets):
            with contextlib.suppress(asyncio.TimeoutError, OSError):
                await asyncio.wait_for(socket.close(message=b"vsense ended"), 1.0)

    async def serve(self, request: web.Request, rights: Rights) -> web.WebSocketResponse:
        """Talks to one page, which has LOOK or CONTROL, until it goes."""
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
        sending = asyncio.create_task(self._send(socket, viewer))
        try:
            await self._listen(socket, viewer)
        finally:
            viewer.leave()
            del self._viewers[viewer]
            self._sockets.discard(socket)
            sending.cancel()
            # What a page leaves behind when it goes in the middle of something is no news.
            await asyncio.gather(sending, return_exceptions=True)
            self._introduce()
        return socket

    def _introduce(self) -> None:
        """Tells everybody who they are and how many look."""
        for viewer in self._viewers:
            viewer.post(self._about(viewer))

    def _about(self, viewer: WebClient) -> Message:
        control = self._viewers[viewer] is Rights.CONTROL
        told = {"viewer": viewer.name, "control": control, "viewers": self.viewers}
        return Message("/you", 0, told)

    async def _send(self, socket: web.WebSocketResponse, viewer: WebClient) -> None:
        """Sends what waits for a page, as fast as the page takes it."""
        while not socket.closed:
            try:
                message = await asyncio.wait_for(viewer.next(), BEAT_S)
            except asyncio.TimeoutError:
                message = self._about(viewer)
            frame = self._frames.frame(message)
            try:
                if isinstance(frame, str):
                    await socket.send_str(frame)
                else:
                    await socket.send_bytes(frame)
            except (ConnectionError, RuntimeError):
                return

    async def _listen(self, socket: web.WebSocketResponse, viewer: WebClient) -> None:
        """Does what a page says."""
        with contextlib.suppress(ConnectionError):
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    self._hear(viewer, message.data)
                elif message.type is WSMsgType.BINARY:
                    self._answer(viewer, "not understood: a page says text", False)

    def _hear(self, viewer: WebClient, text: str) -> None:
        """Does what one sentence says."""
        try:
            name, value = read(text)
        except ValueError as error:
            self._answer(viewer, str(error), False)
            return
        if name == "order":
            self._order(viewer, *value)
        else:
            getattr(viewer, name)(value)

    def _order(self, viewer: WebClient, kind: OrderKind, value: float) -> None:
        """Carries out an order, or says why not."""
        if self._viewers[viewer] is not Rights.CONTROL:
            self._answer(viewer, LOOKING, False)
            return
        try:
            text = self._give(Order(kind, viewer.name, value))
        except VsenseError as error:
            self._answer(viewer, str(error), False)
            return
        self._answer(viewer, text, True)

    def _answer(self, viewer: WebClient, text: str, ok: bool) -> None:
        viewer.post(Message("/answer", time.monotonic_ns(), {"text": text, "ok": ok}))
