"""A stand-in for OptiTrack's Motive: NatNet 3 over UDP, as its public messages are laid out.

It answers who asks on its command port, and sends frames to a multicast group on this machine.
"""

from __future__ import annotations

import random
import socket
import struct
import threading
from collections.abc import Sequence

GROUP = "239.255.42.99"
PING, SERVER, REQUEST, MODEL, FRAME = 0, 1, 4, 5, 7

Body = tuple[str, tuple[float, float, float], tuple[float, float, float, float], bool]
"""Name, place [m], quaternion x y z w, and whether it is tracked."""


class Motive:
    """A server with named bodies; a context.

    `bodies` are sent 100 times a second, each time with other noise; None: silence.
    """

    def __init__(self, names: Sequence[str], port: int = 0) -> None:
        self.names = list(names)
        self.bodies: Sequence[Body] | None = ()
        self.asked = 0
        self._command = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._command.bind(("127.0.0.1", port))
        self._command.settimeout(0.01)
        self.port = self._command.getsockname()[1]
        self._data = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._data.setsockopt(
            socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1")
        )
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("", 0))
            self._to = GROUP, free.getsockname()[1]
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Motive:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends it; can be called again."""
        self._ended.set()
        self._thread.join()
        self._command.close()
        self._data.close()

    def _run(self) -> None:
        number = 0
        while not self._ended.is_set():
            try:
                asked, address = self._command.recvfrom(65_536)
            except TimeoutError:
                asked = b""
            if len(asked) >= 2:
                answer = {PING: self._server, REQUEST: self._model}.get(asked[0])
                if answer is not None:
                    self._command.sendto(answer(), address)
            if self.bodies is not None:
                number += 1
                self._data.sendto(self._frame(number, self.bodies), self._to)

    def _server(self) -> bytes:
        self.asked += 1
        info = b"Motive".ljust(256, b"\0") + bytes((2, 1, 0, 0)) + bytes((3, 0, 0, 0))
        info += struct.pack("<QHB", 1_000_000, self._to[1], 1) + socket.inet_aton(GROUP) + b"\0"
        return struct.pack("<HH", SERVER, len(info)) + info

    def _model(self) -> bytes:
        data = struct.pack("<i", len(self.names))
        for number, name in enumerate(self.names, 1):
            data += struct.pack("<i", 1) + name.encode() + b"\0"
            data += struct.pack("<iifffi", number, -1, 0.0, 0.0, 0.0, 0)
        return struct.pack("<HH", MODEL, len(data)) + data

    def _frame(self, number: int, bodies: Sequence[Body]) -> bytes:
        data = struct.pack("<iiii", number, 0, 0, len(bodies))
        for name, place, turn, tracked in bodies:
            id = self.names.index(name) + 1
            noisy = [along + random.gauss(0.0, 1e-5) for along in place]
            data += struct.pack("<i3f4ffh", id, *noisy, *turn, 0.001, tracked)
        data += bytes(128)
        return struct.pack("<HH", FRAME, len(data)) + data
