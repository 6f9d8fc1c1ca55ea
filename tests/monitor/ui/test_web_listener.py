"""What strangers can do to the page's port: real sockets, real requests, and what is told of it."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import re
import resource
import socket
import time
import urllib.request
from collections.abc import Callable, Iterator

import aiohttp
import pytest

from tests.monitor.ui.puppet import Puppet
from tests.rigs.web import HALF, TOKENS, hear, is_closed, read_rest, talk, ws
from vsense.base.message_bus import MessageBus
from vsense.monitor.ui import _server as site
from vsense.monitor.ui import _web_listener
from vsense.monitor.ui._page_clients import WebClients
from vsense.monitor.ui._server import WebServer
from vsense.run.orders import Order

PATIENCE_S = 30.0


class Port:
    """A page with tokens, and sockets to it."""

    def __init__(self) -> None:
        self.puppet = Puppet()
        self.told: list[str] = []
        tell = self.told.append
        self.server = WebServer(self.puppet.bus, self.puppet.give, "127.0.0.1", 0, TOKENS, say=tell)
        self.url = self.server.start().control
        self.opened: list[socket.socket] = []

    def connect(self, sent: bytes = b"", source: str = "127.0.0.1") -> socket.socket:
        sock = socket.socket()
        self.opened.append(sock)
        sock.settimeout(PATIENCE_S)
        sock.bind((source, 0))
        sock.connect(("127.0.0.1", self.server.port))
        if sent:
            sock.sendall(sent)
        return sock

    def request(self, token: str = TOKENS.control) -> bytes:
        head = f"GET /?token={token} HTTP/1.1\r\nHost: 127.0.0.1:{self.server.port}\r\n\r\n"
        return head.encode()

    def answers(self) -> bool:
        with urllib.request.urlopen(self.url, timeout=PATIENCE_S) as answer:
            return bool(answer.status == 200)

    def wait(self, condition: Callable[[], bool]) -> None:
        until_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < until_s, self.told
            time.sleep(0.01)


@pytest.fixture
def port() -> Iterator[Port]:
    one = Port()
    yield one
    for sock in one.opened:
        sock.close()
    one.server.close()
    one.puppet.end()


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_web_listener, "REQUEST_S", 0.6)
    monkeypatch.setattr(_web_listener, "KEEP_ALIVE_S", 0.6)


@pytest.mark.parametrize("sent", [b"", HALF, b"\r\n" * 20, b"GET"])
def test_no_whole_request_in_time(port: Port, hasty: None, sent: bytes) -> None:
    assert read_rest(port.connect(sent)) == b""
    assert port.told == ["page: 127.0.0.1: no whole request in time"]


def test_one_byte_at_a_time_wins_no_time(port: Port, hasty: None) -> None:
    sock, begun_s = port.connect(), time.monotonic()
    with pytest.raises(ConnectionError):
        for byte in HALF * 1000:
            sock.send(bytes([byte]))
            time.sleep(0.05)
    assert time.monotonic() - begun_s < PATIENCE_S / 2


def test_a_connection_is_kept_for_a_while_only(port: Port, hasty: None) -> None:
    sock = port.connect(port.request())
    assert read_rest(sock).startswith(b"HTTP/1.1 200")
    assert port.told == [], "a browser does so"


def test_a_body_that_never_comes(port: Port, hasty: None) -> None:
    head = port.request().replace(b"GET", b"POST").replace(b"\r\n\r\n", b"\r\n")
    sock = port.connect(head + b"Content-Length: 4000\r\n\r\nabc")
    assert read_rest(sock).startswith(b"HTTP/1.1 405")


def test_a_flood_from_one_address_ends_itself(port: Port) -> None:
    flood = [port.connect((b"", HALF)[n % 2]) for n in range(300)]
    assert port.answers()
    open_now = sum(not is_closed(sock) for sock in flood)
    assert open_now <= _web_listener.UNVOUCHED_PER_ADDRESS
    assert port.told == ["page: 127.0.0.1: too many connections at once"]


def test_a_flood_from_many_addresses(port: Port) -> None:
    flood = [port.connect(b"", f"127.0.{n % 4}.{2 + n // 4}") for n in range(400)]
    assert port.answers()
    assert sum(not is_closed(sock) for sock in flood) <= _web_listener.UNVOUCHED_MAX
    assert len(port.told) == 1


def test_who_has_shown_a_token_is_not_thrown_out_by_strangers(port: Port) -> None:
    known = port.connect(port.request())
    known.recv(65536)
    for _ in range(200):
        port.connect()
    assert port.answers()
    known.sendall(port.request())
    assert known.recv(12) == b"HTTP/1.1 200"


@pytest.mark.parametrize(
    "sent",
    [
        b"\x16\x03\x01\x02\x00\x01\x00", b"GET / HTTP/9.9\r\nHost:\r\n\r\n", b"\0" * 100 + b"\r\n",
        b"GET /\x01 HTTP/1.1\r\nHost: x\r\n\r\n", b"GET / HTTP/1.1\r\nHost: x\r\n a\r\nb\r\n\r\n",
        b"GET / HTTP/1.1\r\nContent-Length: x\r\n\r\n", b"GET / HTTP/1.1\r\nA: " + b"a" * 70_000,
        b"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\nContent-Length: 3\r\n\r\nzzz\r\n",
    ],
)  # fmt: skip
def test_what_is_not_http_is_answered_and_not_printed(
    port: Port, capfd: pytest.CaptureFixture[str], sent: bytes
) -> None:
    for _ in range(20):
        # One that the server closes at once may be gone before all is written.
        with contextlib.suppress(ConnectionError):
            assert read_rest(port.connect(sent)).startswith(b"HTTP/1.0 400") or sent[:1] == b"\x16"
    assert port.answers()
    assert port.told == ["page: 127.0.0.1: not HTTP"]
    assert capfd.readouterr() == ("", "")


def test_a_wrong_token_is_told(port: Port) -> None:
    assert port.connect(port.request("guess")).recv(12) == b"HTTP/1.1 403"
    assert port.told == ["page: 127.0.0.1: a wrong token"]


def test_requests_one_after_another_in_one_packet(port: Port) -> None:
    sock = port.connect(port.request() * 200)
    found = b""
    while found.count(b"HTTP/1.1 200") < 200:
        found += sock.recv(65536)


@pytest.mark.parametrize("fails", [errno.EMFILE, errno.ENFILE, errno.ENOBUFS])
def test_without_descriptors_it_waits_and_goes_on(
    port: Port, monkeypatch: pytest.MonkeyPatch, fails: int
) -> None:
    tries = 0

    class Listening(socket.socket):
        def accept(self) -> tuple[socket.socket, tuple[str, int]]:
            nonlocal tries
            tries += 1
            if tries <= 3:
                raise OSError(fails, os.strerror(fails))
            return super().accept()

    with Listening() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        listening.setblocking(False)
        number = listening.getsockname()[1]
        told: list[str] = []
        monkeypatch.setattr(site, "listen", lambda host, port: (listening, number))
        puppet = Puppet()
        server = WebServer(puppet.bus, puppet.give, "127.0.0.1", 0, TOKENS, say=told.append)
        try:
            with urllib.request.urlopen(server.start().control, timeout=PATIENCE_S) as answer:
                assert answer.status == 200
        finally:
            server.close()
            puppet.end()
    assert tries == 5, "three that fail, the request, and nobody more"
    assert told == [f"page: this machine: cannot accept a connection: {os.strerror(fails)}"]


def test_places_shrink_where_descriptors_are_few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda which: (300, 300))
    one = Port()
    try:
        flood = [one.connect() for _ in range(100)]
        assert one.answers()
        assert sum(not is_closed(sock) for sock in flood) <= 26
    finally:
        for sock in one.opened:
            sock.close()
        one.server.close()
        one.puppet.end()


# -- pages ----------------------------------------------------------------------------------


def test_lookers_leave_places_for_those_who_control(port: Port) -> None:
    look = {"Cookie": f"vsense_{port.server.port}={TOKENS.look}"}
    control = {"Cookie": f"vsense_{port.server.port}={TOKENS.control}"}

    async def come(client: aiohttp.ClientSession) -> int:
        pages = []
        with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
            while len(pages) < site.VIEWERS_MAX:
                pages.append(await ws(client, port.url, headers=look))
        assert caught.value.status == 503
        lookers = len(pages)
        for _ in range(8):
            pages.append(await ws(client, port.url, headers=control))
            await pages[-1].send_json({"order": "emergency"})
            assert (await hear(pages[-1], "/answer"))["ok"]
        return lookers

    assert talk(come) == site.VIEWERS_MAX // 2, "so many on one address"


def test_a_page_that_is_closed_gives_its_place_back(
    port: Port, monkeypatch: pytest.MonkeyPatch
) -> None:
    control = {"Cookie": f"vsense_{port.server.port}={TOKENS.control}"}

    async def come(client: aiohttp.ClientSession) -> None:
        for _ in range(site.VIEWERS_MAX + 10):
            page = await ws(client, port.url, headers=control)
            await hear(page, "/you")
            await page.close()

    talk(come)


def test_pages_stay_open_longer_than_any_request(port: Port, hasty: None) -> None:
    control = {"Cookie": f"vsense_{port.server.port}={TOKENS.control}"}

    async def come(client: aiohttp.ClientSession) -> None:
        page = await ws(client, port.url, headers=control)
        await asyncio.sleep(2.0)
        await page.send_json({"order": "start"})
        assert (await hear(page, "/answer"))["ok"]

    talk(come)


def test_a_page_whose_order_fails_is_told_and_closed_and_the_next_is_heard(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where ending what it is sent is heard late, as by `wait_for` before Python 3.12."""

    async def deaf_once(*_: object) -> None:
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.sleep(60.0)
        await asyncio.sleep(60.0)

    def fail(order: Order) -> str:
        raise RuntimeError("a bug")

    async def press(client: aiohttp.ClientSession) -> aiohttp.WSMsgType:
        socket = await ws(client, f"http://127.0.0.1:{server.port}/")
        await socket.send_json({"order": "emergency", "value": 0})
        return (await socket.receive(20.0)).type

    monkeypatch.setattr(WebClients, "_send", deaf_once)
    said: list[str] = []
    server = WebServer(MessageBus(), fail, "127.0.0.1", 0, say=said.append)
    try:
        server.start()
        ends = {aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.ERROR}
        assert {talk(press), talk(press)} <= ends
    finally:
        server.close()
    assert re.search(r"answering failed: RuntimeError in test_web_listener\.py", said[0])
