"""The load of cameras on the networks that they share: what would not fit is refused beforehand."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from vsense.tracking.grabbers import GrabberError
from vsense.tracking.routes import host_address, interface_of, speed_bit_s

USUAL_PACKET = 1500
"""Bytes of a packet with its IP header where nothing larger was agreed: Ethernet's own limit."""

_HEADERS = 20 + 8 + 8
"""IP, UDP and GVSP. Source: GigE Vision 2.0, GVSP data block packets."""
_ETHERNET = 14 + 4 + 8 + 12
"""Header, checksum, preamble and the gap after it. Source: IEEE 802.3."""
_LEADER_AND_TRAILER = 2


class LinkError(GrabberError):
    """More pictures than a network carries."""


@dataclass(frozen=True, slots=True)
class Stream:
    """What a camera sends.

    Attributes:
        size_px: Width and height.
        rate_hz: Pictures per second.
        packet_size: Bytes of a packet with its IP header.
        bits_per_px: Of its pixel format.
    """

    size_px: tuple[int, int]
    rate_hz: float
    packet_size: int = USUAL_PACKET
    bits_per_px: int = 8

    @property
    def bit_s(self) -> float:
        """What it takes of the link [bit/s], with everything around the pixels."""
        picture = self.size_px[0] * self.size_px[1] * self.bits_per_px // 8
        packets = -(-picture // (self.packet_size - _HEADERS)) + _LEADER_AND_TRAILER
        return 8.0 * self.rate_hz * (picture + packets * (_HEADERS + _ETHERNET))


class Links:
    """Who sends how much over which network; for any thread."""

    def __init__(
        self,
        way: Callable[[str], str | None] = lambda address: _interface(address),
        speed: Callable[[str], float | None] = speed_bit_s,
    ) -> None:
        """Begins without any camera.

        Args:
            way: Gives the network interface that leads to an address.
            speed: Gives what an interface carries [bit/s]; None: unknown.
        """
        self._way = way
        self._speed = speed
        self._lock = threading.Lock()
        self._streams: dict[str, tuple[str | None, Stream]] = {}

    def claim(self, camera: str, address: str, stream: Stream) -> None:
        """Notes what a camera sends from now on, instead of what was noted of it before.

        Args:
            camera: Its name.
            address: Its IPv4 address.
            stream: What it sends.

        Raises:
            LinkError: The network does not carry that beside the others; nothing is noted then.
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
        raise LinkError(
            f"{interface} carries {carried / 1e6:.0f} Mbit/s, the cameras on it would send"
            f" {parts} = {total / 1e6:.0f} Mbit/s: expected a lower frame_rate, smaller pictures,"
            " or another network for some of them"
        )


def _interface(address: str) -> str | None:
    host = host_address(address)
    return None if host is None else interface_of(host)
