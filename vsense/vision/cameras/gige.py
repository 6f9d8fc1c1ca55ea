"""GVCP: quick questions to GigE cameras, which need neither Aravis nor control of the camera.

Aravis waits for seconds where no camera answers, and finds only cameras whose address is on the
network that they are plugged into. `heard` also finds cameras with addresses of other networks.

Source of numbers and layouts: GigE Vision 2.0, GVCP, DISCOVERY_CMD and DISCOVERY_ACK.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from vsense.base.terminal import printable
from vsense.vision.cameras.networks import Network, networks

PORT = 3956
CONTROL = 0x0A00
"""The register of who controls the camera. Source: GigE Vision 2.0, CCP."""
IN_CONTROL = 0b11
"""Its bits for exclusive access and for control."""

GIGE = "GigEVision"
USB3 = "USB3Vision"
"""Protocols, as Aravis calls them."""

HELD = "another program controls it, or did until seconds ago"

_VERSION = 0x0000
_ASK_AGAIN = 3
_WAIT_S = 0.15
_ANSWER_BYTES = 12


def answers(address: str) -> bool:
    """Whether a GigE camera answers at an address; asks for half a second at most."""
    return _read(address, _VERSION) is not None


def controlled(address: str) -> bool:
    """Whether a program controls the GigE camera at an address.

    Cameras may take this question for a sign of life of that program: do not ask often while
    waiting for a dead program to lose control.
    """
    answer = _read(address, CONTROL) or b""
    # A camera that refuses the question counts as free: opening it gives the reason.
    return len(answer) >= _ANSWER_BYTES and bool(answer[_ANSWER_BYTES - 1] & IN_CONTROL)


def _read(address: str, register: int) -> bytes | None:
    """Reads a register, which needs no control; None: no answer."""
    question = struct.pack(">BBHHHI", 0x42, 0x01, 0x0080, 4, 1, register)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.settimeout(_WAIT_S)
        for _ in range(_ASK_AGAIN):
            try:
                line.connect((address, PORT))
                line.send(question)
                return line.recv(64)
            except OSError:
                # No answer, or no such host.
                continue
    return None


LISTEN_S = 0.6
"""A camera answers within half a second."""

_EVERYBODY = "255.255.255.255"
_ACKNOWLEDGE, _TO_EVERYBODY = 0x01, 0x10
_QUESTION = struct.pack(">BBHHH", 0x42, _ACKNOWLEDGE | _TO_EVERYBODY, 0x0002, 0, 1)
_HEAD = struct.Struct(">HHHH")
_ANSWER = 0x0003
_ABOUT = struct.Struct(">10x6s20x4s32x32s32s32x48x16s16s")
"""MAC address, present IP address, manufacturer, model, serial number, the user's name."""
_IP_PKTINFO = 8
"""Says through which interface a datagram leaves. Source: Linux, ip(7)."""


@dataclass(frozen=True, slots=True)
class ListedCamera:
    """A GigE or USB3 Vision camera that has answered.

    Attributes:
        id: Vendor, model and serial number, as Aravis puts them together.
        protocol: `GIGE` or `USB3`.
        address: IPv4 address; empty for USB3.
        mac: A unique MAC address, or the GUID of USB3.
    """

    id: str
    protocol: str
    address: str
    mac: str
    vendor: str
    model: str
    serial: str

    @property
    def names(self) -> tuple[str, ...]:
        """All names that a configuration may use."""
        return tuple(filter(None, (self.id, self.serial, self.mac, self.address)))


def several(what: str, cameras: Sequence[ListedCamera]) -> str:
    """Error text for cameras that share what only one may have."""
    who = " and ".join(f"{camera.id} ({camera.mac})" for camera in cameras)
    return f"{len(cameras)} cameras have {what}: {who}; expected one of its own each"


def heard(
    known: Sequence[Network] | None = None, port: int = PORT, listen_s: float = LISTEN_S
) -> list[ListedCamera]:
    """Asks through all interfaces at once; takes `listen_s`.

    `known` are this host's networks, which are looked up where it is None; `port` is the cameras'.
    """
    found: dict[ListedCamera, None] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ears:
        ears.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        ears.bind(("", 0))
        for network in networks() if known is None else known:
            # An interface may be down or behind a firewall; the others are still asked.
            with suppress(OSError):
                _ask(ears, network, port)
        end_s = time.monotonic() + listen_s
        while (left_s := end_s - time.monotonic()) > 0.0:
            ears.settimeout(left_s)
            try:
                camera = parse(ears.recv(2048))
            except OSError:
                continue
            if camera is not None:
                found[camera] = None
    return sorted(found, key=lambda camera: (camera.id, camera.mac))


def parse(data: bytes) -> ListedCamera | None:
    """Reads an answer; None: it is none."""
    if len(data) < _HEAD.size + _ABOUT.size:
        return None
    status, answer, _, _ = _HEAD.unpack_from(data)
    if status != 0 or answer != _ANSWER:
        return None
    mac, address, vendor, model, serial, _ = _ABOUT.unpack_from(data, _HEAD.size)
    texts = _text(vendor), _text(model), _text(serial)
    id = "-".join(" ".join(texts).split())
    return ListedCamera(id, GIGE, socket.inet_ntoa(address), mac.hex(":"), *texts)


def _ask(ears: socket.socket, network: Network, port: int) -> None:
    """Asks all cameras that are plugged into one interface."""
    interface = socket.if_nametoindex(network.name)
    way = struct.pack("i4s4x", interface, network.address.ip.packed)
    ears.sendmsg([_QUESTION], [(socket.IPPROTO_IP, _IP_PKTINFO, way)], 0, (_EVERYBODY, port))


def _text(field: bytes) -> str:
    return printable(field.partition(b"\0")[0].decode(errors="replace").strip())
