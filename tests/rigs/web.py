"""Clients of a page's server: what they say and hear, and connections that stay unfinished."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import subprocess
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import aiohttp

from tests.conftest import require_tool
from vsense.monitor.ui.access import Tokens

TOKENS = Tokens("to-look-only", "to-control-it")
PATIENCE_S = 30.0
Talk = Callable[[aiohttp.ClientSession], Awaitable[Any]]
HALF = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-"
"""A request that does not end."""


def page_options(folder: Path) -> str:
    """Options of a page with a file for each: it has tokens, and a certificate of OpenSSL's."""
    tokens, pair = folder / "tokens", (folder / "page.pem", folder / "page-key.pem")
    tokens.write_text(f"look={TOKENS.look}\ncontrol={TOKENS.control}\n")
    tokens.chmod(0o600)
    make = "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj /CN=lab -days 1"
    words = [require_tool("openssl", "openssl"), *make.split(), "-out", pair[0], "-keyout", pair[1]]
    subprocess.run(words, check=True, capture_output=True)
    return f"--web 0 --web-tokens {tokens} --web-cert {pair[0]} --web-key {pair[1]}"


def talk(what: Talk) -> Any:
    """Runs a conversation with a client of its own, and gives what it gives."""

    async def run() -> Any:
        async with aiohttp.ClientSession() as client:
            return await asyncio.wait_for(what(client), PATIENCE_S)

    return asyncio.run(run())


async def ws(
    client: aiohttp.ClientSession, url: str, origin: str | None = "own", **options: Any
) -> aiohttp.ClientWebSocketResponse:
    """Opens the WebSocket as the page does."""
    base = url.split("/?")[0].rstrip("/")
    headers = options.pop("headers", {})
    if origin is not None:
        headers["Origin"] = base if origin == "own" else origin
    return await client.ws_connect(base + "/ws", headers=headers, max_msg_size=0, **options)


async def hear(socket: aiohttp.ClientWebSocketResponse, topic: str) -> Any:
    """Waits for the next message of a topic and gives its data."""
    while True:
        told = json.loads(await socket.receive_str())
        if told[0] == topic:
            return told[2]


def read_rest(sock: socket.socket) -> bytes:
    """All that comes until the other end closes."""
    found = b""
    with contextlib.suppress(ConnectionError):
        while data := sock.recv(65536):
            found += data
    return found


def is_closed(sock: socket.socket) -> bool:
    """Whether the other end has closed, as far as is known here."""
    sock.setblocking(False)
    try:
        while sock.recv(65536):
            pass
    except BlockingIOError:
        return False
    except ConnectionError:
        return True
    return True
