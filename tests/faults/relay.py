"""A network of one's own between robots and host, and what befalls the packets on it.

Host and robots run in one network namespace. A robot reaches the host at an address of its own,
which leads into a TUN device; here source and destination of its packets are exchanged, which no
checksum minds, and they come back as if from that address. So every IP packet between the two, of
TCP and of UDP, passes `Relay`, which loses, delays, doubles and alters them as `Weather` says,
drawn from a seed.
"""

from __future__ import annotations

import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

NET = "10.99.0"
LOOP_NET = "127.99.0"
"""Where robots with slow clocks find their host: `vsensed` lets these be on one machine only."""
HOST = f"{NET}.1"
TCP, UDP = 6, 17

_TUNSETIFF = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
_MOST_BYTES = 65536
_ECHO_S = 0.02
_LOOP = (("del", 8), ("add", 16))


@dataclass(frozen=True)
class Weather:
    """What befalls packets that go one way.

    Attributes:
        loss, doubled, altered: shares of them. Altered ones of TCP are lost.
        delay_s, jitter_s: each is late by delay_s, and up to jitter_s more or less.
        only: of this protocol; 0: of any.
    """

    loss: float = 0.0
    doubled: float = 0.0
    altered: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    only: int = 0


CALM = Weather()


def address(place: int, net: str = NET) -> str:
    """Where the robot of this place reaches the host."""
    return f"{net}.{10 + place}"


def open_tun(net: str = NET) -> int:
    """Makes the device in this namespace, and brings it up."""
    tun = os.open("/dev/net/tun", os.O_RDWR)
    fcntl.ioctl(tun, _TUNSETIFF, struct.pack("16sH22x", b"air", _IFF_TUN | _IFF_NO_PI))
    done = [f"addr add {net}.1/24 dev air", "link set air up", "link set lo up"]
    if net == LOOP_NET:
        # Of the addresses of this machine only those below 127.1 stay where they are.
        Path("/proc/sys/net/ipv4/conf/all/route_localnet").write_text("1")
        done += [f"route {what} table local local 127.0.0.0/{bits} dev lo" for what, bits in _LOOP]
    for words in done:
        subprocess.run(["ip", *words.split()], check=True)
    return tun


class Relay:
    """Passes packets on until `close`, on a thread of its own.

    Args:
        port: the host's; what comes from it goes down to a robot, all else goes up.
        seed: of what is drawn.
        net: the host's address is the first one in it.

    Attributes:
        ears: each is called with every packet as it came, by the relay's thread.
        passed: how many packets came.
    """

    def __init__(self, port: int, seed: int, net: str = NET) -> None:
        self.ears: list[Callable[[bytes], None]] = []
        self.passed = 0
        self._port = port
        self._random = random.Random(seed)
        self._tun = open_tun(net)
        self._weather: dict[int, tuple[Weather, Weather]] = {}
        self._waiting: list[tuple[float, int, bytes]] = []
        self._ended = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended = True
        self._thread.join()
        os.close(self._tun)

    def set(self, up: Weather, down: Weather, places: Iterable[int]) -> None:
        """Changes the weather between the host and the robots of these places."""
        self._weather = {**self._weather, **dict.fromkeys(places, (up, down))}

    def calm(self) -> None:
        """From now on all packets pass; those that are late are late."""
        self._weather = {}

    def inject(self, packet: bytes) -> None:
        """Sends an IP packet as it is."""
        os.write(self._tun, packet)

    def _run(self) -> None:
        while not self._ended:
            wait_s = self._waiting[0][0] - time.monotonic() if self._waiting else 0.1
            if select.select([self._tun], [], [], min(max(wait_s, 0.0), 0.1))[0]:
                self._take(os.read(self._tun, _MOST_BYTES))
            while self._waiting and self._waiting[0][0] <= time.monotonic():
                os.write(self._tun, heapq.heappop(self._waiting)[2])

    def _take(self, packet: bytes) -> None:
        if packet[0] >> 4 != 4 or packet[9] not in (TCP, UDP):
            return
        packet = packet[:12] + packet[16:20] + packet[12:16] + packet[20:]
        for ear in self.ears:
            ear(packet)
        self.passed += 1
        source = struct.unpack_from("!H", packet, 4 * (packet[0] & 15))[0]
        both = self._weather.get(packet[15] - 10, (CALM, CALM))
        self._pass(packet, both[source == self._port])

    def _pass(self, packet: bytes, weather: Weather) -> None:
        draw = self._random.random
        if weather.only not in (0, packet[9]):
            weather = CALM
        if weather.altered and draw() < weather.altered:
            if packet[9] == TCP:
                return
            packet = self._altered(packet)
        if weather.loss and draw() < weather.loss:
            return
        late_s = weather.delay_s + weather.jitter_s * (2.0 * draw() - 1.0)
        self._send(packet, late_s)
        if weather.doubled and draw() < weather.doubled:
            self._send(packet, late_s + _ECHO_S * draw())

    def _send(self, packet: bytes, late_s: float) -> None:
        if late_s <= 0.0:
            os.write(self._tun, packet)
        else:
            due_s = time.monotonic() + late_s
            heapq.heappush(self._waiting, (due_s, self.passed, packet))

    def _altered(self, packet: bytes) -> bytes:
        """One bit of a datagram's payload is another; without a checksum it passes the system."""
        head = 4 * (packet[0] & 15) + 8
        made = bytearray(packet)
        struct.pack_into("!H", made, head - 2, 0)
        if len(made) > head:
            bit = self._random.randrange(8 * (len(made) - head))
            made[head + bit // 8] ^= 1 << bit % 8
        return bytes(made)
