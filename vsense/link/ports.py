"""One port number for TCP and UDP, taken whole or not at all.

A robot needs to know one number, and two servers must never share it: with both halves of a
port in different hands the swarm would listen to one host and answer another.
"""

from __future__ import annotations

import errno
import socket
from dataclasses import dataclass
from typing import Any

from vsense.link.status import LinkError

BACKLOG = 64
"""Connections that the kernel keeps until they are accepted."""

EPHEMERAL_TRIES = 32
"""How often a free TCP port is given back because its UDP half is taken."""

_REASONS = {
    errno.EADDRINUSE: "is in use: another server runs there; stop it or choose another port",
    errno.EADDRNOTAVAIL: "is not an address of this machine",
    errno.EACCES: "needs privileges: choose a port from 1024 on",
}


@dataclass(frozen=True, slots=True)
class Ports:
    """The two non-blocking sockets of a server, both on the same port number.

    Attributes:
        tcp: the listening socket.
        udp: the datagram socket.
        port: their number.
    """

    tcp: socket.socket
    udp: socket.socket
    port: int


def bind(host: str, port: int) -> Ports:
    """Takes a port number on TCP and on UDP.

    Args:
        host: name or address of one of this machine's interfaces.
        port: the number; 0 takes any that is free on both.

    Raises:
        LinkError: the host is unknown, or another program has the number on TCP or on UDP.
    """
    family, address = _resolve(host)
    for _ in range(EPHEMERAL_TRIES):
        tcp = _open(family, socket.SOCK_STREAM, address, port)
        number = int(tcp.getsockname()[1])
        try:
            return Ports(tcp, _open(family, socket.SOCK_DGRAM, address, number), number)
        except LinkError:
            tcp.close()
            if port != 0:
                raise
    raise LinkError(f"{host}: no port is free on both TCP and UDP")


def listen(host: str, port: int) -> tuple[socket.socket, int]:
    """Takes a port number on TCP only.

    Args:
        host: name or address of one of this machine's interfaces.
        port: the number; 0 takes any that is free.

    Returns:
        The listening, non-blocking socket and its port number.

    Raises:
        LinkError: the host is unknown, or another program has the number.
    """
    family, address = _resolve(host)
    tcp = _open(family, socket.SOCK_STREAM, address, port)
    return tcp, int(tcp.getsockname()[1])


def _resolve(host: str) -> tuple[int, tuple[Any, ...]]:
    """Family and socket address of a host name; the address's second item is the port."""
    try:
        found = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as error:
        text = getattr(error, "strerror", None) or "not a host name"
        raise LinkError(f"cannot listen on '{host}': {text}") from error
    return int(found[0][0]), tuple(found[0][4])


def _open(family: int, kind: int, address: tuple[Any, ...], port: int) -> socket.socket:
    """Binds one non-blocking socket; a TCP socket listens.

    Never SO_REUSEPORT, and SO_REUSEADDR on TCP only: there it lets a restarted server pass
    connections in TIME_WAIT, on UDP it would let two servers share the port.
    """
    opened = socket.socket(family, kind)
    try:
        opened.setblocking(False)
        if kind == socket.SOCK_STREAM:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((address[0], port, *address[2:]))
        if kind == socket.SOCK_STREAM:
            opened.listen(BACKLOG)
    except OSError as error:
        opened.close()
        reason = _REASONS.get(error.errno or 0, f"cannot be used: {error.strerror}")
        layer = "TCP" if kind == socket.SOCK_STREAM else "UDP"
        raise LinkError(f"{layer} port {port} on {address[0]} {reason}") from error
    return opened
