"""The control protocol of GigE Vision, spoken without Aravis: the second reader of cameras.

Source: GigE Vision 1.2, sections 14 (packets) and 17 (bootstrap registers); Aravis,
arvfakecamera.h (the simulator's own registers).
"""

from __future__ import annotations

import socket
import struct
import time

PORT = 3956
READ, WRITE = 0x0080, 0x0082
TRY_S, PATIENCE_S = 0.1, 60.0
CONTROLLED, HEARTBEAT_MS = 0xA00, 0x938
CONTROL = 2
REGISTERS = {
    "width": 0x100,
    "height": 0x104,
    "binning_horizontal": 0x108,
    "gain_raw": 0x110,
    "gain_auto": 0x114,
    "sensor_height": 0x118,
    "sensor_width": 0x11C,
    "exposure_us": 0x120,
    "pixel_format": 0x128,
    "offset_x": 0x130,
    "offset_y": 0x134,
    "period_us": 0x138,
    "trigger_mode": 0x300,
    "trigger_source": 0x304,
    "controlled": CONTROLLED,
    "packet_size": 0xD04,
    "packet_delay": 0xD08,
}


class Reader:
    """Reads a camera's registers, which anybody may; a camera's controller may write them, too."""

    def __init__(self, address: str) -> None:
        """Looks up nothing yet."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect((address, PORT))
        self._socket.settimeout(TRY_S)
        self._number = 0

    def read(self, address: int) -> int:
        """Reads a register."""
        (value,) = struct.unpack(">I", self._ask(READ, struct.pack(">I", address)))
        return value

    def all(self) -> dict[str, int]:
        """Reads those of `REGISTERS`; the packet size without its flags."""
        values = {name: self.read(address) for name, address in REGISTERS.items()}
        return values | {"packet_size": values["packet_size"] & 0xFFFF}

    def take(self) -> None:
        """Takes control of the camera, for ten minutes without a word."""
        self._write(CONTROLLED, CONTROL)
        self._write(HEARTBEAT_MS, 600_000)

    def release(self) -> None:
        """Gives control back."""
        self._write(HEARTBEAT_MS, 3000)
        self._write(CONTROLLED, 0)

    def close(self) -> None:
        """Ends reading."""
        self._socket.close()

    def _write(self, address: int, value: int) -> None:
        self._ask(WRITE, struct.pack(">II", address, value))

    def _ask(self, command: int, words: bytes) -> bytes:
        """Asks until the camera answers: on UDP anything can be lost."""
        self._number = self._number % 0xFFFF + 1
        packet = struct.pack(">BBHHH", 0x42, 1, command, len(words), self._number) + words
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            try:
                self._socket.send(packet)
                while True:
                    answer = self._socket.recv(1024)
                    status, kind, length, number = struct.unpack(">HHHH", answer[:8])
                    if number == self._number and kind == command + 1:
                        assert status == 0, f"refused with status {status:04x}"
                        return answer[8 : 8 + length]
            except (TimeoutError, ConnectionRefusedError):
                continue
        raise AssertionError(f"camera {self._socket.getpeername()[0]} does not answer")
