"""The web server: a thread of its own beside the run, which never waits for it.

`Site` has the addresses, and what every answer carries for safety.
"""

from __future__ import annotations

import asyncio
import html
import os
import re
import socket
import ssl
import threading
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path

from aiohttp import web

from vsense.base.clock import host_ns
from vsense.base.errors import UsageError, VsenseError
from vsense.base.message_bus import MessageBus
from vsense.monitor.ui._page_clients import WebClients
from vsense.monitor.ui._web_listener import HttpLogger, PagePlaces, WebListener
from vsense.monitor.ui.access import (
    AccessControl,
    Forbidden,
    Rights,
    Tokens,
    is_loopback,
    make_tokens,
    own_address,
)
from vsense.robots.link.network import listen
from vsense.robots.link.status import LinkError
from vsense.run.changes import Ask
from vsense.run.orders import Give

PAGE_FOLDER = Path(__file__).parent / "page"
VIEWERS_MAX = 64
"""Open at once: a browser that opens pages in a loop must not use up the machine."""
_FILE = re.compile(r"[a-z0-9_]+\.(?:js|css|svg)")
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; img-src 'self' data: blob:; frame-ancestors 'none'; "
        "base-uri 'none'; form-action 'self'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}

RequestHandler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Site:
    """The page, its files and its WebSocket; the parameters are those of `WebServer`."""

    def __init__(
        self,
        bus: MessageBus,
        give: Give,
        host: str,
        port: int,
        tokens: Tokens | None,
        tls: ssl.SSLContext | None,
        ask: Ask | None,
    ) -> None:
        self._access = AccessControl(host, port, tokens, tls is not None)
        self._tls = tls
        self.clients = WebClients(bus, give, ask)
        self._places = PagePlaces(VIEWERS_MAX)
        self._listener: WebListener
        self._runner: web.AppRunner
        self._app = web.Application(middlewares=[self._guard], client_max_size=4096)
        self._app.router.add_get("/", self._page)
        self._app.router.add_get("/screen", self._page)
        self._app.router.add_get("/ws", self._socket)
        self._app.router.add_get("/arena.argos", self._arena)
        self._app.router.add_get("/{name}", self._file)
        self._app.on_response_prepare.append(_protect)

    async def open(self, listening: socket.socket, say: Callable[[str], None]) -> None:
        """Begins to serve on a listening socket; `say` takes what strangers do."""
        self._runner = web.AppRunner(
            *(self._app,), access_log=None, shutdown_timeout=1.0, logger=HttpLogger(self._fault)
        )
        await self._runner.setup()
        assert self._runner.server is not None
        self._listener = WebListener(listening, self._runner.server, self._tls, say)
        asyncio.get_running_loop().set_exception_handler(
            lambda _, context: self._fault("the page", context.get("exception"))
        )

    async def close(self) -> None:
        """Closes the pages, and then everything."""
        await _in_time(self.clients.close)
        await _in_time(self._listener.close)
        await _in_time(self._runner.cleanup)

    def _fault(self, origin: str, error: BaseException | None) -> None:
        self._listener.fault(origin, error)

    @web.middleware
    async def _guard(self, request: web.Request, handler: RequestHandler) -> web.StreamResponse:
        """Refuses requests from elsewhere before anything else."""
        self._listener.begin(request)
        try:
            is_known = self._rights(request) is not Rights.NONE
            await self._listener.pace(request, is_known)
            self._access.check_host(request.headers)
            self._access.check_origin(request.headers, needed=request.path == "/ws")
            if is_known:
                self._listener.vouch(request)
            return await handler(request)
        except Forbidden as reason:
            return _refusal(str(reason))
        except ConnectionError:
            # It went before it got an answer: this one is not read either.
            return web.Response(status=400)
        finally:
            self._listener.end(request)

    def _rights(self, request: web.Request) -> Rights:
        return self._access.rights(request.query.get("token"), request.cookies)

    async def _page(self, request: web.Request) -> web.StreamResponse:
        if self._rights(request) is Rights.NONE:
            given = "token" in request.query
            if given:
                self._listener.refuse_token(request)
            return _refusal(
                "this token is not the right one" if given else "this page needs a token", True
            )
        file = PAGE_FOLDER / ("screen.html" if request.path == "/screen" else "index.html")
        answer = web.Response(body=file.read_bytes(), content_type="text/html")
        answer.charset = "utf-8"
        token = request.query.get("token")
        if token is not None and self._access.tokens is not None:
            # Not by a redirect: browsers would not send the strict cookie along with one that
            # began on another site, such as a chat with the address in it.
            answer.set_cookie(
                *(self._access.cookie, token),
                httponly=True,
                samesite="Strict",
                secure=self._tls is not None,
            )
        return answer

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        rights = self._rights(request)
        if rights is Rights.NONE:
            return _refusal("this page needs a token", True)
        assert request.transport is not None
        peer, server = (request.transport.get_extra_info(n)[:2] for n in ("peername", "sockname"))
        self._access.check_account(peer, server)
        with self._places.taken(request, rights is Rights.CONTROL) as full:
            if full:
                return _refusal(full, status=503)
            self._listener.seat(request)
            return await self.clients.serve(request, rights)

    async def _arena(self, request: web.Request) -> web.StreamResponse:
        """The experiment's file with the changes of the present run, to be saved."""
        if self._rights(request) is Rights.NONE:
            return _refusal("this page needs a token", True)
        file = self.clients.arena_file
        name = re.sub(r"[^\w.-]", "_", file.name) or "arena"
        text = await asyncio.to_thread(file.edited)  # of a recording, which may be long
        answer = web.Response(text=text, content_type="text/xml")
        answer.headers["Content-Disposition"] = f'attachment; filename="{name}-changed.argos"'
        return answer

    async def _file(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        path = PAGE_FOLDER / name
        if _FILE.fullmatch(name) is None or not os.path.isfile(path):
            return _refusal(f"there is no '{name:.80}' here", status=404)
        answer = web.Response(body=path.read_bytes(), content_type=_TYPES[path.suffix])
        answer.charset = "utf-8"
        return answer


async def _protect(request: web.Request, response: web.StreamResponse) -> None:
    """Adds the headers of every answer."""
    response.headers.update(_HEADERS)


def _refusal(reason: str, token: bool = False, status: int = 403) -> web.Response:
    """A page that says why not, with a form for a token where one would help."""
    form = (PAGE_FOLDER / "token_form.html").read_text(encoding="utf-8") if token else ""
    page = (PAGE_FOLDER / "refusal.html").read_text(encoding="utf-8")
    words = html.escape(reason[:1].upper() + reason[1:])
    text = page.replace("{reason}", words).replace("{form}", form)
    return web.Response(text=text, status=status, content_type="text/html")


CLOSING_S = 5.0
"""The thread ends within this time, whatever the pages do."""


@dataclass(frozen=True, slots=True)
class Addresses:
    """What to open in a browser: to look only, and to control."""

    look: str
    control: str


class WebServer:
    """Serves the page and its WebSocket. Its methods are for one thread, not its own.

    Args:
        bus: where messages come from.
        give: carries orders out.
        host: address to listen on.
        port: port to listen on; 0 takes any free one. Nothing is opened before `start`.
        tokens: what viewers must show. Without, all on this machine may control; on an address
            that others reach two are drawn, see `start`.
        say: takes a line about strangers, from the server's thread; must not wait. By default it
            is an event on the bus.
        tls: how to speak HTTPS; None: plain HTTP.
        ask: takes changes of the world; None: there can be none.

    Raises:
        UsageError: the port is none.
    """

    def __init__(
        self,
        bus: MessageBus,
        give: Give,
        host: str,
        port: int,
        tokens: Tokens | None = None,
        say: Callable[[str], None] | None = None,
        tls: ssl.SSLContext | None = None,
        ask: Ask | None = None,
    ) -> None:
        if not 0 <= port <= 65535:
            raise UsageError(f"web port {port}: expected a number from 0 to 65535")
        self._bus = bus
        self._give = give
        self._host = host
        self._say = say or (lambda text: bus.event(text, "warning", host_ns()))
        self._tls, self._ask = tls, ask
        self.port = port
        self.tokens = make_tokens() if tokens is None and not is_loopback(host) else tokens
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ending: asyncio.Event | None = None
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None

    def start(self) -> Addresses:
        """Takes the port and begins to serve; gives what to open, with tokens where needed.

        VsenseError if the port cannot be had; the text says what to do.
        """
        try:
            listening, self.port = listen(self._host, self.port)
        except LinkError as error:
            raise VsenseError(f"web page: {error}") from error
        ready = threading.Event()
        self._thread = threading.Thread(
            target=self._run, args=(listening, ready), name="web", daemon=True
        )
        self._thread.start()
        ready.wait()
        if self._failure is not None:
            self._thread = None
            raise VsenseError(f"the page cannot be served: {self._failure!r}")
        return self._addresses()

    def close(self) -> None:
        """Closes the pages and ends the thread; can be called again."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        assert self._loop is not None and self._ending is not None
        if thread.is_alive():
            self._loop.call_soon_threadsafe(self._ending.set)
        thread.join(CLOSING_S)

    def _addresses(self) -> Addresses:
        host = self._host
        if host in ("0.0.0.0", "::", ""):
            host = own_address()
        scheme = "http" if self._tls is None else "https"
        url = f"{scheme}://{f'[{host}]' if ':' in host else host}:{self.port}/"
        if self.tokens is None:
            return Addresses(url, url)
        return Addresses(f"{url}?token={self.tokens.look}", f"{url}?token={self.tokens.control}")

    def _run(self, listening: socket.socket, ready: threading.Event) -> None:
        """The thread: a page that fails is told, and the run goes on without it."""
        try:
            asyncio.run(self._serve(listening, ready))
        except Exception as failure:
            self._failure = failure
            if ready.is_set():
                self._say(f"the page has failed, the run goes on without it: {failure!r}")
        finally:
            ready.set()  # `start` must not wait for ever

    async def _serve(self, listening: socket.socket, ready: threading.Event) -> None:
        self._loop = asyncio.get_running_loop()
        self._ending = asyncio.Event()
        site = Site(
            *(self._bus, self._give, self._host, self.port, self.tokens, self._tls, self._ask)
        )
        await site.open(listening, self._say)
        try:
            ready.set()
            await self._ending.wait()
        finally:
            await site.close()


async def _in_time(close: Callable[[], Awaitable[None]]) -> None:
    try:
        await asyncio.wait_for(close(), CLOSING_S / 2.5)
    except asyncio.TimeoutError:
        return
