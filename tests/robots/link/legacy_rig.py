"""A robot with the original's client, written from iridia.md section 1b alone, and a bad network.

It shares no code with the server: numbers are read here as exact fractions. Nothing here sleeps.
"""

from __future__ import annotations

import selectors
import socket
import struct
import threading
from dataclasses import dataclass, field
from fractions import Fraction

PATIENCE_S = 20.0

REALS = {1: 3, 2: 8, 3: 3, 4: 3, 6: 1, 7: 1, 8: 4}
"""By the sensor's id, how many real numbers it has. RGB ground, 5, is 3 bytes."""

MOST = 2**63
"""2^63 - 2 as a double."""


class ClosedError(Exception):
    """The connection ended."""


def real(data: bytes) -> float:
    """Reads a real number: i64 mantissa, i32 exponent."""
    mantissa, exponent = struct.unpack(">qi", data)
    if mantissa == 0:
        return 0.0
    size = (Fraction(abs(mantissa) - 1, MOST) / 2 + Fraction(1, 2)) * Fraction(2) ** exponent
    return float(size) * (1 if mantissa > 0 else -1)


@dataclass
class Robot:
    """What a robot has learnt, fed byte by byte or in any other pieces.

    Attributes:
        table: payload size of each sensor.
        started, ended: the two signals.
        updates: of each message the sensors' payloads.
        values: the newest numbers of each sensor.
    """

    table: dict[int, int] = field(default_factory=dict)
    started: bool = False
    ended: bool = False
    updates: list[dict[int, bytes]] = field(default_factory=list)
    values: dict[int, tuple[float, ...]] = field(default_factory=dict)

    def live(self, read) -> None:
        """Lives a robot's life; `read(n)` gives the next n bytes or raises ClosedError."""
        self._take_table(read(struct.unpack(">I", read(4))[0]))
        while struct.unpack(">I", read(4))[0] != 1:
            pass
        self.started = True
        while size := struct.unpack(">I", read(4))[0]:
            self._take_update(read(size))
        self.ended = True

    def _take_table(self, rows: bytes) -> None:
        while rows:
            sensor, size = struct.unpack(">BI", rows[:5])
            assert sensor not in self.table
            self.table[sensor], rows = size, rows[5:]

    def _take_update(self, body: bytes) -> None:
        update = {}
        while body:
            sensor, size = body[0], self.table[body[0]]
            assert len(body) > size and sensor not in update
            update[sensor] = body[1 : 1 + size]
            body = body[1 + size :]
        self.updates.append(update)
        for sensor, payload in update.items():
            if sensor == 5:
                # Its reader takes blue, green, red (ci_virtual_rgb_ground_sensor.h, line 64).
                blue, green, red = payload
                self.values[sensor] = (red, green, blue)
            else:
                assert len(payload) == 12 * REALS[sensor]
                pieces = [payload[at : at + 12] for at in range(0, len(payload), 12)]
                self.values[sensor] = tuple(map(real, pieces))


class Client(threading.Thread):
    """A robot on the network, known by the last octet of the address that it connects from."""

    def __init__(self, port: int, octet: int, receive_buffer: int | None = None) -> None:
        super().__init__(daemon=True)
        self.robot = Robot()
        self.trouble: BaseException | None = None
        self.sock = socket.socket()
        if receive_buffer is not None:
            self.sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.sock.settimeout(PATIENCE_S)
        self.sock.bind((f"127.0.0.{octet}", 0))
        self.sock.connect(("127.0.0.1", port))

    def read(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = self.sock.recv(count - len(data))
            if not more:
                raise ClosedError
            data += more
        return data

    def run(self) -> None:
        try:
            self.robot.live(self.read)
        except ClosedError:
            pass
        except BaseException as trouble:
            self.trouble = trouble

    def finish(self) -> Robot:
        """Waits for the end of its life."""
        self.join(PATIENCE_S)
        assert not self.is_alive(), "it waits for more"
        if self.trouble is not None:
            raise self.trouble
        self.sock.close()
        return self.robot


class Relay(threading.Thread):
    """A network between one robot and the host that cuts, holds back and joins segments."""

    def __init__(self, port: int, octet: int, mode: str) -> None:
        super().__init__(daemon=True)
        self._mode = mode
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._host = socket.socket()
        self._host.bind((f"127.0.0.{octet}", 0))
        self._host.connect(("127.0.0.1", port))
        self.start()

    def run(self) -> None:
        robot, _ = self._listener.accept()
        self._listener.close()
        robot.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with robot, self._host, selectors.DefaultSelector() as selector:
            selector.register(self._host, selectors.EVENT_READ)
            held = b""
            while True:
                # Delayed: until nothing more has come for a while; merged: until much has come.
                quiet = not selector.select(0.03)
                data = b"" if quiet else self._host.recv(65536)
                held += data
                gone = not quiet and not data
                if self._mode == "split":
                    for at in range(len(held)):
                        robot.sendall(held[at : at + 1])
                    held = b""
                elif gone or quiet or (self._mode == "merged" and len(held) > 700):
                    robot.sendall(held)
                    held = b""
                if gone:
                    return
