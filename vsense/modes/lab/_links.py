"""What a daemon opens in the lab: a pseudo-terminal, or a bus on a socket, with firmware behind it.

The firmware is the C code of `firmware_bridge/`, one program per robot. Time is an argument in ns
and never goes back. Nothing here waits: what is not read is lost, as on a wire.
"""

from __future__ import annotations

import os
import select
import shlex
import socket
import struct
import tty
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.base.native import ffi, lib
from vsense.base.processes import python_file
from vsense.robots.build import source_tree
from vsense.robots.inprocess import AMBIENT_RAW

GROUND_RAW = 800
"""Reading of every ground sensor, higher is brighter: the lab's floor is a light one."""

TURNING_RAW = 18.25
"""What a gyroscope of `epuck_imu.h` reads around its z axis when the right wheel makes a step a
second more than the left one, 53 mm away."""

_NEVER_DUE_US = 2**64 - 1
"""Due time in C of a program that waits for its host."""


@dataclass(frozen=True, slots=True)
class FirmwareKind:
    """One kind of base that the lab can emulate.

    Attributes:
        prefix: of the program's functions in C.
        arguments: for its init, after the struct.
        byte_ns: duration of one byte on its serial line; 0 if it is on a bus.
        count: the field that counts the commands that reached it.
        driver: file of the shipped driver that its daemon starts; empty: it opens the line itself.
        before: words before the driver's.
    """

    prefix: str
    arguments: tuple[int, ...] = ()
    byte_ns: int = 0
    count: str = "packets"
    driver: str = ""
    before: tuple[str, ...] = ()

    def base(self, name: str, device: str) -> str:
        """A daemon's `--base` for that device, of a kind of that name."""
        if not self.driver:
            return f"{name}:{device}"
        words = [*self.before, *python_file(source_tree().drivers / self.driver)]
        return f"exec:{shlex.join(words)} {device}"


_ASERCOM = FirmwareKind("fw_asercom", (lib.EPUCK_ASERCOM_EXTENSION,), 43403)

PROGRAMS: dict[str, FirmwareKind] = {
    "argos": FirmwareKind("fw_argos", (), lib.EPUCK_ARGOS_BYTE_NS, "frames"),
    "asercom": _ASERCOM,
    "gctronic": FirmwareKind("fw_gctronic"),
    "york": FirmwareKind("fw_york", count="writes"),
    "exec": replace(_ASERCOM, driver="epuck.py"),
    "wifi": FirmwareKind("fw_wifi"),
    "thymio": FirmwareKind("fw_wheels", (1300,), count="orders", driver="thymio.py"),
    "ros2": FirmwareKind("fw_wheels", (32767,), count="orders", driver="ros2.py"),
}


class Outputs(NamedTuple):
    """Speeds in steps/s and lit LEDs as bits from `time_ns` on."""

    time_ns: int
    left_steps_s: int
    right_steps_s: int
    leds: int


class FirmwareProgram:
    """One microcontroller's program and its state.

    Attributes:
        state: its C struct; tests make its faults there.
        proximity: (8,) int16, raw values of its sensors ps0..ps7.
    """

    def __init__(self, kind: FirmwareKind) -> None:
        self.kind = kind
        self.state: Any = ffi.new(f"struct {kind.prefix} *")
        self._advance = getattr(lib, f"{kind.prefix}_advance")
        self._due_us = getattr(lib, f"{kind.prefix}_due_us")
        getattr(lib, f"{kind.prefix}_init")(self.state, *kind.arguments)
        inputs = self.state.body.inputs
        for i in range(8):
            inputs.light[i] = AMBIENT_RAW
        for i in range(3):
            inputs.ground[i] = GROUND_RAW
            inputs.acceleration[i] = lib.EPUCK_ARGOS_REST_RAW
        inputs.acceleration[2] += lib.EPUCK_ARGOS_GRAVITY_RAW
        for i in range(4):
            inputs.microphones[i] = lib.EPUCK_ARGOS_REST_RAW
        self.proximity: NDArray[np.int16] = np.frombuffer(ffi.buffer(inputs.prox), dtype=np.int16)

    def advance(self, now_ns: int) -> list[Outputs]:
        """Runs up to `now_ns`; returns the outputs since the last call, in order."""
        done = []
        while self._advance(self.state, now_ns // 1000):
            body = self.state.body
            out = body.outputs
            done.append(
                Outputs(body.applied_us * 1000, out.left_steps_s, out.right_steps_s, out.leds)
            )
        return done

    def due_ns(self) -> int | None:
        """When it is due again, None: it waits for its host."""
        due: int = self._due_us(self.state)
        return None if due == _NEVER_DUE_US else due * 1000


def soonest(*dues: int | None) -> int | None:
    """The first time of those that come, None: none does."""
    return min((due for due in dues if due is not None), default=None)


_REQUEST = struct.Struct("<IBB")
"""Of a bus on a socket: number, address, bytes to read; what is written follows."""
_REPLY = struct.Struct("<IB")
"""Number, 0 = acknowledged; what was read follows."""
_GREETING = b"\x01"
_FIRST_BYTES, _MORE_BYTES = 16, 64
"""A serial driver passes bytes on when its buffer is full or the line falls silent. So does a
terminal here, when all are through or the time of so many has passed, of few for the first ones,
which tell that an answer has begun: each time the kernel wakes a daemon, whatever it waits for."""


class Link(Protocol):
    """What a daemon opens, with a program behind it.

    Attributes:
        device: the path in `--base KIND:DEVICE`.
        due_ns: when `advance` is due again, None while the line is idle.
        sent_bytes, lost_bytes: to the daemon; lost are those that it did not take.
    """

    device: str
    program: FirmwareProgram
    due_ns: int | None
    sent_bytes: int
    lost_bytes: int

    def readable(self) -> int | None:
        """The descriptor whose input `receive` would take now, None while it takes nothing."""

    def receive(self, now_ns: int) -> None:
        """Takes the daemon's bytes."""

    def advance(self, now_ns: int) -> list[Outputs]:
        """Runs the program up to `now_ns` and passes on its bytes."""

    def faults(self) -> dict[str, int]:
        """Counters of a host's errors; names as in `Microcontrollers`."""

    def close(self) -> None: ...


class PseudoTerminal:
    """Before a program: a terminal that outlives its daemons, for a `Link`."""

    def __init__(self, kind: FirmwareKind) -> None:
        """Raises OSError where there are no more terminals."""
        self.program = FirmwareProgram(kind)
        self.due_ns: int | None = None
        self.sent_bytes = self.lost_bytes = 0
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.device = os.ttyname(self._slave)

    def write(self, data: bytes | memoryview) -> None:
        """Writes what the daemon has room for, and counts."""
        try:
            written = os.write(self.master, data) if data else 0
        except BlockingIOError:
            written = 0
        self.sent_bytes += written
        self.lost_bytes += len(data) - written

    def close(self) -> None:
        os.close(self.master)
        os.close(self._slave)


class Terminal(PseudoTerminal):
    """A program behind a serial line; see `Link`."""

    def __init__(self, kind: FirmwareKind) -> None:
        super().__init__(kind)
        self._byte_ns = kind.byte_ns
        self._receive = getattr(lib, f"{kind.prefix}_receive")
        self._transmit = getattr(lib, f"{kind.prefix}_transmit")
        self._bytes: Any = ffi.new("uint8_t[]", lib.FW_LINE_CAPACITY)
        self._sending = self.program.state.uart.tx
        self._waiting = b""
        self._is_sending, self._hand_ns = False, 0

    def readable(self) -> int | None:
        return None if self._waiting else self.master

    def receive(self, now_ns: int) -> None:
        self._waiting += os.read(self.master, lib.FW_LINE_CAPACITY)
        self._offer(now_ns)
        self._plan(now_ns)

    def advance(self, now_ns: int) -> list[Outputs]:
        done = self.program.advance(now_ns)
        if self._waiting:
            self._offer(now_ns)
        if self._sending.count and now_ns >= min(self._hand_ns, self._sending.free_ns):
            self._hand_out(now_ns)
        self._plan(now_ns)
        return done

    def faults(self) -> dict[str, int]:
        uart = self.program.state.uart
        return {"overlapped_bytes": uart.overlapped, "overflowed_bytes": uart.overflowed}

    def _offer(self, now_ns: int) -> None:
        """Passes on as many of the daemon's bytes as the program takes."""
        count = len(self._waiting)
        took = self._receive(self.program.state, self._waiting, count, now_ns // 1000)
        self._waiting = self._waiting[took:]

    def _hand_out(self, now_ns: int) -> None:
        self._hand_ns = now_ns + _MORE_BYTES * self._byte_ns
        count = self._transmit(
            self.program.state, self._bytes, lib.FW_LINE_CAPACITY, now_ns // 1000
        )
        self.write(ffi.buffer(self._bytes, count))

    def _plan(self, now_ns: int) -> None:
        if not self._is_sending:
            self._hand_ns = now_ns + _FIRST_BYTES * self._byte_ns
        self._is_sending = self._sending.count > 0
        hand_ns = self._hand_ns if self._is_sending or self._waiting else None
        self.due_ns = soonest(self.program.due_ns(), hand_ns)


def _peer(daemon: socket.socket) -> bytes:
    """Who opened a connection: process, user and group."""
    return daemon.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))


class Bus:
    """A program and all boards that a robot may have on an I2C bus; see `Link`.

    The bus is a Unix socket of packets (`firmware_bridge/README.md`) for one daemon at a time: the
    next one's greeting waits until the one before has ended. A daemon has several connections, one
    for each of its processes; it opens them all itself, so they have one peer.

    Attributes:
        wires: the C struct of the bus; tests make its faults there.
        ground, rab, adc, rgb, imu: the C structs of the boards.
    """

    def __init__(self, kind: FirmwareKind, path: Path) -> None:
        """Raises OSError where there can be no such socket."""
        self.program = FirmwareProgram(kind)
        self.due_ns: int | None = None
        self.sent_bytes = self.lost_bytes = 0
        self.device = f"unix:{path}"
        self.wires: Any = ffi.new("struct fw_i2c *")
        self.ground: Any = ffi.new("struct fw_ground *")
        self.rab: Any = ffi.new("struct fw_rab *")
        self.adc: Any = ffi.new("struct fw_adc *")
        self.rgb: Any = ffi.new("struct fw_rgb *")
        self.imu: Any = ffi.new("struct fw_imu *")
        lib.fw_i2c_init(self.wires)
        lib.fw_ground_init(self.ground)
        lib.fw_rab_init(self.rab)
        lib.fw_adc_init(self.adc)
        lib.fw_rgb_init(self.rgb)
        lib.fw_imu_init(self.imu, lib.EPUCK_IMU_MPU9250)
        for i in range(3):
            self.ground.ground[i] = GROUND_RAW
        boards = (self.ground, self.rab, self.adc, self.rgb, self.imu)
        for chip in (self.program.state, *boards):
            lib.fw_i2c_add(self.wires, ffi.addressof(chip, "device"))
        self._bytes: Any = ffi.new("uint8_t[]", 256)
        self._replies: deque[tuple[int, socket.socket, bytes]] = deque()
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._daemon: list[socket.socket] = []
        self._waiting: list[socket.socket] = []
        self._ready = select.epoll()
        try:
            self._listener.bind(str(path))
        except OSError:
            self._listener.close()
            raise
        self._listener.listen()
        self._listener.setblocking(False)
        self._ready.register(self._listener, select.EPOLLIN)

    def readable(self) -> int | None:
        return self._ready.fileno()

    def receive(self, now_ns: int) -> None:
        ready = {fd for fd, _ in self._ready.poll(0)}
        for client in [client for client in self._daemon if client.fileno() in ready]:
            try:
                request = client.recv(256)
            except ConnectionError:
                request = b""
            if len(request) < _REQUEST.size:
                self._hang_up(client)
            else:
                self._transfer(client, request, now_ns)
        if self._listener.fileno() in ready:
            self._waiting.append(self._listener.accept()[0])
            self._waiting[-1].setblocking(False)
        self._admit()
        self._plan()

    def advance(self, now_ns: int) -> list[Outputs]:
        done = self.program.advance(now_ns)
        while self._replies and self._replies[0][0] <= now_ns:
            self._send(*self._replies.popleft()[1:])
        self._plan()
        return done

    def faults(self) -> dict[str, int]:
        wires = self.wires
        return {"transactions": wires.transactions, "failed_transactions": wires.failed}

    def close(self) -> None:
        for sock in (*self._daemon, *self._waiting, self._listener):
            sock.close()
        self._ready.close()

    def _admit(self) -> None:
        """Greets who belongs to the daemon that has the bus; if none has it, who came first."""
        for client in [*self._waiting]:
            if self._daemon and _peer(client) != _peer(self._daemon[0]):
                continue
            self._waiting.remove(client)
            if self._send(client, _GREETING):
                self._daemon.append(client)
                self._ready.register(client, select.EPOLLIN)
            else:
                client.close()

    def _transfer(self, daemon: socket.socket, request: bytes, now_ns: int) -> None:
        number, address, count = _REQUEST.unpack_from(request)
        out = request[_REQUEST.size :]
        body = self.program.state.body
        self.adc.channels_mv[0] = body.inputs.battery_mv
        turning = (body.outputs.right_steps_s - body.outputs.left_steps_s) * TURNING_RAW
        self.imu.rates[2] = round(max(-32768, min(32767, turning)))
        result = lib.fw_i2c_transfer(
            self.wires, address, out, len(out), self._bytes, count, now_ns // 1000
        )
        if result == lib.FW_I2C_STUCK:
            return
        acknowledged = result == lib.FW_I2C_ACK
        read = bytes(ffi.buffer(self._bytes, count)) if acknowledged else b""
        reply = _REPLY.pack(number, 0 if acknowledged else 1) + read
        self._replies.append((self.wires.free_us * 1000, daemon, reply))

    def _send(self, daemon: socket.socket, packet: bytes) -> bool:
        try:
            daemon.send(packet)
        except (BlockingIOError, ConnectionError):
            self.lost_bytes += len(packet)
            return False
        self.sent_bytes += len(packet)
        return True

    def _hang_up(self, daemon: socket.socket) -> None:
        self._ready.unregister(daemon)
        daemon.close()
        self._daemon.remove(daemon)
        self._replies = deque(reply for reply in self._replies if reply[1] is not daemon)

    def _plan(self) -> None:
        reply_ns = self._replies[0][0] if self._replies else None
        self.due_ns = soonest(self.program.due_ns(), reply_ns)
