"""What is wrong with a camera's address: it is on none of this host's networks."""

from __future__ import annotations

from collections.abc import Sequence
from ipaddress import IPv4Address, IPv4Network

from vsense.tracking.routes import Network

_LINK_LOCAL = IPv4Network("169.254.0.0/16")
"""Where a camera puts itself when nobody gives it an address. Source: RFC 3927."""


def stranded(address: str, known: Sequence[Network]) -> str:
    """Says what to do where a camera's address is on none of this host's networks.

    Args:
        address: the camera's IPv4 address; "" has no trouble.
        known: from `vsense.tracking.routes.networks`.

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
