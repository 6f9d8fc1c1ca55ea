"""The arena tracking server: hands the arena state to clients of the original system.

Thesis, 2.3.2; the protocol is that of `vsense.robots.link.trackers.protocol`. `ArenaSession` is the
server's side of one conversation without its socket. One client after another is served, as with
the original; others wait, and one that asks for nothing makes way for them. A thread of the
server's own listens and answers; the tracker's thread calls `publish`, which never waits for a
client.
"""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import ArenaState
from vsense.base.clock import host_ns
from vsense.robots.link._listening import Client, ListeningServer
from vsense.robots.link._streams import Outbox
from vsense.robots.link.strangers import PortPlaces, owner_of
from vsense.robots.link.trackers.protocol import COMMAND_SIZE, END, TrackerCommand, encode_state

Locate = Callable[[NDArray[np.void]], NDArray[np.float64]]
"""Gives for (n,) POSE the (n, 3) poses in pictures: x and y in px, the angle in degrees."""

WRONG_MAX = 8
"""Unknown commands until the peer is taken to be something else than a client."""
WAITING_MAX = 64
"""Answers that may wait for a client that asks without reading."""


class ArenaSession:
    """One client: what it has asked for, and what still has to be sent to it.

    Attributes:
        running: between START_EXPERIMENT and STOP_EXPERIMENT.
        timestep: of the run, from 1; 0 outside of one and before its first state.
        runs: how many runs the client has started.
        superseded: states of this run that a newer one replaced before they could leave.
        refused: why the conversation must end, "" while it can go on.
    """

    def __init__(self, locate: Locate, say: Callable[[str], None]) -> None:
        self.outbox = Outbox()
        self.running = False
        self.timestep = 0
        self.runs = 0
        self.superseded = 0
        self.refused = ""
        self._locate = locate
        self._notify = say
        self._bytes = bytearray()
        self._asked = 0
        self._wrong = 0
        self._answers = 0
        self._first: int | None = None

    def receive(self, data: bytes, newest: ArenaState | None) -> None:
        """Takes bytes of the client in; ONE_SHOT gets `newest`, the next state if that is None."""
        self._bytes += data
        while len(self._bytes) >= COMMAND_SIZE and not self.refused:
            (number,) = struct.unpack_from(">I", self._bytes)
            del self._bytes[:COMMAND_SIZE]
            self._obey(number, newest)

    def publish(self, state: ArenaState) -> None:
        """Answers what waits for a state, and in a run adds this one to the stream."""
        if self.running:
            if self._first is None:
                self._first = state.timestep
            self.timestep = state.timestep - self._first + 1
        while self._asked:
            self._asked -= 1
            self._answer(state)
        if self.running:
            self.superseded += self.outbox.put_state(self._encode(state))

    def end_run(self) -> None:
        """Ends a run from the server's side; nothing happens outside of one.

        Length 0 leaves here only. The original's client stops its robots on it and then dies: it
        reads a timestep from the empty state. So it is the last resort before the connection is
        closed, on which that client dies, too, without stopping its robots.
        """
        if self.running:
            self._stop()
            self.outbox.put(END)

    def _obey(self, number: int, newest: ArenaState | None) -> None:
        if number == TrackerCommand.ONE_SHOT:
            self._one_shot(newest)
        elif number == TrackerCommand.START_EXPERIMENT:
            if self.running:
                self._notify("START_EXPERIMENT in a run: the run goes on")
                return
            self.running, self.timestep, self._first, self.superseded = True, 0, None, 0
            self.runs += 1
            self._notify("the run has started")
        elif number == TrackerCommand.STOP_EXPERIMENT:
            if self.running:
                self._stop()
        else:
            self._wrong += 1
            self._notify(f"command {number} is not known, expected 0, 1 or 2; it is ignored")
            if self._wrong >= WRONG_MAX:
                self.refused = "sends too many unknown commands to be a client"

    def _one_shot(self, newest: ArenaState | None) -> None:
        if not self.outbox:
            self._answers = 0
        if self._asked + self._answers >= WAITING_MAX:
            self.refused = "asks for states and does not read them"
        elif newest is None:
            self._asked += 1
        else:
            self._answer(newest)

    def _answer(self, state: ArenaState) -> None:
        self._answers += 1
        self.outbox.put(self._encode(state))

    def _stop(self) -> None:
        lost = f", {self.superseded} of them too fast for the client" if self.superseded else ""
        self._notify(f"the run has ended after {self.timestep} timesteps{lost}")
        self.running, self.timestep = False, 0
        self.outbox.drop_state()

    def _encode(self, state: ArenaState) -> bytes:
        return encode_state(self.timestep, state.robots, self._locate(state.robots))


WRITE_MAX_NS = 10_000_000_000
"""A client that takes nothing of what waits for it for this long is gone."""
IDLE_MAX_NS = 5_000_000_000
"""A client that is in no run and asks for nothing for this long makes way for one that waits."""
WAITING_MAX_CLIENTS, WAITING_EACH = 8, 2
"""Clients that wait, in all and from one address; the oldest makes way for one more."""

_KEEPALIVE = (5, 2)


class _Served(Client):
    def __init__(self, sock: socket.socket, origin: str, session: ArenaSession, now_ns: int):
        super().__init__(sock, session.outbox, WRITE_MAX_NS, _KEEPALIVE, now_ns)
        self.origin = origin
        self.session = session
        self.heard_ns = now_ns


@dataclass(frozen=True, slots=True, eq=False)
class _Waiting:
    sock: socket.socket
    origin: str


class ArenaServer(ListeningServer):
    """Serves arena states; its methods may be called by any thread.

    `locate` gives robots' poses in the pictures. `say` takes a line for a person; it must not
    wait, nor call the server. The rest is as for `ListeningServer`.
    """

    def __init__(
        self,
        host: str,
        port: int,
        locate: Locate,
        say: Callable[[str], None],
        clock: Callable[[], int] = host_ns,
    ) -> None:
        super().__init__("the arena tracking server", host, port, clock)
        self._locate = locate
        self._notify = say
        self._change = threading.Condition(self._lock)
        self._newest: ArenaState | None = None
        self._client: _Served | None = None
        self._waiting = PortPlaces[_Waiting](WAITING_MAX_CLIENTS, WAITING_EACH)

    def publish(self, state: ArenaState) -> None:
        """Makes a state the newest and sends it to a client in a run; never waits for one.

        Raises:
            LinkError: the server's thread has failed.
        """
        self._check()
        unsent = False
        with self._lock:
            self._newest = state
            if self._client is not None:
                self._client.session.publish(state)
                self._client.write(self._clock())
                unsent = bool(self._client.session.outbox)
        if unsent:
            self._waker.wake()

    def repeat(self, timeout_s: float) -> bool:
        """Sends a client in a run the newest state again, as the next timestep, and waits.

        Where no state comes any more this keeps the original's client alive until it ends its run
        itself. Returns False as soon as that run is over, and at once where there is none.
        """
        with self._change:
            client, state = self._client, self._newest
            if client is None or state is None or not client.session.running:
                return False
            run = client.session.runs
        self.publish(replace(state, timestep=state.timestep + 1))

        def over() -> bool:
            session = client.session
            gone = self._ending or self._client is not client
            return gone or not session.running or session.runs != run

        with self._change:
            return not self._change.wait_for(over, timeout_s)

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
        """Ends a client's run where there was no state to send; ONE_SHOT waits for the next one."""
        with self._change:
            self._newest = None
            if self._client is not None:
                self._client.session.end_run()
                self._change.notify_all()
        self._waker.wake()

    def close(self) -> None:
        """Ends the client's run and closes everything; can be called again."""
        with self._change:
            if self._client is not None:
                self._client.session.end_run()
            self._ending = True
            self._change.notify_all()
        self._join()

    def _is_running(self) -> bool:
        return self._client is not None and self._client.session.running

    # --- the server's thread

    def _greet(self, sock: socket.socket, origin: str) -> None:
        with self._change:
            loser = self._waiting.add(_Waiting(sock, origin), owner_of(origin))
            if loser is not None:
                loser.sock.close()
                self._strangers.note(loser.origin, "too many clients wait", self._clock())

    def _serve_next(self) -> None:
        """Serves the client that has waited longest; the lock is held."""
        waiting = next(iter(self._waiting), None)
        if waiting is None:
            return
        self._waiting.remove(waiting)
        sock, origin = waiting.sock, waiting.origin
        session = ArenaSession(self._locate, lambda text: self._say_of(origin, f": {text}"))
        self._client = _Served(sock, origin, session, self._clock())
        self._admit(self._client)
        self._say_of(origin, " has connected")

    def _hear(self, client: _Served) -> None:
        data, lost = client.read()
        if not data and not lost:
            return
        with self._change:
            if self._client is not client:
                return
            client.heard_ns = self._clock()
            client.session.receive(data, self._newest)
            if lost or client.session.refused:
                self._drop(lost or client.session.refused)
            self._change.notify_all()

    def _settle(self) -> None:
        client, now_ns = self._client, self._clock()
        if client is not None:
            idle = not client.session.running and now_ns - client.heard_ns >= IDLE_MAX_NS
            lost = "asks for nothing, and another one waits" if idle and self._waiting else ""
            lost = lost or client.write(now_ns)
            if lost:
                self._drop(lost)
            else:
                self._await(client, bool(client.session.outbox))
        if self._client is None:
            self._serve_next()

    def _let_go(self) -> None:
        self._drop("")
        for waiting in self._waiting:
            self._waiting.remove(waiting)
            waiting.sock.close()

    def _say(self, text: str) -> None:
        self._notify(text)

    def _say_of(self, origin: str, text: str) -> None:
        """Tells something of a client; whoever reaches the port can be one. The lock is held."""
        deed = "connections and commands"
        self._strangers.say(origin, f"{origin}{text}", deed, self._clock())

    def _drop(self, reason: str) -> None:
        """Closes the client's connection, so that the next one is served; the lock is held."""
        client, self._client = self._client, None
        if client is None:
            return
        if client.session.running:
            reason += f" in timestep {client.session.timestep} of a run"
        if reason:
            self._say_of(client.origin, f" {reason}")
        self._dismiss(client)
        self._change.notify_all()

    def _unsent(self) -> bool:
        with self._lock:
            return self._client is not None and bool(self._client.session.outbox)
