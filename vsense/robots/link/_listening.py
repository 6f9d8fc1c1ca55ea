"""A thread that serves one TCP port: the base of the servers of the original system's protocols.

Clients may be slow, stuck or gone. The thread waits in one selector; any other thread may write to
a client at once and leave what the kernel does not take to this one.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
from collections.abc import Callable
from typing import Any, Protocol

from vsense.robots.link import strangers
from vsense.robots.link._shared import Waker
from vsense.robots.link._streams import prepare
from vsense.robots.link.network import listen
from vsense.robots.link.status import LinkError
from vsense.robots.link.strangers import StrangerLog

FINISH_S = 0.5
"""How long the last bytes may take to leave at the end."""

_READ, _WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE
_CHUNK = 4096
_ACCEPTED_MAX = 8
_IDLE_S = 0.25
_JOIN_S = 5.0


class PendingOutput(Protocol):
    """What is still to be written to a client."""

    def chunk(self) -> memoryview | bytes:
        """The bytes to write next; empty if there are none."""

    def wrote(self, count: int) -> None:
        """Says how many bytes of the last `chunk` the kernel took."""


class Client:
    """An accepted socket, and what is still to be written to it.

    Args:
        pending: what is to be written.
        stuck_ns: a client that takes nothing of what waits for it for this long is gone.
        keepalive: seconds of silence before the kernel asks whether it is still there, and
            between two such questions; and how many stay unanswered before it is gone.
        now_ns: monotonic clock.
    """

    def __init__(
        self,
        sock: socket.socket,
        pending: PendingOutput,
        stuck_ns: int,
        keepalive: tuple[int, int],
        now_ns: int,
    ) -> None:
        self.sock = sock
        self._pending = pending
        self._stuck_ns = stuck_ns
        self._moved_ns = now_ns
        interval_s, probes = keepalive
        # One message at most waits unsent in the kernel; a newer one replaces it here, not there.
        prepare(sock, _CHUNK)
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, interval_s)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, interval_s)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, probes)

    def write(self, now_ns: int) -> str:
        """Writes what the kernel takes now; returns why the connection is lost, or ""."""
        try:
            while chunk := self._pending.chunk():
                self._pending.wrote(self.sock.send(chunk))
                self._moved_ns = now_ns
        except (BlockingIOError, InterruptedError):
            stuck = now_ns - self._moved_ns > self._stuck_ns
            return f"has taken nothing for {self._stuck_ns // 10**9} s" if stuck else ""
        except OSError as error:
            return f"is gone: {error.strerror}"
        self._moved_ns = now_ns
        return ""

    def read(self) -> tuple[bytes, str]:
        """Reads what has come; returns it, and why the connection is lost, or ""."""
        try:
            data = self.sock.recv(_CHUNK)
        except (BlockingIOError, InterruptedError):
            return b"", ""
        except OSError as error:
            return b"", f"is gone: {error.strerror}"
        return data, "" if data else "has left"


class ListeningServer:
    """A port and the thread that serves it; a subclass decides who is served and how.

    Args:
        name: the server's name, for people.
        host: name or address of the interface to listen on.
        port: its number; 0 takes any that is free. It is taken at once and served from `start` on.
        clock: the host's monotonic clock [ns].

    Raises:
        LinkError: the host is unknown, or the port is taken.
    """

    def __init__(self, name: str, host: str, port: int, clock: Callable[[], int]) -> None:
        self._listener, self.port = listen(host, port)
        self._name = name
        self._strangers = StrangerLog(f"port {self.port}", self._say)
        self._resume_ns: int | None = None
        self._clock = clock
        self._lock = threading.Lock()
        self._ending = False
        self._failure: BaseException | None = None
        self._selector = selectors.DefaultSelector()
        self._waker = Waker()
        self._selector.register(self._waker, _READ)
        self._selector.register(self._listener, _READ)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> int:
        """Begins to answer; returns the port."""
        self._thread.start()
        return self.port

    def _check(self) -> None:
        """Raises LinkError where the thread has failed."""
        if self._failure is not None:
            raise LinkError(f"{self._name} has failed: {self._failure!r}")

    def _join(self) -> None:
        """Ends the thread where `_ending` is set, and closes everything; can be called again."""
        self._waker.wake()
        if self._thread.is_alive():
            self._thread.join(_JOIN_S)
        self._selector.close()
        self._listener.close()
        self._waker.close()

    def _admit(self, client: Client) -> None:
        """Has the thread listen to a client."""
        self._selector.register(client.sock, _READ | _WRITE, client)

    def _await(self, client: Client, unsent: bool) -> None:
        """Has the thread wait until a client sends, and while `unsent` until it takes more."""
        self._selector.modify(client.sock, _READ | (_WRITE if unsent else 0), client)

    def _dismiss(self, client: Client) -> None:
        self._selector.unregister(client.sock)
        client.sock.close()

    # --- the server's thread

    def _run(self) -> None:
        """The thread. A failure here is a bug; it is kept for the next caller."""
        try:
            while not self._ending:
                self._turn(_IDLE_S)
            until_ns = self._clock() + round(FINISH_S * 1e9)
            while self._unsent() and self._clock() < until_ns:
                self._turn(FINISH_S / 10.0)
        except BaseException as failure:
            self._failure = failure
            raise
        finally:
            with self._lock:
                self._let_go()

    def _turn(self, wait_s: float) -> None:
        for key, _ in self._selector.select(wait_s):
            if key.fileobj is self._waker:
                self._waker.drain()
            elif key.fileobj is not self._listener:
                self._hear(key.data)
            else:
                self._accept()
        now_ns = self._clock()
        if self._resume_ns is not None and now_ns >= self._resume_ns:
            self._resume_ns = None
            self._selector.register(self._listener, _READ)
        with self._lock:
            self._settle()
            self._strangers.tick(now_ns)

    def _accept(self) -> None:
        try:
            for _ in range(_ACCEPTED_MAX):
                sock, address = self._listener.accept()
                self._greet(sock, str(address[0]))
        except (BlockingIOError, InterruptedError, ConnectionError):
            return  # the client has gone again
        except OSError as error:
            now_ns = self._clock()
            text = f"cannot accept a connection: {error.strerror}"
            with self._lock:
                self._strangers.note("this machine", text, now_ns)
            self._resume_ns = now_ns + round(strangers.PAUSE_S * 1e9)
            self._selector.unregister(self._listener)

    # --- what a subclass does

    def _say(self, text: str) -> None:
        """Takes a line about strangers for a person; the lock is held."""
        raise NotImplementedError

    def _greet(self, sock: socket.socket, origin: str) -> None:
        """Takes a connection in, or refuses it."""
        raise NotImplementedError

    def _hear(self, client: Any) -> None:
        """Takes what a client sends."""
        raise NotImplementedError

    def _settle(self) -> None:
        """Writes what waits; the lock is held."""
        raise NotImplementedError

    def _let_go(self) -> None:
        """Drops all clients; the lock is held."""
        raise NotImplementedError

    def _unsent(self) -> bool:
        """Whether anything still waits to be written."""
        raise NotImplementedError
