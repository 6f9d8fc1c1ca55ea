"""Packets of protocol version 3 as Python values; every byte of them is made and read in C.

`c_src/PROTOCOL.md` specifies them. Times are integer ns, each of the clock that its field names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

from vsense.base.native import WireError, check, ffi, lib
from vsense.robots.link.table import Output, Table, numbers_of, text_of

PACKET_MAX: int = lib.VS_PACKET_MAX
DATAGRAM_MAX: int = lib.VS_DATAGRAM_MAX
TEXT_MAX: int = lib.VS_TEXT_MAX
PUBLISHED = bytes(ffi.buffer(lib.vs_key_published, lib.VS_KEY_SIZE))
"""The key of those that have none: its tag shows damage, and proves nothing."""
NEVER_US: int = lib.VS_NEVER_US
"""Age of a value that was never measured."""

ReadingValues = Sequence[tuple[bytes, int]]
"""One robot's readings in the table's order: payload, capture time (ns, host's; < 0: never)."""

ShownData = tuple[tuple[str, float | str], ...]
"""What a controller shows: names, each with a number or a text."""


class PacketType(IntEnum):
    """What a packet is."""

    HELLO = lib.VS_HELLO
    WELCOME = lib.VS_WELCOME
    REFUSE = lib.VS_REFUSE
    GOODBYE = lib.VS_GOODBYE
    STATE = lib.VS_STATE
    TELEMETRY = lib.VS_TELEMETRY


class Wanted(IntEnum):
    """Run state, wanted by the host and actual on the robot."""

    IDLE = lib.VS_IDLE
    RUN = lib.VS_RUN
    PAUSE = lib.VS_PAUSE
    STOP = lib.VS_STOP
    HOME = lib.VS_HOME


class RefuseCode(IntEnum):
    """Why the host gives a robot no session."""

    TAG_IN_USE = lib.VS_REFUSE_TAG_IN_USE
    TAG_UNKNOWN = lib.VS_REFUSE_TAG_UNKNOWN
    FULL = lib.VS_REFUSE_FULL
    HELLO = lib.VS_REFUSE_HELLO
    ROOM = lib.VS_REFUSE_ROOM
    CONTROLLER = lib.VS_REFUSE_CONTROLLER
    KEY = lib.VS_REFUSE_KEY


class GoodbyeCause(IntEnum):
    """Why a session ends."""

    END = lib.VS_BYE_END
    TAKEN_OVER = lib.VS_BYE_TAKEN_OVER
    SILENT = lib.VS_BYE_SILENT
    RENEW = lib.VS_BYE_RENEW
    PROTOCOL = lib.VS_BYE_PROTOCOL
    BASE = lib.VS_BYE_BASE


class StopCause(IntEnum):
    """Why a robot's wheels are held at 0. A newer robot may send a number that is not here."""

    NONE = lib.VS_CAUSE_NONE
    WANTED = lib.VS_CAUSE_WANTED
    NO_SESSION = lib.VS_CAUSE_NO_SESSION
    STALE = lib.VS_CAUSE_STALE
    NO_BEAT = lib.VS_CAUSE_NO_BEAT
    BASE = lib.VS_CAUSE_BASE
    GUARD = lib.VS_CAUSE_GUARD
    SIGNAL = lib.VS_CAUSE_SIGNAL
    BATTERY = lib.VS_CAUSE_BATTERY


class Header(NamedTuple):
    """A packet's header; `struct vs_header` in `c_src/vs_wire.h` explains the fields."""

    type: int
    flags: int = 0
    length: int = 0
    session: int = 0
    sequence: int = 0
    run: int = 0
    timestep: int = 0
    capture_ns: int = 0
    send_ns: int = 0
    echo_ns: int = 0
    hold_us: int = 0
    table_hash: int = 0


@dataclass(frozen=True, slots=True)
class Hello:
    """A robot's greeting.

    Attributes:
        uid: 16 bytes, who the robot is, for good.
        tag: marker on its back.
        name, controller: for people; as all texts here, at most 31 bytes of UTF-8.
        version, hash: of the robot's software, and of the controller's source, if known.
        nonce: 16 random bytes of this connection.
        started: random, of this start of the daemon: its counters and log lines begin with it.
        uptime_s: [s] since the board started.
        capabilities: bit 0: it has a key, and obeys only a host that has it, too.
        params_room, entries_room, datagram_room: what the robot can hold: [byte] of parameters,
            entries of a table, [byte] of a STATE and of a TELEMETRY.
    """

    uid: bytes
    tag: int
    name: str
    controller: str
    version: str = ""
    hash: str = ""
    nonce: bytes = bytes(16)
    started: int = 0
    uptime_s: int = 0
    capabilities: int = 0
    params_room: int = lib.VS_PARAMS_MAX
    entries_room: int = lib.VS_TABLE_MAX
    datagram_room: int = lib.VS_DATAGRAM_MAX


@dataclass(frozen=True, slots=True)
class Welcome:
    """The host's answer: a session.

    Attributes:
        timestep_us: [us] length of a timestep, at least 1.
        seed: of this robot's controller.
        params: lines "key=value\\n" for the controller, at most 4096 bytes of UTF-8.
        nonce: 16 random bytes.
    """

    table: Table
    timestep_us: int
    seed: int = 0
    params: str = ""
    nonce: bytes = bytes(16)


@dataclass(frozen=True, slots=True)
class Notice:
    """REFUSE or GOODBYE: why, for programs and, in at most 200 bytes of UTF-8, for people."""

    code: int
    text: str = ""


class Telemetry(NamedTuple):
    """What a robot reports; `struct vs_telemetry` in `c_src/vs_body.h` explains the fields.

    Attributes:
        payload: what goes up in the table's order: levels or cumulative counters, and the robot's
            own readings (`Table.readings`).
        log: the oldest log line that the host has not heard; `log_number` is its number.
        shown: the controller's named values, in the order in which it showed them first.
    """

    state: int = Wanted.IDLE
    wanted: int = Wanted.IDLE
    stop_cause: int = StopCause.NONE
    battery_low: int = lib.VS_UNKNOWN
    wanted_run: int = 0
    control_step: int = 0
    left_steps_s: int = 0
    right_steps_s: int = 0
    leds: int = 0
    battery_mv: int = 0
    received: int = 0
    old: int = 0
    foreign: int = 0
    corrupt: int = 0
    base_errors: int = 0
    guard_restarts: int = 0
    clock_bound_us: int = NEVER_US
    signal_dbm: int = 0
    power_saving: int = lib.VS_UNKNOWN
    bit_rate: int = 0
    retries: int = NEVER_US
    overruns: int = 0
    base_resets: int = 0
    log_number: int = 0
    payload: bytes = b""
    log: str = ""
    shown: ShownData = ()


HELLO_ROOMS = ("params_room", "entries_room", "datagram_room")
HELLO_NUMBERS = ("started", "uptime_s", "tag", "capabilities", *HELLO_ROOMS)
HELLO_TEXTS = ("name", "controller", "version", "hash")
HEADER_FIELDS = Header._fields
"""Of `struct vs_header`; its key is no part of a packet."""
HEADER_NUMBERS = numbers_of("struct vs_header", HEADER_FIELDS)
TELEMETRY_FIELDS = Telemetry._fields[:-3]
"""Its numbers."""
TELEMETRY_NUMBERS = numbers_of("struct vs_telemetry", TELEMETRY_FIELDS)


def packet_length(data: bytes | bytearray) -> int | None:
    """Frames a stream: length of the packet that data begins with; None if too little came.

    Raises:
        WireError: data does not begin with a packet; the stream is lost.
    """
    length = ffi.new("size_t *")
    code = lib.vs_packet_length(ffi.from_buffer(data), len(data), length)
    if code == lib.VS_ERR_SHORT:
        return None
    check(code)
    return int(length[0])


def session_of(packet: bytes) -> int:
    """The session that one whole packet names; nothing else of it may be believed without its key.

    Raises:
        WireError: it is no packet.
    """
    session = ffi.new("uint32_t *")
    check(lib.vs_packet_session(ffi.from_buffer(packet), len(packet), session))
    return int(session[0])


def open_packet(packet: bytes, key: bytes = PUBLISHED) -> tuple[Header, bytes]:
    """Checks frame and tag of one whole packet and gives its header and body.

    Raises:
        WireError: it is no valid packet, or of another key.
    """
    header = ffi.new("struct vs_header *")
    body = ffi.new("const uint8_t **")
    length = ffi.new("size_t *")
    data = ffi.from_buffer(packet)
    check(lib.vs_packet_open(data, len(packet), key, header, body, length))
    return header_of(header), bytes(ffi.buffer(body[0], length[0]))


def uid_of(hello: bytes) -> bytes:
    """Who one whole HELLO says that it comes from: its key is to be found by that.

    Raises:
        WireError: it is no HELLO.
    """
    session_of(hello)
    uid = hello[lib.VS_HEADER_SIZE : lib.VS_HEADER_SIZE + lib.VS_UID_SIZE]
    if hello[3] != PacketType.HELLO or len(hello) < lib.VS_PACKET_MIN + lib.VS_UID_SIZE:
        raise WireError(lib.VS_ERR_TYPE, "first packet of a connection")
    return uid


def believed(hello: bytes) -> Hello:
    """Reads one whole HELLO whose tag nobody here can check.

    Raises:
        WireError: it is no HELLO.
    """
    body = hello[lib.VS_HEADER_SIZE : -lib.VS_TAG_SIZE]
    message = decode_body(Header(hello[3]), body)
    if not isinstance(message, Hello):
        raise WireError(lib.VS_ERR_TYPE, "first packet of a connection")
    return message


def answer_key(root: bytes, hello: bytes) -> bytes:
    """What the answer to a HELLO is tagged with; `root` is the robot's key, or `PUBLISHED`."""
    key = ffi.new("uint8_t[]", lib.VS_KEY_SIZE)
    lib.vs_key_answer(root, hello[-lib.VS_TAG_SIZE :], key)
    return bytes(key)


def session_keys(root: bytes, hello: bytes, welcome: bytes) -> tuple[bytes, bytes]:
    """The keys of the session that a HELLO and its WELCOME open: down to the robot, and up."""
    down, up = (ffi.new("uint8_t[]", lib.VS_KEY_SIZE) for _ in range(2))
    size = lib.VS_TAG_SIZE
    lib.vs_key_session(root, hello[-size:], welcome[-size:], down, up)
    return bytes(down), bytes(up)


def header_of(cdata: Any) -> Header:
    """Copies a `struct vs_header`."""
    return Header._make(HEADER_NUMBERS.unpack_from(ffi.buffer(cdata)))


def header_to(header: Header) -> Any:
    """Makes a `struct vs_header`."""
    return ffi.new("struct vs_header *", {name: getattr(header, name) for name in HEADER_FIELDS})


def encode(header: Header, message: Hello | Welcome | Notice, key: bytes = PUBLISHED) -> bytes:
    """Makes one packet for TCP, tagged with a key; the type of a Notice is the header's.

    Raises:
        WireError: a field of the message is outside its range.
    """
    out = Output(PACKET_MAX)
    head, key_buffer = header_to(header), ffi.from_buffer("uint8_t[]", key)
    head.key = key_buffer
    if isinstance(message, Notice):
        notice = ffi.new("struct vs_notice *", {"code": message.code})
        put_text(notice.text, message.text)
        return out.packet(lib.vs_encode_notice(head, notice, *out.arguments))
    if isinstance(message, Hello):
        hello = ffi.new(
            "struct vs_hello *", {n: getattr(message, n) for n in ("uid", "nonce", *HELLO_NUMBERS)}
        )
        for name in HELLO_TEXTS:
            put_text(getattr(hello, name), getattr(message, name))
        return out.packet(lib.vs_encode_hello(head, hello, *out.arguments))
    params = message.params.encode(errors="surrogatepass")
    if len(params) > lib.VS_PARAMS_MAX:
        check(lib.VS_ERR_TEXT, f"params of {len(params)} bytes")
    text = ffi.new("char[]", params)
    plain = {name: getattr(message, name) for name in ("nonce", "seed", "timestep_us")}
    plain |= {"table": message.table.cdata[0], "params": text, "params_len": len(params)}
    welcome = ffi.new("struct vs_welcome *", plain)
    return out.packet(lib.vs_encode_welcome(head, welcome, *out.arguments))


def decode(packet: bytes, key: bytes = PUBLISHED) -> tuple[Header, Hello | Welcome | Notice]:
    """Reads one packet of those that travel on TCP only.

    Raises:
        WireError: the packet or its body is not valid, of another key, or STATE or TELEMETRY.
    """
    header, body = open_packet(packet, key)
    return header, decode_body(header, body)


def decode_body(header: Header, body: bytes) -> Hello | Welcome | Notice:
    """Reads a body as `open_packet` gives it, and raises as `decode` does."""
    if header.type == PacketType.HELLO:
        hello = ffi.new("struct vs_hello *")
        check(lib.vs_decode_hello(body, len(body), hello), "HELLO")
        values: dict[str, Any] = {n: text_of(getattr(hello, n)) for n in HELLO_TEXTS}
        values |= {n: getattr(hello, n) for n in HELLO_NUMBERS}
        return Hello(**values, uid=bytes(hello.uid), nonce=bytes(hello.nonce))
    if header.type == PacketType.WELCOME:
        welcome = ffi.new("struct vs_welcome *")
        check(lib.vs_decode_welcome(body, len(body), welcome), "WELCOME")
        params = bytes(ffi.buffer(welcome.params, welcome.params_len)).decode()
        table, nonce = Table.of(ffi.addressof(welcome, "table")), bytes(welcome.nonce)
        return Welcome(table, welcome.timestep_us, welcome.seed, params, nonce)
    if header.type in (PacketType.REFUSE, PacketType.GOODBYE):
        notice = ffi.new("struct vs_notice *")
        check(lib.vs_decode_notice(header.type, body, len(body), notice))
        return Notice(notice.code, text_of(notice.text))
    return check(lib.VS_ERR_TYPE)  # type: ignore[return-value]


def put_text(cdata: Any, text: str) -> None:
    """Writes a text into a C array of characters; the encoder checks its contents.

    Raises:
        WireError: it is longer than the array.
    """
    data = text.encode(errors="surrogatepass")
    if len(data) >= len(cdata):
        check(lib.VS_ERR_TEXT, repr(text))
    ffi.memmove(cdata, data + b"\0", len(data) + 1)


def shown_of(block: bytes) -> ShownData:
    """Reads a block of shown values (`vs_shown.h`).

    Raises:
        WireError: the block is not valid.
    """
    shown: list[tuple[str, float | str]] = []
    name = ffi.new("char[]", lib.VS_SHOWN_NAME_MAX + 1)
    text = ffi.new("char[]", lib.VS_SHOWN_TEXT_MAX + 1)
    kind, number, at = ffi.new("uint8_t *"), ffi.new("float *"), ffi.new("size_t *")
    data = ffi.from_buffer(block)
    while True:
        code = lib.vs_shown_next(data, len(block), at, name, kind, number, text)
        if code == lib.VS_ERR_NOT_FOUND:
            return tuple(shown)
        check(code)
        is_text = kind[0] == lib.VS_SHOWN_TEXT
        shown.append((text_of(name), text_of(text) if is_text else float(number[0])))
