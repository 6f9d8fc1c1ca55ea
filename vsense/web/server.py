"""The web server: a thread of its own beside the run, which never waits for it."""

from __future__ import annotations

import asyncio
import errno
import socket
import threading
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from vsense.errors import UsageError, VsenseError
from vsense.hub import Hub
from vsense.orders import Give
from vsense.web.gate import is_loopback
from vsense.web.tokens import Tokens, make_tokens

try:
    from aiohttp import web

    from vsense.web.site import Site
except ImportError as error:
    if not (error.name or "").startswith("aiohttp"):
        raise
    raise VsenseError("the web page needs aiohttp: pip install 'vsense[web]'") from error

CLOSING_S = 5.0
"""The thread ends within this time, whatever the pages do."""
_REASONS = {
    errno.EADDRINUSE: "is in use: another program serves there; stop it or choose another port",
    errno.EADDRNOTAVAIL: "is not on an address of this machine: choose one that it has",
    errno.EACCES: "needs privileges: choose a port from 1024 on",
}


@dataclass(frozen=True, slots=True)
class Addresses:
    """What a person types into a browser.

    Attributes:
        look: for those who only look.
        control: for those who press buttons.
    """

    look: str
    control: str


class WebServer:
    """Serves the page and its WebSocket. Its methods are for one thread, not its own."""

    def __init__(
        self, hub: Hub, give: Give, host: str, port: int, tokens: Tokens | None = None
    ) -> None:
        """Prepares it; nothing is opened yet.

        Args:
            hub: where news comes from.
            give: carries orders out.
            host: address to listen on.
            port: port to listen on; 0 takes any free one.
            tokens: what viewers must show. Without, everybody on this machine may control, and
                on any address that others reach two are drawn: see `start`.
        """
        if not 0 <= port <= 65535:
            raise UsageError(f"web port {port}: expected a number from 0 to 65535")
        self._hub = hub
        self._give = give
        self._host = host
        self.port = port
        self.tokens = make_tokens() if tokens is None and not is_loopback(host) else tokens
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ending: asyncio.Event | None = None
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None

    def start(self) -> Addresses:
        """Takes the port and begins to serve.

        Returns:
            What to open; with tokens in it where they are needed.

        Raises:
            VsenseError: the port cannot be had; the text says what to do.
        """
        listening = _listen(self._host, self.port)
        self.port = listening.getsockname()[1]
        ready = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve(listening, ready)), name="web", daemon=True
        )
        self._thread.start()
        ready.wait()
        if self._failure is not None:
            raise VsenseError(f"the page cannot be served: {self._failure!r}")
        return self._addresses()

    def close(self) -> None:
        """Sends the pages away and ends the thread; more than once is fine."""
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
            host = _own_address()
        url = f"http://{f'[{host}]' if ':' in host else host}:{self.port}/"
        if self.tokens is None:
            return Addresses(url, url)
        return Addresses(f"{url}?token={self.tokens.look}", f"{url}?token={self.tokens.control}")

    async def _serve(self, listening: socket.socket, ready: threading.Event) -> None:
        """The thread's life."""
        self._loop = asyncio.get_running_loop()
        self._ending = asyncio.Event()
        try:
            site = Site(self._hub, self._give, self._host, self.port, self.tokens)
            runner = web.AppRunner(site.app, access_log=None, shutdown_timeout=1.0)
            await runner.setup()
            await web.SockSite(runner, listening).start()
        except BaseException as failure:
            # Whoever waits for a server that could not begin must not wait for ever.
            self._failure = failure
            ready.set()
            raise
        try:
            ready.set()
            await self._ending.wait()
        finally:
            await _in_time(site.close)
            await _in_time(runner.cleanup)


async def _in_time(close: Callable[[], Awaitable[None]]) -> None:
    try:
        await asyncio.wait_for(close(), CLOSING_S / 2.5)
    except asyncio.TimeoutError:
        return


def _listen(host: str, port: int) -> socket.socket:
    """Takes a port.

    Raises:
        VsenseError: it cannot be had.
    """
    try:
        found = socket.getaddrinfo(
            host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
    except (OSError, UnicodeError) as error:
        text = getattr(error, "strerror", None) or "not a host name"
        raise VsenseError(f"web page: cannot listen on '{host}': {text}") from error
    family, _, _, _, address = found[0]
    opened = socket.socket(family, socket.SOCK_STREAM)
    try:
        # A restarted server may pass the old one's connections that are still closing.
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind(address)
        opened.listen()
        opened.setblocking(False)
    except OSError as error:
        opened.close()
        reason = _REASONS.get(error.errno or 0, f"cannot be used: {error.strerror}")
        raise VsenseError(f"web page: port {port} of {host} {reason}") from error
    return opened


def _own_address() -> str:
    """The address that other machines see this one by; nothing is sent to find it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()
