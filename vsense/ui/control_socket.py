"""The control socket: how a terminal finds the experiments that run on this machine.

Each process has one, in a folder that only this user can enter. One line of JSON asks, one line
answers: {"ask": "status"}, or {"order": "pause", "value": 0, "by": "terminal"}.
"""

from __future__ import annotations

import json
import math
import os
import socketserver
import stat
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from vsense.errors import VsenseError, failing_as
from vsense.run.orders import Give, Order, OrderKind

TRACKER = ".track"
"""In the name of a tracker's socket, behind the process number: nothing there moves a robot."""

TIMEOUT_S = 5.0
"""A terminal that says nothing for this long is disconnected."""

MOST_BYTES = 4096


class ControlSocketError(VsenseError):
    """The socket cannot be made, or does not answer."""


def folder() -> Path:
    """The folder of all sockets of this user; made where it is missing.

    ControlSocketError if it cannot be made, or belongs to another user.
    """
    base = os.environ.get("XDG_RUNTIME_DIR")
    place = Path(base) / "vsense" if base else Path(tempfile.gettempdir()) / f"vsense-{os.getuid()}"
    with failing_as(ControlSocketError, str(place)):
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = place.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise ControlSocketError(f"{place}: others may enter it: remove it, and start again")
    return place


class ControlSocket:
    """Answers terminals, on threads of its own, until `close`, which removes the socket.

    `status` and `give` are called by any thread. ControlSocketError if there can be no socket.
    """

    def __init__(self, status: Callable[[], dict[str, Any]], give: Give, kind: str = "") -> None:
        self._status = status
        self._give = give
        self.path = folder() / f"{os.getpid()}{kind}.sock"
        control = self

        class Handler(socketserver.StreamRequestHandler):
            timeout = TIMEOUT_S

            def handle(self) -> None:
                # A terminal that hangs up in the middle wants no answer.
                with suppress(OSError):
                    line = self.rfile.readline(MOST_BYTES)
                    self.wfile.write(json.dumps(control.answer(line)).encode() + b"\n")

        with suppress(FileNotFoundError):
            self.path.unlink()  # of an earlier process with our number
        try:
            self._server = socketserver.ThreadingUnixStreamServer(str(self.path), Handler)
        except OSError as error:
            raise ControlSocketError(f"{self.path}: {error.strerror or error}") from None
        self._server.daemon_threads = True
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.1,), name="vsense-control", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Removes the socket."""
        self._server.shutdown()
        self._server.server_close()
        with suppress(FileNotFoundError):
            self.path.unlink()

    def answer(self, line: bytes) -> dict[str, Any]:
        """Answers one line; {"error": reason} where it cannot."""
        try:
            asked = json.loads(line)
            if asked.get("ask") == "status":
                return self._status()
            value = float(asked.get("value", 0))
            if not math.isfinite(value):
                raise ValueError
            order = Order(OrderKind(asked["order"]), str(asked.get("by", "terminal")), value)
            return {"text": self._give(order)}
        except VsenseError as error:
            return {"error": str(error)}
        except (ValueError, KeyError, AttributeError, TypeError, OverflowError, RecursionError):
            return {"error": f"{line[:80]!r} is neither a question nor an order"}
