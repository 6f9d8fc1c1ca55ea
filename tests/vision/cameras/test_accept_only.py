"""What the kernel lets through to a port of a camera's pictures."""

from __future__ import annotations

import socket

import pytest

from vsense.vision.cameras._networks import accept_only


def bound(host: str, port: int = 0) -> socket.socket:
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.bind((host, port))
    one.settimeout(5.0)
    return one


def test_only_the_cameras_packets_come_in() -> None:
    with bound("127.0.0.1") as mine, bound("127.0.0.1") as camera, bound("127.0.0.2") as stranger:
        port = mine.getsockname()[1]
        with bound("127.0.0.3", port) as other:  # the same number elsewhere is another port
            accept_only("127.0.0.1", port)
            for _ in range(3):
                stranger.sendto(b"rubbish", ("127.0.0.1", port))
            camera.sendto(b"picture", ("127.0.0.1", port))
            assert mine.recv(100) == b"picture"
            stranger.sendto(b"heard", ("127.0.0.3", port))
            assert other.recv(100) == b"heard"
            mine.setblocking(False)
            with pytest.raises(BlockingIOError):
                mine.recv(100)


def test_a_port_that_is_not_there_is_an_error() -> None:
    with bound("127.0.0.2") as other, pytest.raises(OSError, match="no UDP socket on port"):
        accept_only("127.0.0.1", other.getsockname()[1])
