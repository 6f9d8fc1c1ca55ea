"""GigE cameras are asked for; the answers are made by hand."""

from __future__ import annotations

import socket
import struct
import threading
from ipaddress import IPv4Interface

import pytest

from vsense.vision.cameras._networks import GIGE_PROTOCOL, ListedCamera, Network, heard, parse

LOOPBACK = Network("lo", IPv4Interface("127.0.0.1/8"))
LISTEN_S = 2.0
CAMERA = ListedCamera(
    "Allied-Vision-GC1600C-50-03",
    GIGE_PROTOCOL,
    "169.254.3.4",
    "00:0f:31:01:02:03",
    "Allied Vision",
    "GC1600C",
    "50-03",
)


def answer(status: int = 0, kind: int = 3) -> bytes:
    """What the camera says of itself, field by field as the standard lists them."""
    about = bytearray(248)
    about[0x0A:0x10] = bytes.fromhex("000f31010203")
    about[0x24:0x28] = bytes((169, 254, 3, 4))
    about[0x48:0x55] = b"Allied Vision"
    about[0x68:0x6F] = b"GC1600C"
    about[0xD8:0xDD] = b"50-03"
    return struct.pack(">HHHH", status, kind, len(about), 1) + bytes(about)


def test_an_answer_is_read() -> None:
    assert parse(answer()) == CAMERA
    assert CAMERA.id == "Allied-Vision-GC1600C-50-03"


@pytest.mark.parametrize("data", [b"", answer()[:-1], answer(status=0x8006), answer(kind=0x81)])
def test_anything_else_is_none(data: bytes) -> None:
    assert parse(data) is None


def test_every_truncation_and_flip_is_an_answer_or_none() -> None:
    for size in range(len(answer())):
        assert parse(answer()[:size]) is None
    for place in range(len(answer())):
        damaged = bytearray(answer())
        damaged[place] ^= 0xFF
        parse(bytes(damaged))


def test_a_camera_with_an_address_of_another_network_is_heard() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as camera:
        camera.bind(("", 0))
        port = camera.getsockname()[1]
        asked: list[bytes] = []

        def live() -> None:
            question, whom = camera.recvfrom(64)
            asked.append(question)
            for data in (b"noise", answer(), answer()):
                camera.sendto(data, whom)

        thread = threading.Thread(target=live, daemon=True)
        thread.start()
        gone = Network("nowhere0", IPv4Interface("10.0.0.1/24"))
        assert heard([gone, LOOPBACK], port, LISTEN_S) == [CAMERA]
        thread.join()
    assert asked == [bytes.fromhex("4211000200000001")]
