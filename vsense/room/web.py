"""Opens the page that `--web` asks for."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from vsense.errors import UsageError
from vsense.hub import Hub
from vsense.orders import Give

if TYPE_CHECKING:
    from vsense.web.server import WebServer


def open_web(options: argparse.Namespace, hub: Hub, give: Give) -> tuple[WebServer, list[str]]:
    """Serves the page.

    Args:
        options: `web`, an address and a port, and `web_tokens`, a file or None.
        hub: what the page shows.
        give: what its buttons do.

    Returns:
        The server, which is the caller's to close, and what people shall be told.

    Raises:
        UsageError: the library for it is missing.
        VsenseError: the port is taken, or the tokens cannot be read.
    """
    try:
        from vsense.web.server import WebServer
        from vsense.web.tokens import read_tokens
    except ImportError as error:
        raise UsageError(
            f"the page needs the library {error.name!r}: pip install 'vsense[web]'"
        ) from None
    host, port = options.web
    tokens: Path | None = options.web_tokens
    server = WebServer(hub, give, host, port, None if tokens is None else read_tokens(tokens))
    found = server.start()
    lines = [f"control room: {found.control}"]
    if found.look != found.control:
        lines.append(f"control room, to look only: {found.look}")
    return server, lines
