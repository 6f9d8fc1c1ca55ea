"""Opens the page that `--web` asks for."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from vsense.hub import Hub
from vsense.orders import Give

if TYPE_CHECKING:
    from vsense.web.server import WebServer


def make_server(options: argparse.Namespace, hub: Hub, give: Give) -> WebServer:
    """Makes the page's server, which does not serve yet; see `open_web`.

    Raises:
        VsenseError: the library for it is missing, or the tokens cannot be read.
    """
    # Here and not above: whoever wants no page needs no library for it.
    from vsense.web.server import WebServer
    from vsense.web.tokens import read_tokens

    host, port = options.web
    tokens: Path | None = options.web_tokens
    return WebServer(hub, give, host, port, None if tokens is None else read_tokens(tokens))


def open_web(options: argparse.Namespace, hub: Hub, give: Give) -> tuple[WebServer, list[str]]:
    """Serves the page.

    Args:
        options: `web`, an address and a port, and `web_tokens`, a file or None.
        hub: what the page shows.
        give: what its buttons do.

    Returns:
        The server, which is the caller's to close, and what people shall be told.

    Raises:
        VsenseError: the library for it is missing, the port is taken, or the tokens cannot be read.
    """
    server = make_server(options, hub, give)
    found = server.start()
    lines = [f"control room: {found.control}"]
    if found.look != found.control:
        lines.append(f"control room, to look only: {found.look}")
    return server, lines
