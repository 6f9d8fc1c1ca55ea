"""Robots that know their keys and say what they like: greetings and telemetry of any values."""

from __future__ import annotations

from dataclasses import replace
from random import Random
from typing import Any

from tests.fuzz import mutate
from vsense.base.native import ffi, lib
from vsense.robots.link.table import Direction, Entry, Output, Table
from vsense.robots.link.wire import PUBLISHED, Header, Hello, PacketType, encode, header_to

S = 1_000_000_000
TABLE = Table([Entry(1, "pollutant", "f4"), Entry(2, "drops", "u4", Direction.ACTUATOR)])


def any_whole(random: Random, bits: int, near: int = 0) -> int:
    """An unsigned number of so many bits: any, at an end, in the middle, or around `near`."""
    middle, end = 1 << bits - 1, 1 << bits
    at = random.choice((0, 0, middle, end, near, None))
    if at is None:
        return random.getrandbits(bits)
    return (at + random.choice((-1, 0, 1, random.randrange(-3600 * S, 3600 * S)))) % end


def hello(random: Random, tag: int, uid: bytes, key: bytes) -> bytes:
    """A greeting of nearly any values, with the robot's key."""
    name = mutate.text(random, "epuck") if random.random() < 0.2 else "epuck"
    said = Hello(
        uid.ljust(16), tag, name.encode("utf-8", "replace")[:31].decode("utf-8", "ignore"), "test"
    )
    said = replace(said, nonce=random.randbytes(16))
    if random.random() < 0.3:
        started, uptime_s = any_whole(random, 32), any_whole(random, 32)
        said = replace(said, started=started, uptime_s=uptime_s, params_room=any_whole(random, 16))
    return encode(Header(PacketType.HELLO, send_ns=any_whole(random, 64)), said, key)


class Robot:
    """A robot with a key that says what it likes.

    Attributes:
        up: the key of what it sends in its session.
        session: the session's number.
    """

    def __init__(self, random: Random, uid: bytes, root: bytes) -> None:
        self.uid, self.root, self.sequence = uid, root, 0
        self.up = PUBLISHED
        self.random = random
        self.session = 0

    def header(self, kind: PacketType, now_ns: int) -> Header:
        """A header of nearly any values, mostly one that is taken; `now_ns` is the host's clock."""
        random = self.random
        self.sequence = max(0, self.sequence + random.choice((1, 1, 1, 1, 0, -1, 5, 999, 5000)))
        return Header(
            kind,
            session=self.session,
            sequence=self.sequence & 0xFFFFFFFF,
            run=random.choice((0, 1, 1, 1, 1, 1, 2, 200, 2**32 - 1)),
            timestep=any_whole(random, 32),
            capture_ns=any_whole(random, 64, now_ns),
            send_ns=any_whole(random, 64, now_ns),
            echo_ns=any_whole(random, 64, now_ns),
            hold_us=any_whole(random, 32),
            table_hash=TABLE.hash,
        )

    def telemetry(self, key: bytes, now_ns: int) -> bytes:
        """A TELEMETRY of nearly any values, tagged with a key."""
        random, out = self.random, Output(1200)
        header = header_to(self.header(PacketType.TELEMETRY, now_ns))
        kept = header.key = ffi.new("uint8_t[]", key)
        said = ffi.new("struct vs_telemetry *", {"payload": random.randbytes(4)})
        for name, field in ffi.typeof("struct vs_telemetry").fields:
            if field.type.kind == "primitive" and random.random() < 0.3 and name != "shown_len":
                setattr(said, name, self._number(field.type))
        said.state, said.wanted = random.randrange(5), random.randrange(5)
        said.battery_low, said.power_saving = random.choice((0, 1, 255)), random.choice((0, 1, 255))
        if said.log_number:
            said.log = random.choice((b"", b"it is dark", "é\u202e".encode(), b"x" * 90))
        if random.random() < 0.2:
            number = random.choice((0.0, float("nan"), float("inf"), -1e38))
            lib.vs_shown_set(said.shown, ffi.addressof(said, "shown_len"), b"n", number, ffi.NULL)
        packet = out.packet(lib.vs_encode_telemetry(header, TABLE.cdata, said, *out.arguments))
        assert kept == header.key
        return packet

    def _number(self, kind: Any) -> int:
        bits = 8 * ffi.sizeof(kind)
        value = any_whole(self.random, bits)
        is_signed = ffi.cast(kind, -1) < ffi.cast(kind, 0)
        return value - (1 << bits) if is_signed and value >= 1 << bits - 1 else value
