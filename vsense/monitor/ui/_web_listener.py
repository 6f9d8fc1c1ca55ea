"""Accepts the connections of the page and ends those that bring nothing.

aiohttp reads HTTP; here is decided who may be connected, and for how long without a whole request.
A connection is a stranger's until it has shown a token (or, where none is needed, brought a
request); a page, which is a WebSocket, has a place of its own (`_page_clients.py`).
"""

from __future__ import annotations

import asyncio
import logging
import socket
import ssl
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aiohttp import web

from vsense.base.clock import host_ns
from vsense.robots.link import strangers
from vsense.robots.link.strangers import PortPlaces, RateLimit, StrangerLog, owner_of

REQUEST_S = 5.0
"""A connection brings its first whole request within this time, TLS and all, or is closed."""
KEEP_ALIVE_S = 10.0
"""And every other request within this time after the answer to the one before."""
UNVOUCHED_MAX, UNVOUCHED_PER_ADDRESS = 128, 32
"""Connections of strangers at a time, in all and from one address; the oldest makes way for one
more."""
VOUCHED_MAX, VOUCHED_PER_ADDRESS = 128, 64
"""Likewise of those that have shown a token: a browser keeps six for a page, a relay has many."""

REQUESTS_HZ, REQUESTS_BURST = 200.0, 400
"""Requests of one address that has shown a token, and of all strangers together; more wait. A page
with its files is about thirty."""

BATCH = 16
"""Connections that are accepted in a row, before those that are open have their turn."""
SWEEP_S = 0.5
"""How accurately the time limits are kept."""

LATE = "no whole request in time"
CROWDED = "too many connections at once"
NO_HTTP = "not HTTP"
NO_TLS = "TLS failed"
WRONG_TOKEN = "a wrong token"
NOT_ACCEPTED = "cannot accept a connection"


@dataclass(eq=False, slots=True)
class Visitor:
    """A connection of the page.

    Attributes:
        origin: its address, for people.
        owner: whom it counts for.
        due_s: when it is closed, on the loop's clock; inf: while a request is answered.
        protocol: aiohttp's end of it.
        opening: makes it, handshake and all.
    """

    origin: str
    owner: str
    due_s: float
    protocol: Any
    opening: asyncio.Task[None] | None = None

    def end(self) -> None:
        """Closes the connection at once."""
        if self.opening is not None and not self.opening.done():
            self.opening.cancel()
        elif self.protocol.transport is not None:
            self.protocol.transport.abort()

    @property
    def gone(self) -> bool:
        """Whether the connection was open and is closed."""
        opened = self.opening is not None and self.opening.done()
        return opened and self.protocol.transport is None


class WebListener:
    """The page's port, from accepting to closing; for the web server's thread.

    Args:
        listening: the listening socket, which does not block.
        make: makes aiohttp's end of a connection.
        tls: how to speak TLS; None: plain HTTP.
        say: takes a line for a person; must not wait.
    """

    def __init__(
        self,
        listening: socket.socket,
        make: Callable[[], Any],
        tls: ssl.SSLContext | None,
        say: Callable[[str], None],
    ) -> None:
        self.log = StrangerLog("page", say)
        self._listening, self._make, self._tls = listening, make, tls
        self._loop = asyncio.get_running_loop()
        self._strangers = PortPlaces[Visitor](
            strangers.places(UNVOUCHED_MAX), UNVOUCHED_PER_ADDRESS
        )
        self._vouched = PortPlaces[Visitor](strangers.places(VOUCHED_MAX), VOUCHED_PER_ADDRESS)
        self._all: dict[Any, Visitor] = {}
        self._rate = RateLimit(REQUESTS_HZ, REQUESTS_BURST)
        self._resume_s: float | None = None
        self._sweeping = asyncio.create_task(self._sweep_often())
        self._sweeping.add_done_callback(self._swept)
        self._loop.add_reader(listening, self._accept)

    async def close(self) -> None:
        """Accepts nothing any more, and ends all connections."""
        self._sweeping.cancel()
        self._loop.remove_reader(self._listening)
        self._listening.close()
        opening = [visitor.opening for visitor in self._all.values() if visitor.opening is not None]
        for visitor in list(self._all.values()):
            visitor.end()
        await asyncio.gather(self._sweeping, *opening, return_exceptions=True)

    # --- what happens to a connection

    def begin(self, request: web.Request) -> None:
        """A request has come whole: it takes the time that its answer needs."""
        visitor = self._all.get(request.protocol)
        if visitor is not None:
            visitor.due_s = float("inf")

    def end(self, request: web.Request) -> None:
        """A request is answered."""
        visitor = self._all.get(request.protocol)
        if visitor is not None:
            visitor.due_s = self._loop.time() + KEEP_ALIVE_S
            self._strangers.renew(visitor)
            self._vouched.renew(visitor)

    async def pace(self, request: web.Request, is_known: bool) -> None:
        """Waits where too many requests come."""
        owner = owner_of(request.remote or "") if is_known else None
        delay_s = self._rate.delay_s(owner, self._loop.time())
        if delay_s:
            await asyncio.sleep(delay_s)

    def vouch(self, request: web.Request) -> None:
        """The sender of a request may look at least: it is no stranger."""
        visitor = self._all.get(request.protocol)
        if visitor is not None and visitor in self._strangers:
            self._strangers.remove(visitor)
            self._make_way(self._vouched.add(visitor, visitor.owner))

    def seat(self, request: web.Request) -> None:
        """A request becomes a page, which counts among the pages only."""
        visitor = self._all.get(request.protocol)
        if visitor is not None:
            self._strangers.remove(visitor)
            self._vouched.remove(visitor)

    def refuse_token(self, request: web.Request) -> None:
        """Somebody has tried a token that is wrong."""
        self.log.note(request.remote or "somebody", WRONG_TOKEN, host_ns())

    def fault(self, origin: str, error: BaseException | None) -> None:
        """aiohttp could not make sense of what came, or answering it failed."""
        if error is None or type(error).__module__.startswith("aiohttp."):
            self.log.note(origin, NO_HTTP, host_ns())
        elif not isinstance(error, OSError):
            # A bug of ours: told by its place, as its text may be the stranger's.
            *_, frame = traceback.extract_tb(error.__traceback__) or [None]
            place = "" if frame is None else f" in {Path(frame.filename).name}:{frame.lineno}"
            self.log.note(origin, f"answering failed: {type(error).__name__}{place}", host_ns())

    # --- who comes

    def _accept(self) -> None:
        for _ in range(BATCH):
            try:
                sock, address = self._listening.accept()
            except (BlockingIOError, InterruptedError, ConnectionError):
                return
            except OSError as error:
                self.log.note("this machine", f"{NOT_ACCEPTED}: {error.strerror}", host_ns())
                self._loop.remove_reader(self._listening)
                self._resume_s = self._loop.time() + strangers.PAUSE_S
                return
            self._admit(sock, str(address[0]))

    def _admit(self, sock: socket.socket, origin: str) -> None:
        sock.setblocking(False)
        due_s = self._loop.time() + REQUEST_S
        visitor = Visitor(origin, owner_of(origin), due_s, self._make())
        self._make_way(self._strangers.add(visitor, visitor.owner))
        self._all[visitor.protocol] = visitor
        visitor.opening = self._loop.create_task(self._open(visitor, sock))

        def opened(_: asyncio.Task[None]) -> None:
            # Not in the task: one that is cancelled at once never begins.
            if visitor.protocol.transport is None:
                sock.close()

        visitor.opening.add_done_callback(opened)

    async def _open(self, visitor: Visitor, sock: socket.socket) -> None:
        limit_s = None if self._tls is None else REQUEST_S
        try:
            await self._loop.connect_accepted_socket(
                lambda: visitor.protocol, sock, ssl=self._tls, ssl_handshake_timeout=limit_s
            )
        except OSError:
            if self._tls is not None:
                self.log.note(visitor.origin, NO_TLS, host_ns())
            self._forget(visitor)

    def _make_way(self, loser: Visitor | None) -> None:
        if loser is None:
            return
        if not loser.gone:
            self.log.note(loser.origin, CROWDED, host_ns())
        loser.end()
        self._forget(loser)

    # --- who goes

    async def _sweep_often(self) -> None:
        while True:
            await asyncio.sleep(strangers.PAUSE_S if self._resume_s else SWEEP_S)
            now_s = self._loop.time()
            if self._resume_s is not None and now_s >= self._resume_s:
                self._resume_s = None
                self._loop.add_reader(self._listening, self._accept)
            try:
                self._sweep(now_s)
                self.log.tick(host_ns())
            except Exception as error:  # a bug in one connection must not end the limits of all
                self.fault("the page", error)

    def _swept(self, sweeping: asyncio.Task[None]) -> None:
        if not sweeping.cancelled():  # without it connections that bring nothing stay
            self.fault("the page", sweeping.exception())

    def _sweep(self, now_s: float) -> None:
        """Forgets who has gone, and closes what brings nothing."""
        for visitor in list(self._all.values()):
            if visitor.gone:
                self._forget(visitor)
            elif visitor.due_s <= now_s:
                if visitor in self._strangers and not self._is_familiar(visitor.owner):
                    self.log.note(visitor.origin, LATE, host_ns())
                visitor.end()
                self._forget(visitor)

    def _is_familiar(self, owner: str) -> bool:
        """Whether others of an address are no strangers: browsers connect before they ask."""
        visitors = (visitor for visitor in self._all.values() if visitor.owner == owner)
        return any(visitor not in self._strangers for visitor in visitors)

    def _forget(self, visitor: Visitor) -> None:
        self._all.pop(visitor.protocol, None)
        self._strangers.remove(visitor)
        self._vouched.remove(visitor)


LOOKERS_MAX = 0.75
"""Share of the pages' places that lookers may take: the others are for those who may control."""
LOOKERS_PER_ADDRESS = 0.5
"""And that lookers on one address may take."""


class PagePlaces:
    """The places of pages, of which there are `most`."""

    def __init__(self, most: int) -> None:
        self._most = strangers.places(most)
        self._lookers: Counter[str] = Counter()
        self._taken = 0

    @contextmanager
    def taken(self, request: web.Request, control: bool) -> Iterator[str]:
        """Takes a place for a page as long as it is open; gives why there is none, or ""."""
        owner = owner_of(request.remote or "")
        why = self._why_not(owner, control)
        if why:
            yield why
            return
        self._taken += 1
        self._lookers[owner] += not control
        try:
            yield ""
        finally:
            self._taken -= 1
            self._lookers[owner] -= not control
            self._lookers += Counter()  # forgets owners without a page

    def _why_not(self, owner: str, control: bool) -> str:
        lookers = max(1, int(self._most * LOOKERS_MAX))
        per_address = max(1, int(self._most * LOOKERS_PER_ADDRESS))
        if self._taken >= self._most:
            return f"{self._most} pages are open already: close one"
        if not control and self._lookers.total() >= lookers:
            return f"{lookers} pages that only look are open already: close one"
        if not control and self._lookers[owner] >= per_address:
            return f"{per_address} pages that only look are open on your address already: close one"
        return ""


class HttpLogger(logging.Logger):
    """What aiohttp logs of requests that it cannot read or answer, as one event each.

    `fault` takes the peer's address and the error.
    """

    def __init__(self, fault: Callable[[str, BaseException | None], None]) -> None:
        super().__init__("vsense page", logging.DEBUG)
        self._fault = fault

    def handle(self, record: logging.LogRecord) -> None:
        """Passes a record on; nothing is printed."""
        error = record.exc_info[1] if record.exc_info else None
        origin = record.args[0] if isinstance(record.args, tuple) and record.args else "somebody"
        self._fault(str(origin), error)
