"""A robot on Wi-Fi in the lab: a TCP server with firmware behind it, and air between them.

What radios do to packets is an estimate, drawn by a seed: mostly some milliseconds, now and then a
tenth of a second, and never another order, since it is TCP. See `Link` in `_links.py`.
"""

from __future__ import annotations

import random
import select
import socket
from collections import deque
from typing import Any

from vsense.base.native import ffi, lib
from vsense.modes.lab._links import FirmwareKind, FirmwareProgram, Outputs, soonest

LEAST_NS, MEAN_NS = 2_000_000, 4_000_000
"""Of a way through the air, and what comes on top of that in the mean."""

HELD_UP, HELD_UP_NS = 0.01, 80_000_000
"""So many are held up, and how long."""

PACKET_BYTES = 1 + lib.EPUCK_WIFI_SENSORS_LEN


class Air:
    """A program behind a TCP port, for one connection at a time; see `Link`.

    Attributes:
        broken: nothing comes through, either way; a test breaks it.
    """

    def __init__(self, kind: FirmwareKind, seed: int = 0) -> None:
        """Raises OSError where there is no port."""
        self.program = FirmwareProgram(kind)
        self.due_ns: int | None = None
        self.sent_bytes = self.lost_bytes = 0
        self.broken = False
        self._random = random.Random(seed)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self.device = f"127.0.0.1:{self._listener.getsockname()[1]}"
        self._daemon: socket.socket | None = None
        self._to_robot: deque[tuple[int, bytes]] = deque()
        self._to_daemon: deque[tuple[int, bytes]] = deque()
        self._bytes: Any = ffi.new("uint8_t[]", PACKET_BYTES)
        self._ready = select.epoll()
        self._ready.register(self._listener, select.EPOLLIN)

    def readable(self) -> int | None:
        return self._ready.fileno()

    def receive(self, now_ns: int) -> None:
        for fd, _ in self._ready.poll(0):
            if fd == self._listener.fileno():
                self._accept()
            elif self._daemon is not None:
                self._read(self._daemon, now_ns)
        self._plan()

    def advance(self, now_ns: int) -> list[Outputs]:
        state, done = self.program.state, []
        while self._to_robot and self._to_robot[0][0] <= now_ns and not self.broken:
            at_ns, data = self._to_robot.popleft()
            lib.fw_wifi_receive(state, data, len(data), at_ns // 1000)
            done += self.program.advance(at_ns)
        done += self.program.advance(now_ns)
        count = lib.fw_wifi_transmit(state, self._bytes, PACKET_BYTES, now_ns // 1000)
        if count:
            self._put(self._to_daemon, bytes(ffi.buffer(self._bytes, count)), now_ns)
        while self._to_daemon and self._to_daemon[0][0] <= now_ns and not self.broken:
            self._send(self._to_daemon.popleft()[1])
        self._plan()
        return done

    def faults(self) -> dict[str, int]:
        return {}

    def close(self) -> None:
        if self._daemon is not None:
            self._daemon.close()
        self._listener.close()
        self._ready.close()

    def _accept(self) -> None:
        """The next one waits until this one has ended."""
        self._daemon = self._listener.accept()[0]
        self._daemon.setblocking(False)
        self._daemon.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._ready.unregister(self._listener)
        self._ready.register(self._daemon, select.EPOLLIN)
        lib.fw_wifi_connect(self.program.state)

    def _read(self, daemon: socket.socket, now_ns: int) -> None:
        try:
            data = daemon.recv(4096)
        except ConnectionError:
            data = b""
        if data:
            self._put(self._to_robot, data, now_ns)
        else:
            self.break_off()

    def garble(self, data: bytes) -> None:
        """Has the robot send what none does, after what is on its way."""
        self._put(self._to_daemon, data, self._to_daemon[-1][0] if self._to_daemon else 0)

    def break_off(self) -> None:
        """Ends the connection; what was on its way is lost."""
        daemon = self._daemon
        if daemon is None:
            return
        self._ready.unregister(daemon)
        daemon.close()
        self._daemon = None
        self._ready.register(self._listener, select.EPOLLIN)
        self._to_robot.clear()
        self._to_daemon.clear()
        lib.fw_wifi_connect(self.program.state)

    def _put(self, queue: deque[tuple[int, bytes]], data: bytes, now_ns: int) -> None:
        way_ns = LEAST_NS + round(self._random.expovariate(1.0 / MEAN_NS))
        way_ns += HELD_UP_NS if self._random.random() < HELD_UP else 0
        queue.append((max(now_ns + way_ns, queue[-1][0] if queue else 0), data))

    def _send(self, packet: bytes) -> None:
        try:
            if self._daemon is not None:
                self._daemon.send(packet)
                self.sent_bytes += len(packet)
        except (BlockingIOError, ConnectionError):
            self.lost_bytes += len(packet)

    def _plan(self) -> None:
        queues = () if self.broken else (self._to_robot, self._to_daemon)
        self.due_ns = soonest(self.program.due_ns(), *[queue[0][0] for queue in queues if queue])
