"""The control socket: how a terminal finds the experiments that run on this machine.

Each process has one, in a folder that only this user can enter, or in the lab's, where its group's
members find each other's (`vsense.base.sharing`). One line of JSON asks, one line answers:
{"ask": "status"}, {"order": "pause", "value": 0, "by": "terminal"}, or {"ask": "handover",
"force": false}. Who asks, the system says: an order is "anna (terminal)"'s.
"""

from __future__ import annotations

import errno
import json
import math
import os
import socket
import socketserver
import stat
import struct
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from vsense.base import sharing
from vsense.base.errors import VsenseError, failing_as
from vsense.base.files import cache_folder
from vsense.base.terminal import printable
from vsense.run.orders import Give, Order, OrderError, OrderKind, read_pair

TRACKER_SUFFIX = ".track"
"""In the name of a tracker's socket, behind the process number: nothing there moves a robot."""

TERMINAL_TIMEOUT_S = 5.0
"""A terminal that says nothing for this long is disconnected."""

MOST_SENTENCE_BYTES = 4096

BY_MAX = 40
"""Characters of what a program says that it is."""

_PEER = struct.Struct("3i")
"""What SO_PEERCRED tells: pid, uid, gid. Source: Linux, unix(7)."""

HandOver = Callable[[str, bool], str]
"""Ends the process in order, so that its robots are free: who asks, and whether a run that is going
on ends, too. Gives a line for people; OrderError where it is not done."""


class ControlSocketError(VsenseError):
    """The socket cannot be made, or does not answer."""


def folder() -> Path:
    """The folder of all sockets that are this user's alone; made where it is missing.

    ControlSocketError if it cannot be made, or belongs to another user.
    """
    place = _place()
    with failing_as(ControlSocketError, str(place)):
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = place.lstat()
    if status.st_uid != os.getuid():  # as where HOME is still that of who has called sudo
        words = "it is another account's: set XDG_RUNTIME_DIR to a folder of yours"
        raise ControlSocketError(f"{place}: {words}")
    if not stat.S_ISDIR(status.st_mode) or status.st_mode & 0o077:
        raise ControlSocketError(f"{place}: others may enter it: remove it, and start again")
    return place


def _place() -> Path:
    """Where only this user can have made a folder: what anybody may write in keeps nobody out."""
    base, session = os.environ.get("XDG_RUNTIME_DIR"), f"/run/user/{os.getuid()}"
    with suppress(OSError):  # where nobody has logged in there is none
        base = base or (session if os.lstat(session).st_uid == os.getuid() else None)
    if base:
        return Path(base) / "vsense"
    cache = cache_folder()
    if cache is None:
        words = "no home directory for the sockets of runs: set XDG_RUNTIME_DIR to a folder"
        raise ControlSocketError(words)
    # Several machines may have one home.
    return cache / f"run-{socket.gethostname()}"


def folders() -> tuple[list[Path], list[str]]:
    """Where runs are found that this account may steer: its own folder, and the lab's.

    Gives also why one of them cannot be used: a stop of the other's runs shall not fail by it.
    """
    reason, shared = _shared()
    reasons = [reason] if reason else []
    paths = [] if shared is None else [shared]
    try:
        paths.insert(0, folder())
    except ControlSocketError as error:
        reasons.insert(0, str(error))
    return paths, reasons


def _shared() -> tuple[str, Path | None]:
    """The lab's folder, None: there is none; and why it cannot be used, "": it can."""
    try:
        lab = sharing.lab()
    except sharing.SharingError as error:
        return str(error), None
    return "", None if lab is None else lab.path


def refuse_handover(by: str, force: bool) -> str:
    """What holds no robots answers to whom wants them."""
    raise OrderError("no robot is held here")


class ControlSocket:
    """Answers terminals, on threads of its own, until `close`, which removes the socket.

    Attributes:
        alone: why the lab's members cannot steer this run, although there is a lab; "": they can.
    """

    def __init__(
        self,
        status: Callable[[], dict[str, Any]],
        give: Give,
        kind: str = "",
        hand_over: HandOver = refuse_handover,
    ) -> None:
        """All three are called by any thread. ControlSocketError if there can be no socket."""
        self._status, self._give, self._hand_over = status, give, hand_over
        self.alone, shared = _shared()
        self.path = (shared or folder()) / f"{os.getpid()}{kind}.sock"
        self._server = self._open(sharing.WRITE_MODE if shared else 0o600)
        self._server.daemon_threads = True
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.1,), name="vsense-control", daemon=True
        )
        self._thread.start()

    def _open(self, mode: int) -> socketserver.ThreadingUnixStreamServer:
        control = self

        class Handler(socketserver.StreamRequestHandler):
            timeout = TERMINAL_TIMEOUT_S

            def handle(self) -> None:
                # A terminal that hangs up in the middle wants no answer.
                with suppress(OSError):
                    line = self.rfile.readline(MOST_SENTENCE_BYTES)
                    uid = _uid_of(self.request)
                    self.wfile.write(json.dumps(control.answer(line, uid)).encode() + b"\n")

        # It has its name when it listens: who finds one that does not takes it for a dead one's.
        unnamed = self.path.with_suffix(".new")
        try:
            unnamed.unlink(missing_ok=True)  # of an earlier process with our number
            server = socketserver.ThreadingUnixStreamServer(str(unnamed), Handler)
            _set_mode(unnamed, mode)
            os.replace(unnamed, self.path)
        except OSError as error:
            raise ControlSocketError(f"{self.path}: {error.strerror or error}") from None
        return server

    def close(self) -> None:
        """Removes the socket."""
        self._server.shutdown()
        self._server.server_close()
        with suppress(FileNotFoundError):
            self.path.unlink()

    def answer(self, line: bytes, uid: int | None = None) -> dict[str, Any]:
        """Answers one line of an account's; {"error": reason} where it cannot.

        What somebody else's run answers to an order says whose it is: {"user": name}.
        """
        try:
            asked = json.loads(line)
            if asked.get("ask") == "status":
                return {**self._status(), "user": sharing.user_name()}
            who = sharing.user_name(uid)
            by = f"{who} ({printable(str(asked.get('by', 'terminal')))[:BY_MAX]})"
            if asked.get("ask") == "handover":
                said = self._hand_over(by, asked.get("force") is True)
            else:
                said = self._give(_order(asked, by))
            is_other_user = uid not in (None, os.getuid())
            return {"text": said, **({"user": sharing.user_name()} if is_other_user else {})}
        except VsenseError as error:
            return {"error": str(error)}
        except (ValueError, KeyError, AttributeError, TypeError, OverflowError, RecursionError):
            return {"error": f"{line[:80]!r} is neither a question nor an order"}


def _order(asked: dict[str, Any], by: str) -> Order:
    """The order that a line gives; ValueError or KeyError where it gives none."""
    value = float(asked.get("value", 0))
    if not math.isfinite(value):
        raise ValueError
    return Order(OrderKind(asked["order"]), by, value, read_pair(asked.get("pair", [0, 0])))


def _set_mode(path: Path, mode: int) -> None:
    """Of a socket of ours: a member who puts a link in its place opens none of our files."""
    opened = os.open(path, os.O_PATH | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        status = os.fstat(opened)
        if not stat.S_ISSOCK(status.st_mode) or status.st_uid != os.getuid():
            raise OSError(errno.EPERM, "is not the socket that was just made")
        os.chmod(f"/proc/self/fd/{opened}", mode)
    finally:
        os.close(opened)


def _uid_of(line: socket.socket) -> int:
    """Which account is at the other end."""
    credentials = line.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
    return int(_PEER.unpack(credentials)[1])
