"""A USB adapter for I2C, plugged into the emulated board: its other end is an emulated robot.

QEMU's `usb-redir` device speaks the usbredir protocol over a socket; this end is an i2c-tiny-usb
adapter (0403:c631), for which stock kernels have a driver. So the board has a real /dev/i2c-N,
and each of its transactions goes to the Unix socket that stands for a robot's bus
(firmware_bridge/README.md).

Source: usbredir-protocol.txt of spice's usbredir; drivers/i2c/busses/i2c-tiny-usb.c of Linux.
"""

from __future__ import annotations

import socket
import struct
import threading

HELLO, CONNECT, INTERFACES, ENDPOINTS = 0, 1, 4, 5
SET_CONFIGURATION, GET_CONFIGURATION, CONFIGURATION = 6, 7, 8
SET_ALT, GET_ALT, ALT, CONTROL = 9, 10, 11, 100
STALL = 3

CAPABILITIES = 1 << 1 | 1 << 4 | 1 << 5 | 1 << 6
"""Versions in CONNECT, packet sizes, 64-bit ids, 32-bit lengths: what QEMU's xHCI insists on."""

VENDOR, PRODUCT, VERSION = 0x0403, 0xC631, 0x0205
DEVICE = struct.pack(
    "<BBHBBBBHHHBBBB", 18, 1, 0x110, 255, 0, 0, 8, VENDOR, PRODUCT, VERSION, 1, 2, 0, 1
)
CONFIG = struct.pack("<BBHBBBBB", 9, 2, 18, 1, 1, 0, 0x80, 50)
CONFIG += struct.pack("<BBBBBBBBB", 9, 4, 0, 0, 0, 255, 0, 0, 0)

GET_FUNC, GET_STATUS, IO, END = 1, 3, 4, 2
IDLE, ACKNOWLEDGED, REFUSED = 0, 1, 2
I2C_FUNCTIONS = 0x0EFF0001

ANSWER_S = 0.02
"""A bus that does not answer within a transaction's longest time is stuck."""


class Wires:
    """The robot's end: transactions over its socket, as vsensed itself would make them."""

    def __init__(self, path: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.connect(path)
        self._greeted = False
        self._number = 0

    def transfer(self, address: int, out: bytes, count: int) -> bytes | None:
        """Writes, then reads after a repeated START; None: not acknowledged, or stuck."""
        self._socket.settimeout(10.0 if not self._greeted else ANSWER_S)
        if not self._greeted:
            self._socket.recv(16)
            self._greeted = True
            self._socket.settimeout(ANSWER_S)
        self._number += 1
        self._socket.send(struct.pack("<IBB", self._number, address, count) + out)
        try:
            while (reply := self._socket.recv(256)) and reply[:4] != struct.pack(
                "<I", self._number
            ):
                pass
        except TimeoutError:
            return None
        return reply[5:] if len(reply) >= 5 and reply[4] == 0 else None

    def close(self) -> None:
        self._socket.close()


class TinyUsb:
    """The adapter's own protocol, in control transfers."""

    def __init__(self, wires: Wires) -> None:
        self._wires = wires
        self._status = IDLE
        self._held = b""
        self.transactions = 0

    def control(self, kind: int, request: int, value: int, index: int, data: bytes, length: int):
        """One control transfer; gives what is read, None for what it does not know."""
        if kind & 0x60 == 0x40:
            return self._vendor(kind, request, index, data, length)
        if kind == 0x80 and request == 6:
            return self._descriptor(value >> 8, value & 255)
        return b"\0\0" if kind == 0x80 and request == 0 else b""

    def _descriptor(self, kind: int, index: int) -> bytes | None:
        if kind == 3:
            text = (
                ("robot", "i2c-robot")[min(index, 2) - 1].encode("utf-16le")
                if index
                else b"\x09\x04"
            )
            return bytes([len(text) + 2, 3]) + text
        return {1: DEVICE, 2: CONFIG}.get(kind)

    def _vendor(
        self, kind: int, request: int, index: int, data: bytes, length: int
    ) -> bytes | None:
        if request == GET_FUNC:
            return struct.pack("<I", I2C_FUNCTIONS)
        if request == GET_STATUS:
            return bytes([self._status])
        if not request & IO:
            return b""
        reads = bool(kind & 0x80)
        if not reads and not request & END:
            # What a read after a repeated START belongs to: it goes out together with that.
            self._held, self._status = data, ACKNOWLEDGED
            return b""
        self.transactions += 1
        out = self._held if reads else data
        answer = self._wires.transfer(index, out, length if reads else 0)
        self._held = b""
        self._status = REFUSED if answer is None else ACKNOWLEDGED
        return answer if answer is not None else bytes(length if reads else 0)


class UsbBus(threading.Thread):
    """The plug: answers QEMU on a Unix socket until it hangs up."""

    def __init__(self, listener: socket.socket, robot: str) -> None:
        super().__init__(daemon=True)
        self._listener = listener
        self._wires = Wires(robot)
        self.adapter = TinyUsb(self._wires)

    def run(self) -> None:
        qemu, _ = self._listener.accept()
        self._listener.close()
        with qemu:
            self._qemu = qemu
            # The first message has a 32-bit id; from then on both sides use 64 bits.
            self._send(
                HELLO, 0, b"robot".ljust(64, b"\0") + struct.pack("<I", CAPABILITIES), "<III"
            )
            kind, size, _ = struct.unpack("<III", self._read(12))
            assert kind == HELLO
            self._read(size)
            self._plug_in()
            while header := self._read(16):
                kind, size, number = struct.unpack("<IIQ", header)
                self._answer(kind, number, self._read(size))
        self._wires.close()

    def _plug_in(self) -> None:
        none = bytes(31)
        rest = (b"\0" + none) + (b"\xff" + none) + (b"\0" + none) * 2
        self._send(INTERFACES, 0, struct.pack("<I", 1) + rest)
        kinds, sizes = bytearray(b"\xff" * 32), [0] * 32
        kinds[0] = kinds[16] = 0
        sizes[0] = sizes[16] = 8
        self._send(ENDPOINTS, 0, bytes(kinds) + bytes(64) + struct.pack("<32H", *sizes))
        self._send(CONNECT, 0, struct.pack("<BBBBHHH", 1, 255, 0, 0, VENDOR, PRODUCT, VERSION))

    def _answer(self, kind: int, number: int, body: bytes) -> None:
        if kind == SET_CONFIGURATION:
            self._send(CONFIGURATION, number, bytes([0, body[0]]))
        elif kind == GET_CONFIGURATION:
            self._send(CONFIGURATION, number, bytes([0, 1]))
        elif kind == SET_ALT:
            self._send(ALT, number, bytes([0, body[0], body[1]]))
        elif kind == GET_ALT:
            self._send(ALT, number, bytes([0, body[0], 0]))
        elif kind == CONTROL:
            self._control(number, body)

    def _control(self, number: int, body: bytes) -> None:
        endpoint, request, kind, _, value, index, length = struct.unpack_from("<BBBBHHH", body)
        read = self.adapter.control(kind, request, value, index, body[10:], length)
        status = STALL if read is None else 0
        data = (read or b"")[:length] if kind & 0x80 else b""
        done = len(data) if kind & 0x80 else length if read is not None else 0
        head = struct.pack("<BBBBHHH", endpoint, request, kind, status, value, index, done)
        self._send(CONTROL, number, head + data)

    def _send(self, kind: int, number: int, body: bytes, header: str = "<IIQ") -> None:
        self._qemu.sendall(struct.pack(header, kind, len(body), number) + body)

    def _read(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            try:
                more = self._qemu.recv(count - len(data))
            except ConnectionError:
                return b""
            if not more:
                return b""
            data += more
        return data
