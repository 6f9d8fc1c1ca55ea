"""Serves a run or a replay to Foxglove (`--foxglove`), read-only, by a process of its own.

The publisher's thread only puts messages in. Of every topic the newest one waits, so a slow process
skips and never lags; a thread sends them. The process is `_foxglove_process.py`.
"""

from __future__ import annotations

import socket
import subprocess
import threading
import time
from collections import deque
from collections.abc import Collection
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

from vsense.base import errors
from vsense.base.clock import host_ns
from vsense.base.errors import UsageError, VsenseError
from vsense.base.message_bus import Message, MessageBus
from vsense.base.processes import python_module
from vsense.base.terminal import Console
from vsense.monitor.foxglove.channels import LASTING
from vsense.monitor.ui.access import FoxgloveAddress, is_loopback
from vsense.robots.link import network
from vsense.run.orders import Give, Order, OrderError, OrderKind

if TYPE_CHECKING:
    from vsense.monitor.recording.reader import Recording

LAYOUT = "foxglove-layout.json"
"""The name of the layout in `vsense docs`."""
_EVENTS = 200
_WAKE_S = 0.1
_START_S, _END_S = 20.0, 3.0


class FoxgloveError(VsenseError):
    """Foxglove cannot be served."""


def check_foxglove(address: FoxgloveAddress | None, taken: Collection[int | None] = ()) -> None:
    """Refuses what cannot be served, before anything is started; None: nothing is asked for.

    `taken_ports` are the run's other ports.

    Raises:
        UsageError: the package is missing, or the port is one of `taken_ports`.
        VsenseError: another program has the port, or the host is unknown.
    """
    if address is None:
        return
    errors.require("--foxglove needs", "foxglove")
    if address.port and address.port in taken:
        raise UsageError(
            f"--foxglove: {address.port} is a port for robots or the page, too: give it another,"
            f" such as --foxglove {address.port + 1}"
        )
    network.listen(address.host, address.port)[0].close()


class FoxgloveServer:
    """Serves what a bus carries; ends with `close`.

    Args:
        bus: what is served.
        address: where.
        console: takes a line where it is served, and about trouble.
        recording: the one that is played, None: time is now.
        give: carries out a replay's PLAY, SPEED and SEEK.
    """

    def __init__(
        self,
        bus: MessageBus,
        address: FoxgloveAddress,
        console: Console,
        recording: Recording | None = None,
        give: Give | None = None,
    ) -> None:
        self._bus, self._address, self._console = bus, address, console
        self._recording, self._give = recording, give
        self._wanted: frozenset[str] = LASTING
        self._waiting: dict[str, Message] = {}
        self._events: deque[Message] = deque(maxlen=_EVENTS)
        self._news = threading.Condition()
        self._closing = False
        self._paused_at_s: float | None = None
        self._owes = False
        self.port = 0

    def start(self) -> None:
        """Begins to serve, and says where.

        Raises:
            VsenseError: the port is taken, or a library is missing.
        """
        check_foxglove(self._address)
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                python_module("vsense.monitor.ui._foxglove_process"),
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        self._link = Connection(ours.detach())
        self.port = self._begin()
        self._thread = threading.Thread(target=self._run, name="vsense-foxglove", daemon=True)
        self._thread.start()
        self._listener = self._bus.join(self.receive, self._wants)
        host = f"[{self._address.host}]" if ":" in self._address.host else self._address.host
        line = f"Foxglove: ws://{host}:{self.port}; its layout: vsense docs --path {LAYOUT}"
        for text in [line, *self._address.warnings()]:
            self._console.say(text)

    def _begin(self) -> int:
        """Tells the process what to do; gives its port."""
        why = "its process has ended"
        with suppress(OSError, EOFError):
            self._link.send(self._spec())
            if self._link.poll(_START_S):
                kind, value = self._link.recv()
                if kind == "port":
                    return int(value)
                why = value
            else:
                why = f"it has not begun within {_START_S:g} s"
        self._end_process()
        raise FoxgloveError(f"Foxglove cannot be served: {why}")

    def _spec(self) -> dict[str, Any]:
        address, recording = self._address, self._recording
        where = {"host": address.host, "port": address.port}
        if recording is None:
            return {**where, "utc_shift_ns": time.time_ns() - host_ns()}
        begin_ns = recording.begin_ns + recording.utc_shift_ns
        return {
            **where,
            "utc_shift_ns": recording.utc_shift_ns,
            "begin_ns": begin_ns,
            "end_ns": begin_ns + round(1e9 * recording.duration_s),
            "steered": self._give is not None and is_loopback(address.host),
        }

    def receive(self, message: Message) -> None:
        """Takes a message of the bus; does not wait."""
        with self._news:
            if message.topic == "/event":
                self._events.append(message)
            else:
                self._waiting.pop(message.topic, None)
                self._waiting[message.topic] = message
            self._news.notify()

    def close(self) -> None:
        """Ends the serving; can be called again."""
        self._bus.leave(self._listener)
        with self._news:
            self._closing = True
            self._news.notify()
        self._thread.join(_END_S)
        self._end_process()

    def _end_process(self) -> None:
        self._link.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _wants(self, topic: str) -> bool:
        return topic in self._wanted

    def _run(self) -> None:
        try:
            while not self._closing:
                for message in self._next():
                    self._note(message)
                    self._link.send(message)
                while self._link.poll():
                    self._hear(*self._link.recv())
                self._show_standing()
        except Exception as error:
            if not self._closing:
                self._wanted = frozenset()
                text = f"Foxglove is served no more, and the run goes on without: {error!r}"
                self._console.say(text, "warning")

    def _next(self) -> list[Message]:
        """Waits for messages, at most for a moment; where a replay is comes before all else."""
        with self._news:
            if not (self._waiting or self._events or self._closing):
                self._news.wait(_WAKE_S)
            waiting, self._waiting = self._waiting, {}
            events = list(self._events)
            self._events.clear()
        return sorted([*waiting.values(), *events], key=lambda message: message.topic != "/run")

    def _note(self, message: Message) -> None:
        """Keeps where a replay stands still."""
        replay = message.data.get("replay") if message.topic == "/run" else None
        if replay:
            self._paused_at_s = None if replay["playing"] else replay["position_s"]
            self._owes = self._owes and not replay["playing"]

    def _show_standing(self) -> None:
        """Has a replay that stands still tell again what somebody has begun to look at."""
        if self._owes and self._paused_at_s is not None:
            self._owes = False
            self._order(OrderKind.SEEK, self._paused_at_s)

    def _hear(self, kind: str, value: Any) -> None:
        if kind == "wants":
            self._owes = self._owes or not value <= self._wanted
            self._wanted = value
        elif kind == "orders":
            for name, number in value:
                self._order(OrderKind(name), number)
        else:
            raise FoxgloveError(str(value))

    def _order(self, kind: OrderKind, value: float) -> None:
        if self._give is not None:
            with suppress(OrderError):
                self._give(Order(kind, "Foxglove", value))
