"""Arena states, and a client and a tracker of the original system that share no code with ours.

Both know the protocol from iridia.md section 1a alone. Nothing here sleeps.
"""

from __future__ import annotations

import socket
import struct
import threading

import numpy as np

from vsense.base.arena import POSE, ArenaState

PATIENCE_S = 20.0
START, STOP, ONE_SHOT = 0, 1, 2


def state(timestep: int, *robots: tuple[int, float, float, float], unseen: tuple[int, ...] = ()):
    """Returns an arena state of robots (tag, x, y, yaw) at `timestep`."""
    poses = np.zeros(len(robots), dtype=POSE)
    for row, (tag, x_m, y_m, yaw_rad) in zip(poses, robots):
        row["tag"], row["x_m"], row["y_m"], row["yaw_rad"] = tag, x_m, y_m, yaw_rad
        row["seen"] = tag not in unseen
    return ArenaState(timestep, 1000 + timestep, poses, len(robots))


def locate(robots: np.ndarray) -> np.ndarray:
    """Stands in for the cameras: the picture's pose follows from the tag."""
    return np.array([(row["tag"] + 0.5, 2.0 * row["tag"] + 0.25, -45.0) for row in robots]).reshape(
        -1, 3
    )


def message(text: str) -> bytes:
    """Returns the bytes of an arena state."""
    return struct.pack(">I", len(text)) + text.encode("ascii")


def exactly(sock: socket.socket, count: int) -> bytes:
    """Reads that many bytes, fewer only at the end of the stream."""
    data = b""
    while len(data) < count and (more := sock.recv(count - len(data))):
        data += more
    return data


class OldClient:
    """A client of the original system."""

    def __init__(self, port: int, receive_buffer: int | None = None) -> None:
        self.sock = socket.socket()
        if receive_buffer is not None:
            self.sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.sock.settimeout(PATIENCE_S)
        self.sock.connect(("127.0.0.1", port))

    def send(self, *commands: int) -> None:
        self.sock.sendall(struct.pack(f">{len(commands)}I", *commands))

    def read(self) -> str | None:
        """Reads a state; "" is the end of a run, None the end of the stream."""
        head = exactly(self.sock, 4)
        return exactly(self.sock, struct.unpack(">I", head)[0]).decode() if head else None

    def timestep(self) -> int:
        text = self.read()
        assert text
        return int(text.split(" ")[0])

    def close(self) -> None:
        self.sock.close()


class OldTracker:
    """A tracking server of the original system, played by the test."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(PATIENCE_S)
        self.port = self._listener.getsockname()[1]
        self.sock = socket.socket()

    def accept(self) -> None:
        self.sock, _ = self._listener.accept()
        self.sock.settimeout(PATIENCE_S)
        self.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def command(self) -> int:
        return int(struct.unpack(">I", exactly(self.sock, 4))[0])

    def send(self, text: str) -> None:
        self.sock.sendall(message(text))

    def hang_up(self) -> None:
        self.sock.close()

    def close(self) -> None:
        self.sock.close()
        self._listener.close()


class Told:
    """The lines for a person; they can be waited for."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._news = threading.Condition()

    def __call__(self, line: str) -> None:
        with self._news:
            self.lines.append(line)
            self._news.notify_all()

    def wait(self, part: str, times: int = 1) -> None:
        """Waits until `part` was told that often."""
        with self._news:
            enough = lambda: sum(part in line for line in self.lines) >= times  # noqa: E731
            assert self._news.wait_for(enough, PATIENCE_S), self.lines
