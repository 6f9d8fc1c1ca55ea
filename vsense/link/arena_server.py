"""The arena tracking server: hands the arena state to clients of the original system.

Thesis, 2.3.2; the protocol is that of `arena_wire`. One client after another is served; whoever
connects meanwhile waits in the kernel's queue, as with the original. A thread of the server's own
listens and answers; the tracker's thread calls `publish`, which never waits for a client.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
import time
from collections.abc import Callable

from vsense.arena import ArenaState
from vsense.link.arena_session import ArenaSession, Locate
from vsense.link.ports import listen
from vsense.link.status import LinkError

STUCK_NS = 10_000_000_000
"""A client that takes nothing of what waits for it for this long is gone."""

FINISH_S = 0.5
"""How long the last bytes may take to leave at the end."""

SEND_BUFFER = 16_384
"""Bytes that the kernel may hold for a slow client: with more, old states would pile up there."""

_READ, _WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE
_CHUNK = 4096
_IDLE_S = 0.25
_JOIN_S = 5.0
_KEEPALIVE_S = 5


class _Client:
    """The client that is being served, and its socket."""

    def __init__(self, sock: socket.socket, origin: str, session: ArenaSession, now_ns: int):
        self.sock = sock
        self.origin = origin
        self.session = session
        self.moved_ns = now_ns
        sock.setblocking(False)
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
            # One state at most waits unsent in the kernel; a newer one replaces it here, not there.
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _CHUNK)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, _KEEPALIVE_S)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, _KEEPALIVE_S)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 2)

    def write(self, now_ns: int) -> str:
        """Writes what the kernel takes now; returns why the connection is lost, or ""."""
        outbox = self.session.outbox
        try:
            while chunk := outbox.chunk():
                outbox.wrote(self.sock.send(chunk))
                self.moved_ns = now_ns
        except (BlockingIOError, InterruptedError):
            stuck = now_ns - self.moved_ns > STUCK_NS
            return f"has taken nothing for {STUCK_NS // 10**9} s" if stuck else ""
        except OSError as error:
            return f"is gone: {error.strerror}"
        self.moved_ns = now_ns
        return ""


class ArenaServer:
    """Serves arena states; its methods may be called by any thread."""

    def __init__(
        self,
        host: str,
        port: int,
        locate: Locate,
        tell: Callable[[str], None],
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Takes the port; nobody is answered before `start`.

        Args:
            host: name or address of the interface to listen on.
            port: its number; 0 takes any that is free.
            locate: gives robots' poses in the pictures.
            tell: takes a line for a person; must not wait, nor call the server.
            clock: the host's monotonic clock [ns].

        Raises:
            LinkError: the host is unknown, or the port is taken.
        """
        self._listener, self.port = listen(host, port)
        self._locate = locate
        self._tell = tell
        self._clock = clock
        self._lock = threading.Lock()
        self._change = threading.Condition(self._lock)
        self._newest: ArenaState | None = None
        self._client: _Client | None = None
        self._ending = False
        self._failure: BaseException | None = None
        self._selector = selectors.DefaultSelector()
        self._wake_in, self._wake_out = socket.socketpair()
        for sock in (self._wake_in, self._wake_out):
            sock.setblocking(False)
        self._selector.register(self._wake_in, _READ)
        self._selector.register(self._listener, _READ)
        self._thread = threading.Thread(target=self._run, name="arena-server", daemon=True)

    def start(self) -> int:
        """Begins to answer; returns the port."""
        self._thread.start()
        return self.port

    def publish(self, state: ArenaState) -> None:
        """Makes a state the newest and has it sent to a client in a run; never waits for one.

        Raises:
            LinkError: the server's thread has failed.
        """
        if self._failure is not None:
            raise LinkError(f"the arena tracking server has failed: {self._failure!r}")
        unsent = False
        with self._lock:
            self._newest = state
            if self._client is not None:
                self._client.session.publish(state)
                self._client.write(self._clock())
                unsent = bool(self._client.session.outbox)
        if unsent:
            self._wake()

    def forget(self) -> None:
        """Drops the newest state: ONE_SHOT waits for the next one."""
        with self._lock:
            self._newest = None

    @property
    def running(self) -> bool:
        """Whether a client is in a run."""
        with self._lock:
            return self._is_running()

    @property
    def timestep(self) -> int:
        """The run's newest timestep, 0 outside of a run."""
        with self._lock:
            return self._client.session.timestep if self._client is not None else 0

    @property
    def client(self) -> str:
        """Address of the client that is being served, "" without one."""
        with self._lock:
            return self._client.origin if self._client is not None else ""

    def wait_for_run(self, timeout_s: float) -> bool:
        """Waits until a client starts a run; says whether one is on."""
        with self._change:
            self._change.wait_for(lambda: self._is_running() or self._ending, timeout_s)
            return self._is_running()

    def end_run(self) -> None:
        """Tells a client in a run that the run is over: a recording has come to its end.

        ONE_SHOT waits for the next state then, which is the beginning of another one.
        """
        with self._change:
            self._newest = None
            if self._client is not None:
                self._client.session.end_run()
                self._change.notify_all()
        self._wake()

    def close(self) -> None:
        """Ends the client's run and closes everything; can be called again."""
        with self._change:
            if self._client is not None:
                self._client.session.end_run()
            self._ending = True
            self._change.notify_all()
        self._wake()
        if self._thread.is_alive():
            self._thread.join(_JOIN_S)
        self._selector.close()
        for sock in (self._listener, self._wake_in, self._wake_out):
            sock.close()

    def _is_running(self) -> bool:
        return self._client is not None and self._client.session.running

    def _wake(self) -> None:
        try:
            self._wake_out.send(b"\0")
        except OSError:
            return  # full: it is about to wake; closed: it has ended

    # --- the server's thread

    def _run(self) -> None:
        """The thread. A failure here is a fault of ours: it is kept for the next `publish`."""
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
            with self._change:
                self._drop("")

    def _turn(self, wait_s: float) -> None:
        """Waits for a socket, and does all that is due."""
        for key, _ in self._selector.select(wait_s):
            if key.fileobj is self._wake_in:
                with contextlib.suppress(OSError):
                    self._wake_in.recv(_CHUNK)
            elif key.fileobj is self._listener:
                self._accept()
            else:
                self._read()
        with self._change:
            self._settle()

    def _accept(self) -> None:
        try:
            sock, address = self._listener.accept()
        except OSError:
            return
        with self._change:
            origin = str(address[0])
            session = ArenaSession(self._locate, lambda text: self._tell(f"{origin}: {text}"))
            self._client = _Client(sock, origin, session, self._clock())
            # The next client is accepted when this one has gone.
            self._selector.unregister(self._listener)
            self._selector.register(sock, _READ)
        self._tell(f"{origin} has connected")

    def _read(self) -> None:
        """Takes commands of the client in; finds out whether it has gone."""
        client = self._client
        assert client is not None
        try:
            data = client.sock.recv(_CHUNK)
            lost = "" if data else "has left"
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            data, lost = b"", f"is gone: {error.strerror}"
        with self._change:
            client.session.receive(data, self._newest)
            if lost or client.session.refused:
                self._drop(lost or client.session.refused)
            self._change.notify_all()

    def _settle(self) -> None:
        """Writes what waits and listens for what has to be waited for; the lock is held."""
        client = self._client
        if client is None:
            return
        lost = client.write(self._clock())
        if lost:
            self._drop(lost)
        else:
            self._selector.modify(client.sock, _READ | (_WRITE if client.session.outbox else 0))

    def _drop(self, reason: str) -> None:
        """Lets the client go and listens for the next one; the lock is held."""
        client, self._client = self._client, None
        if client is None:
            return
        if client.session.running:
            reason += f" in timestep {client.session.timestep} of a run"
        if reason:
            self._tell(f"{client.origin} {reason}")
        self._selector.unregister(client.sock)
        client.sock.close()
        self._selector.register(self._listener, _READ)
        self._change.notify_all()

    def _unsent(self) -> bool:
        with self._lock:
            return self._client is not None and bool(self._client.session.outbox)
