"""Which of this machine's networks leads to a camera, and how much that carries."""

from __future__ import annotations

import fcntl
import socket
import struct
from pathlib import Path

_GET_ADDRESS = 0x8915
"""SIOCGIFADDR. Source: Linux, netdevice(7)."""
_ANY_PORT = 9


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
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        for _, name in socket.if_nameindex():
            question = struct.pack("256s", name.encode()[:15])
            try:
                answer = fcntl.ioctl(any_socket, _GET_ADDRESS, question)
            except OSError:
                continue
            if socket.inet_ntoa(answer[20:24]) == host:
                return name
    return None


def speed_bit_s(interface: str, folder: Path = Path("/sys/class/net")) -> float | None:
    """Gives what an interface carries; None: it does not say, as loopback and Wi-Fi do not."""
    try:
        mbit_s = float((folder / interface / "speed").read_text())
    except (OSError, ValueError):
        return None
    return 1e6 * mbit_s if mbit_s > 0 else None
