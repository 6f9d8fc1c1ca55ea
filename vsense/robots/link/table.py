"""The sensor table: which virtual sensors and actuators a session carries, in which order."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

from vsense.base.native import check, ffi, lib


class Goal(NamedTuple):
    """Where a robot is to drive with HOME, as it saw it at the capture time.

    Attributes:
        x_mm, y_mm: ahead of it and to its left; nearer than 5 mm it only turns.
        heading: to turn by at the goal [1e-4 rad], counter-clockwise.
    """

    x_mm: int = 0
    y_mm: int = 0
    heading: int = 0


STAY = Goal()
"""To stand where one stands."""


BRING = "'vsense robot deploy'"


@dataclass(frozen=True, slots=True)
class ToldProgram:
    """A controller as robots tell it in their greeting.

    Attributes:
        name: what it calls itself, "": not known.
        hash: of its source, "": not known.
    """

    name: str
    hash: str = ""

    def __str__(self) -> str:
        return f"'{self.name or 'unnamed'}'{f' ({self.hash})' if self.hash else ''}"

    def is_same(self, other: ToldProgram) -> bool:
        """Whether both are made of the same source, as far as is known."""
        if self.hash and other.hash:
            return self.hash == other.hash
        return self.name == other.name or not (self.name and other.name)


@dataclass(frozen=True, slots=True)
class ExpectedRobot:
    """A robot of the experiment.

    Attributes:
        name: its own in the experiment.
        table: its sensor table.
        params: lines "key=value\\n" for its controller.
        program: its controller, None: not known.
        any_program: it may run another one, but none of another controller of the experiment: its
            table is not for that.
        exact: it runs what the file has, or another robot with the same controller; any other is
            turned away: it may not have been there when they were deployed.
    """

    name: str
    table: Table
    params: str = ""
    program: ToldProgram | None = None
    any_program: bool = False
    exact: bool = False


def text_of(cdata: Any) -> str:
    """Reads a zero-terminated text that C has checked."""
    return str(ffi.string(cdata).decode())


_CODES = {
    **{"uint8_t": "B", "int8_t": "b", "uint16_t": "H", "int16_t": "h"},
    **{"uint32_t": "I", "uint64_t": "Q"},
}


def numbers_of(kind: str, names: Sequence[str]) -> struct.Struct:
    """Reads numbers of a C structure's memory, in the structure's order, all in one call."""
    layout, form, end = dict(ffi.typeof(kind).fields), "=", 0
    for name in names:
        field = layout[name]
        form += f"{field.offset - end}x{_CODES[field.type.cname]}"
        end = field.offset + ffi.sizeof(field.type)
    return struct.Struct(form)


class Output:
    """A C buffer that one packet is encoded into.

    Attributes:
        arguments: buffer, its size and where the length goes: the last three of every encoder.
    """

    def __init__(self, size: int) -> None:
        self._buf = ffi.new("uint8_t[]", size)
        self._length = ffi.new("size_t *")
        self.arguments = (self._buf, size, self._length)

    def packet(self, code: int) -> bytes:
        """The packet, or the encoder's error."""
        check(code)
        return bytes(ffi.buffer(self._buf, self._length[0]))


class Direction(IntEnum):
    """Which way an entry's values travel."""

    SENSOR = lib.VS_SENSOR
    ACTUATOR = lib.VS_ACTUATOR
    READING = lib.VS_READING


@dataclass(frozen=True, slots=True)
class Entry:
    """One row of the table.

    Attributes:
        id: number on the wire, 0 to 255, unique in the table.
        name: what controllers bind to, unique in the table.
        layout: "[count*]type" with type u1 i2 u2 i4 u4 f4, little-endian.
        direction: host to robot (sensor) or robot to host: an actuator, whose level or counter the
            host acts on, or a reading of the robot's own, with its age.
    """

    id: int
    name: str
    layout: str
    direction: Direction = Direction.SENSOR


class Table:
    """An immutable sensor table.

    Attributes:
        entries: the rows, in wire order.
        sizes: bytes of each row's payload.
        hash: CRC-32 of the encoded table: both ends carry it in every packet.
        cdata: the `struct vs_table`, for calls of the C library.

    Raises:
        WireError: an entry is not valid, or the table does not fit one datagram; the message names
            the entry.
    """

    def __init__(self, entries: Iterable[Entry] = ()) -> None:
        cdata = ffi.new("struct vs_table *")
        lib.vs_table_init(cdata)
        for entry in entries:
            try:
                name, layout = entry.name.encode(), entry.layout.encode()
                code = lib.vs_table_add(cdata, entry.id, entry.direction, name, layout)
            except OverflowError:
                code = lib.VS_ERR_ARGUMENT
            check(code, f"{entry.direction.name.lower()} '{entry.name}' ({entry.layout})")
        self._adopt(cdata)

    @classmethod
    def decode(cls, data: bytes) -> Table:
        """Reads a table as WELCOME carries it; raises WireError where the bytes are no table."""
        cdata = ffi.new("struct vs_table *")
        check(lib.vs_table_decode(cdata, data, len(data)), "sensor table")
        return cls.of(cdata)

    @classmethod
    def of(cls, cdata: Any) -> Table:
        """Copies a `struct vs_table`."""
        table = cls.__new__(cls)
        table._adopt(ffi.new("struct vs_table *", cdata[0]))
        return table

    def _adopt(self, cdata: Any) -> None:
        self.cdata = cdata
        rows = cdata.entries[0 : cdata.count]
        self.entries = tuple(
            Entry(r.id, text_of(r.name), text_of(r.layout), Direction(r.direction)) for r in rows
        )
        self.sizes = tuple(row.size for row in rows)
        self.hash: int = cdata.hash

    def encode(self) -> bytes:
        """The table's bytes."""
        out = Output(lib.VS_TABLE_BYTES)
        return out.packet(lib.vs_table_encode(self.cdata, *out.arguments))

    def of_direction(self, direction: Direction) -> list[tuple[Entry, int, int]]:
        """Entries of one direction with the offset and size [byte] of their payload."""
        rows = zip(self.entries, self.cdata.entries[0 : len(self.entries)])
        return [
            (entry, row.offset, row.size) for entry, row in rows if entry.direction == direction
        ]

    def readings(self, payload: bytes) -> dict[str, tuple[bytes, int | None]]:
        """A robot's own readings in its telemetry's payload, by name.

        Each with how long before the packet left it was measured [us]; None: never.
        """
        found: dict[str, tuple[bytes, int | None]] = {}
        for entry, at, size in self.of_direction(Direction.READING):
            older_us = int.from_bytes(payload[at - 4 : at], "little")
            never = older_us == lib.VS_NEVER_US
            found[entry.name] = payload[at : at + size], None if never else older_us
        return found

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Table) and self.entries == other.entries

    def __hash__(self) -> int:
        return self.hash

    def __len__(self) -> int:
        return len(self.entries)


def robot_seed(seed: int, tag: int) -> int:
    """Seed of one robot's controller, made from that of the run: 32 bits."""
    digest = hashlib.blake2b(f"{seed}/{tag}".encode(), digest_size=4).digest()
    return int.from_bytes(digest, "little")
