"""Which of this machine's networks leads to a camera, and how much that carries."""

from __future__ import annotations

import fcntl
import socket
import struct
from array import array
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path

_ADDRESSES, _MASK = 0x8912, 0x891B
"""SIOCGIFCONF and SIOCGIFNETMASK. Source: Linux, include/uapi/linux/sockios.h."""
_REQUEST = struct.Struct("16s4s4s16x")
"""struct ifreq with an IPv4 address: the interface's name, family and port, address. Source:
Linux, include/uapi/linux/if.h."""
_ROOM = 256
_ANY_PORT = 9


@dataclass(frozen=True, slots=True)
class Network:
    """An IPv4 address of this host.

    Attributes:
        name: The interface's name, such as "eth1".
        address: The host's address there, with the network's prefix.
    """

    name: str
    address: IPv4Interface

    def __str__(self) -> str:
        return f"{self.name} {self.address}"


def networks() -> list[Network]:
    """Gives all IPv4 addresses of this host, also where one interface has several."""
    room = array("B", bytes(_ROOM * _REQUEST.size))
    place, _ = room.buffer_info()
    found = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        answer = fcntl.ioctl(asked, _ADDRESSES, struct.pack("iP", len(room), place))
        (size,) = struct.unpack_from("i", answer)
        for row in _REQUEST.iter_unpack(room.tobytes()[:size]):
            try:
                # Asked with the address, the kernel tells the mask of just that one.
                mask = _REQUEST.unpack(fcntl.ioctl(asked, _MASK, _REQUEST.pack(*row)))[2]
            except OSError:
                # It was taken away a moment ago.
                continue
            text = f"{socket.inet_ntoa(row[2])}/{socket.inet_ntoa(mask)}"
            # A further address may have a label: "eth1:2" is an address of eth1.
            name = row[0].partition(b"\0")[0].partition(b":")[0].decode()
            found.append(Network(name, IPv4Interface(text)))
    return found


def host_address(address: str) -> str | None:
    """Gives the address that this machine has on the way to another; None: no way leads there."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # Of a datagram socket this only chooses the way: nothing is sent.
            probe.connect((address, _ANY_PORT))
        except OSError:
            return None
        return str(probe.getsockname()[0])


def interface_of(host: str) -> str | None:
    """Gives the name of the network interface that has an address of this machine."""
    mine = (each.name for each in networks() if each.address.ip == IPv4Address(host))
    return next(mine, None)


def speed_bit_s(interface: str, folder: Path = Path("/sys/class/net")) -> float | None:
    """Gives what an interface carries; None: it does not say, as loopback and Wi-Fi do not."""
    try:
        mbit_s = float((folder / interface / "speed").read_text())
    except (OSError, ValueError):
        return None
    return 1e6 * mbit_s if mbit_s > 0 else None
