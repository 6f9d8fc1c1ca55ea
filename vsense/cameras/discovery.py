"""Asks for GigE cameras on every network, and hears those with addresses of other networks, too.

Aravis hears a camera only if its address is on the network that it is plugged into. The classic
fault of the first day is one that is not: asked here, such a camera answers to everybody.

Source of numbers and layouts: GigE Vision 2.0, GVCP, DISCOVERY_CMD and DISCOVERY_ACK.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from vsense.tracking.gvcp import PORT
from vsense.tracking.routes import Network, networks

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
class Heard:
    """A camera that has answered.

    Attributes:
        address: its IPv4 address.
        mac: its MAC address.
        vendor: who made it.
        model: its type.
        serial: its serial number.
    """

    address: str
    mac: str
    vendor: str
    model: str
    serial: str

    @property
    def id(self) -> str:
        """Vendor, model and serial number, as Aravis puts them together."""
        return "-".join(f"{self.vendor} {self.model} {self.serial}".split())


def heard(
    known: Sequence[Network] | None = None, port: int = PORT, listen_s: float = LISTEN_S
) -> list[Heard]:
    """Asks through all interfaces at once; takes `listen_s`.

    Args:
        known: this host's networks; None: asks for them, too.
        port: where cameras listen.
        listen_s: how long answers are waited for.
    """
    found: dict[Heard, None] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ears:
        ears.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        ears.bind(("", 0))
        for network in networks() if known is None else known:
            # An interface that is down, or a firewall: the others are asked all the same.
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


def parse(data: bytes) -> Heard | None:
    """Reads an answer; None: it is none."""
    if len(data) < _HEAD.size + _ABOUT.size:
        return None
    status, answer, _, _ = _HEAD.unpack_from(data)
    if status != 0 or answer != _ANSWER:
        return None
    mac, address, vendor, model, serial, _ = _ABOUT.unpack_from(data, _HEAD.size)
    return Heard(
        socket.inet_ntoa(address), mac.hex(":"), _text(vendor), _text(model), _text(serial)
    )


def _ask(ears: socket.socket, network: Network, port: int) -> None:
    """Asks everybody who is plugged into one interface."""
    interface = socket.if_nametoindex(network.name)
    way = struct.pack("i4s4x", interface, network.address.ip.packed)
    ears.sendmsg([_QUESTION], [(socket.IPPROTO_IP, _IP_PKTINFO, way)], 0, (_EVERYBODY, port))


def _text(field: bytes) -> str:
    return field.partition(b"\0")[0].decode(errors="replace").strip()
