"""This host's networks: which leads to a camera, how much it carries, what cannot be reached.

Cameras that would send more than their network carries are refused beforehand.

Aravis waits for seconds where no camera answers, and finds only cameras whose address is on the
network that they are plugged into. `heard` also finds cameras with addresses of other networks.

Source of numbers and layouts: GigE Vision 2.0, GVCP, DISCOVERY_CMD and DISCOVERY_ACK.
"""

from __future__ import annotations

import errno
import fcntl
import os
import socket
import stat
import struct
import threading
import time
from array import array
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface, IPv4Network
from pathlib import Path

from vsense.base.errors import GrabberError
from vsense.base.terminal import printable

_ADDRESSES, _MASK = 0x8912, 0x891B
"""SIOCGIFCONF and SIOCGIFNETMASK. Source: Linux, include/uapi/linux/sockios.h."""
_REQUEST = struct.Struct("16s4s4s16x")
"""struct ifreq: interface, family and port, IPv4 address. Source: Linux, uapi/linux/if.h."""
_STEP = struct.Struct("HBBI")
_LOAD_WORD, _JUMP_IF_EQUAL, _RETURN = 0x20, 0x15, 0x06
"""Of classic BPF: struct sock_filter. Source: Linux, include/uapi/linux/filter.h."""
_SENDER = 0xFFF00000 + 12
"""The sender's address: SKF_NET_OFF and its place in the IPv4 header."""
_ATTACH_FILTER = 26
"""SO_ATTACH_FILTER. Source: Linux, include/uapi/asm-generic/socket.h."""
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
    addresses = []
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
            addresses.append(Network(name, IPv4Interface(text)))
    return addresses


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
    mine = (network.name for network in networks() if network.address.ip == IPv4Address(host))
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
            remaining = {c: noted for c, noted in self._streams.items() if c != camera}
            interface = self._way(address)
            everybody = remaining | {camera: (interface, stream)}
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


def stranded(address: str, own: Sequence[Network]) -> str:
    """Explains a camera's IPv4 address that is on none of this host's `own` networks.

    Returns:
        A sentence without the camera's name; "" where the address is empty or reachable.
    """
    if not address or any(IPv4Address(address) in network.address.network for network in own):
        return ""
    mine = [str(network) for network in own if not network.address.is_loopback]
    nets = f"this host is on {', '.join(mine)}" if mine else "this host is on no network"
    if IPv4Address(address) in _LINK_LOCAL:
        return (
            f"has given itself {address} because nobody gave it an address; {nets}: start a DHCP"
            " server there, give it a fixed address, or give this host one in 169.254.0.0/16"
        )
    net, _, last = address.rpartition(".")
    ours = f"{net}.{2 if last == '1' else 1}/24"
    return f"is at {address}, but {nets}: give one of the two another address, this host {ours}"


PORT = 3956
CONTROL = 0x0A00
"""The register of who controls the camera. Source: GigE Vision 2.0, CCP."""
IN_CONTROL = 0b11
"""Its bits for exclusive access and for control."""

GIGE_PROTOCOL = "GigEVision"
USB3_PROTOCOL = "USB3Vision"
"""Protocols, as Aravis calls them."""

CAMERA_HELD = "another program controls it, or did until seconds ago"

_VERSION = 0x0000
_ASK_AGAIN = 3
_WAIT_S = 0.15
_ANSWER_BYTES = 12


def answers(address: str) -> bool:
    """Whether a GigE camera answers at an address; asks for half a second at most."""
    return _read(address, _VERSION) is not None


def accept_only(address: str, port: int) -> None:
    """Has the kernel drop what comes from other addresses to one of this program's UDP ports.

    Raises:
        OSError: the program has no such port, or the kernel takes no filter.
    """
    program = b"".join(_STEP.pack(*step) for step in (
        (_LOAD_WORD, 0, 0, _SENDER),
        (_JUMP_IF_EQUAL, 0, 1, int(IPv4Address(address))),
        (_RETURN, 0, 0, 0xFFFFFFFF),
        (_RETURN, 0, 0, 0),
    ))  # fmt: skip
    place = array("B", program)
    hosts = ("0.0.0.0", host_address(address))
    wanted = struct.pack("HP", len(program) // _STEP.size, place.buffer_info()[0])
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # closed meanwhile, or no socket
            if stat.S_ISSOCK(os.stat(int(name)).st_mode):
                with socket.socket(fileno=os.dup(int(name))) as mine:
                    is_udp = (mine.family, mine.type) == (socket.AF_INET, socket.SOCK_DGRAM)
                    # Ports of the same number on other addresses are other ports.
                    if is_udp and mine.getsockname() in [(host, port) for host in hosts]:
                        mine.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, wanted)
                        return
    raise OSError(errno.ENOENT, f"no UDP socket on port {port} takes a filter")


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
        protocol: `GIGE_PROTOCOL` or `USB3_PROTOCOL`.
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
    own: Sequence[Network] | None = None, port: int = PORT, listen_s: float = LISTEN_S
) -> list[ListedCamera]:
    """Asks through all interfaces at once; takes `listen_s`.

    `own` are this host's networks, which are looked up where it is None; `port` is the cameras'.
    """
    cameras: dict[ListedCamera, None] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ears:
        ears.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        ears.bind(("", 0))
        for network in networks() if own is None else own:
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
                cameras[camera] = None
    return sorted(cameras, key=lambda camera: (camera.id, camera.mac))


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
    return ListedCamera(id, GIGE_PROTOCOL, socket.inet_ntoa(address), mac.hex(":"), *texts)


def _ask(ears: socket.socket, network: Network, port: int) -> None:
    """Asks all cameras that are plugged into one interface."""
    interface = socket.if_nametoindex(network.name)
    way = struct.pack("i4s4x", interface, network.address.ip.packed)
    ears.sendmsg([_QUESTION], [(socket.IPPROTO_IP, _IP_PKTINFO, way)], 0, (_EVERYBODY, port))


def _text(field: bytes) -> str:
    return printable(field.partition(b"\0")[0].decode(errors="replace").strip())
