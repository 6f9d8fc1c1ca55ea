"""The networks that this host is on, and what is wrong with a camera's address."""

from __future__ import annotations

import fcntl
import socket
import struct
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface, IPv4Network

_ADDRESSES, _MASK = 0x8912, 0x891B
"""SIOCGIFCONF and SIOCGIFNETMASK. Source: Linux, include/uapi/linux/sockios.h."""
_REQUEST = struct.Struct("16s4s4s16x")
"""struct ifreq with an IPv4 address: the interface's name, family and port, address. Source:
Linux, include/uapi/linux/if.h."""
_ROOM = 256

_LINK_LOCAL = IPv4Network("169.254.0.0/16")
"""Where a camera puts itself when nobody gives it an address. Source: RFC 3927."""


@dataclass(frozen=True, slots=True)
class Network:
    """An IPv4 address of this host.

    Attributes:
        name: the interface's name, such as "eth1".
        address: the host's address there, with the network's prefix.
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
            # Asked with the address, the kernel tells the mask of just that one.
            mask = _REQUEST.unpack(fcntl.ioctl(asked, _MASK, _REQUEST.pack(*row)))[2]
            text = f"{socket.inet_ntoa(row[2])}/{socket.inet_ntoa(mask)}"
            found.append(Network(row[0].partition(b"\0")[0].decode(), IPv4Interface(text)))
    return found


def stranded(address: str, known: Sequence[Network]) -> str:
    """Says what to do where a camera's address is on none of this host's networks.

    Args:
        address: the camera's IPv4 address; "" has no trouble.
        known: from `networks`.

    Returns:
        A sentence without the camera's name, or "".
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
