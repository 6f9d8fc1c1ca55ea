"""This host's networks: which leads to a camera, how much it carries, what cannot be reached.

Cameras that would send more than their network carries are refused beforehand.
"""

from __future__ import annotations

import fcntl
import socket
import struct
import threading
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface, IPv4Network
from pathlib import Path

from vsense.vision.cameras.grabber import GrabberError

_ADDRESSES, _MASK = 0x8912, 0x891B
"""SIOCGIFCONF and SIOCGIFNETMASK. Source: Linux, include/uapi/linux/sockios.h."""
_REQUEST = struct.Struct("16s4s4s16x")
"""struct ifreq: interface, family and port, IPv4 address. Source: Linux, uapi/linux/if.h."""
_ROOM = 256
_ANY_PORT = 9


@dataclass(frozen=True, slots=True)
class Network:
    """An IPv4 address of this host with its prefix, and its interface, such as "eth1"."""

    name: str
    address: IPv4Interface

    def __str__(self) -> str:
        return f"{self.name} {self.address}"


def networks() -> list[Network]:
    """Returns all IPv4 addresses of this host, also several of one interface."""
    room = array("B", bytes(_ROOM * _REQUEST.size))
    place, _ = room.buffer_info()
    found = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        answer = fcntl.ioctl(asked, _ADDRESSES, struct.pack("iP", len(room), place))
        (size,) = struct.unpack_from("i", answer)
        for row in _REQUEST.iter_unpack(room.tobytes()[:size]):
            try:
                # With the address in the request, the kernel returns the mask of just that one.
                mask = _REQUEST.unpack(fcntl.ioctl(asked, _MASK, _REQUEST.pack(*row)))[2]
            except OSError:
                # The address has just been removed.
                continue
            text = f"{socket.inet_ntoa(row[2])}/{socket.inet_ntoa(mask)}"
            # A further address may have a label: "eth1:2" is an address of eth1.
            name = row[0].partition(b"\0")[0].partition(b":")[0].decode()
            found.append(Network(name, IPv4Interface(text)))
    return found


def host_address(address: str) -> str | None:
    """Returns this host's address on the way to another; None: no way leads there."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # Connecting a datagram socket chooses the route and sends nothing.
            probe.connect((address, _ANY_PORT))
        except OSError:
            return None
        return str(probe.getsockname()[0])


def interface_of(host: str) -> str | None:
    """Returns the network interface that has an address of this host."""
    mine = (each.name for each in networks() if each.address.ip == IPv4Address(host))
    return next(mine, None)


def speed_bit_s(interface: str, folder: Path = Path("/sys/class/net")) -> float | None:
    """Returns what an interface carries; None: unknown, as of loopback and Wi-Fi."""
    try:
        mbit_s = float((folder / interface / "speed").read_text())
    except (OSError, ValueError):
        return None
    return 1e6 * mbit_s if mbit_s > 0 else None


USUAL_PACKET = 1500
"""Bytes of a packet with its IP header: Ethernet's limit without jumbo frames."""

_HEADERS = 20 + 8 + 8
"""IP, UDP and GVSP. Source: GigE Vision 2.0, GVSP data block packets."""
_ETHERNET = 14 + 4 + 8 + 12
"""Header, checksum, preamble and the gap after it. Source: IEEE 802.3."""
_LEADER_AND_TRAILER = 2


class BandwidthError(GrabberError):
    """The cameras would send more than their network carries."""


@dataclass(frozen=True, slots=True)
class Stream:
    """What a camera sends: pictures of (width, height), packets in bytes with their IP header."""

    size_px: tuple[int, int]
    rate_hz: float
    packet_size: int = USUAL_PACKET
    bits_per_px: int = 8

    @property
    def bit_s(self) -> float:
        """Load of the link [bit/s], headers included."""
        picture = self.size_px[0] * self.size_px[1] * self.bits_per_px // 8
        packets = -(-picture // (self.packet_size - _HEADERS)) + _LEADER_AND_TRAILER
        return 8.0 * self.rate_hz * (picture + packets * (_HEADERS + _ETHERNET))


class NetworkLoad:
    """What each camera sends over which network; for any thread."""

    def __init__(
        self,
        way: Callable[[str], str | None] = lambda address: _interface(address),
        speed: Callable[[str], float | None] = speed_bit_s,
    ) -> None:
        """Begins without any camera.

        `way` returns the network interface that leads to an address, `speed` what it carries
        [bit/s].
        """
        self._way = way
        self._speed = speed
        self._lock = threading.Lock()
        self._streams: dict[str, tuple[str | None, Stream]] = {}

    def claim(self, camera: str, address: str, stream: Stream) -> None:
        """Notes what the camera at an IPv4 address sends from now on; replaces its earlier note.

        Raises:
            BandwidthError: The network does not carry that beside the others; nothing is noted.
        """
        with self._lock:
            others = {c: noted for c, noted in self._streams.items() if c != camera}
            interface = self._way(address)
            everybody = others | {camera: (interface, stream)}
            if interface is not None:
                self._check(interface, everybody)
            self._streams = everybody

    def _check(self, interface: str, everybody: dict[str, tuple[str | None, Stream]]) -> None:
        carried = self._speed(interface)
        loads = {c: s.bit_s for c, (way, s) in everybody.items() if way == interface}
        total = sum(loads.values())
        if carried is None or total <= carried:
            return
        parts = " + ".join(f"{bit_s / 1e6:.0f} ({c})" for c, bit_s in loads.items())
        raise BandwidthError(
            f"{interface} carries {carried / 1e6:.0f} Mbit/s, the cameras on it would send"
            f" {parts} = {total / 1e6:.0f} Mbit/s: expected a lower frame_rate, smaller pictures,"
            " or another network for some of them"
        )


def _interface(address: str) -> str | None:
    host = host_address(address)
    return None if host is None else interface_of(host)


_LINK_LOCAL = IPv4Network("169.254.0.0/16")
"""The addresses of cameras that were given none. Source: RFC 3927."""


def stranded(address: str, known: Sequence[Network]) -> str:
    """Explains a camera's IPv4 address that is on none of the `known` networks of this host.

    Returns:
        A sentence without the camera's name; "" where the address is empty or reachable.
    """
    if not address or any(IPv4Address(address) in each.address.network for each in known):
        return ""
    mine = [str(each) for each in known if not each.address.is_loopback]
    nets = f"this host is on {', '.join(mine)}" if mine else "this host is on no network"
    if IPv4Address(address) in _LINK_LOCAL:
        return (
            f"has given itself {address} because nobody gave it an address; {nets}: start a DHCP"
            " server there, give it a fixed address, or give this host one in 169.254.0.0/16"
        )
    net, _, last = address.rpartition(".")
    ours = f"{net}.{2 if last == '1' else 1}/24"
    return f"is at {address}, but {nets}: give one of the two another address, this host {ours}"
