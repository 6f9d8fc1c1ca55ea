"""C and Python agree with packets made by an independent encoder, tests/golden/make_wire.py."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from typing import Any

import pytest

from tests.rigs.places import ROOT
from vsense.base.native import WireError, check, ffi, lib
from vsense.robots.link._peer import older_us, telemetry_of
from vsense.robots.link.table import Direction, Entry, Output, Table
from vsense.robots.link.wire import (
    DATAGRAM_MAX,
    TELEMETRY_FIELDS,
    Header,
    Hello,
    Notice,
    PacketType,
    Welcome,
    answer_key,
    believed,
    decode,
    encode,
    header_to,
    open_packet,
    session_keys,
    session_of,
    uid_of,
)

GOLDEN = ROOT / "tests" / "golden"
VECTORS = json.loads((GOLDEN / "wire.json").read_text())
Vector = dict[str, Any]


def by_name(vectors: list[Vector]) -> Any:
    return pytest.mark.parametrize("vector", vectors, ids=[v["name"] for v in vectors])


def of_types(*types: str) -> list[Vector]:
    return [v for v in VECTORS["packets"] if v["type"] in types]


def table_of(rows: list[list[Any]]) -> Table:
    return Table(Entry(id_, name, layout, Direction(d)) for id_, d, name, layout in rows)


def header_of_vector(vector: Vector) -> Header:
    length = len(vector["hex"]) // 2
    return Header(PacketType[vector["type"]], length=length, **vector["header"])


def message_of(vector: Vector) -> Hello | Welcome | Notice:
    said = dict(vector["message"])
    if vector["type"] == "HELLO":
        raw = {name: bytes.fromhex(said[name]) for name in ("uid", "nonce")}
        return Hello(**{**said, **raw})
    if vector["type"] == "WELCOME":
        raw = {"table": table_of(said["table"]), "nonce": bytes.fromhex(said["nonce"])}
        return Welcome(**{**said, **raw})
    return Notice(**said)


STATE_FIELDS = ("wanted", "from_timestep", "log_heard")
GOAL_FIELDS = ("goal_x_mm", "goal_y_mm", "goal_heading")


def state_bytes(header: Header, table: Table, said: Any, values: Any) -> bytes:
    fields = {name: said[name] for name in STATE_FIELDS} | dict(zip(GOAL_FIELDS, said["goal"]))
    state = ffi.new("struct vs_state *", fields)
    block = b"".join(payload for _, payload in values)
    ffi.memmove(state.payload, block, len(block))
    for rank, (older, _) in enumerate(values):
        state.older_us[rank] = older
    out = Output(DATAGRAM_MAX)
    return out.packet(lib.vs_encode_state(header_to(header), table.cdata, state, *out.arguments))


def test_the_committed_vectors_are_what_the_script_writes() -> None:
    script = [sys.executable, str(GOLDEN / "make_wire.py")]
    made = subprocess.run(script, capture_output=True, check=True).stdout
    assert made == (GOLDEN / "wire.json").read_bytes()


@by_name(of_types("HELLO", "WELCOME", "REFUSE", "GOODBYE"))
def test_tcp_packets(vector: Vector) -> None:
    packet = bytes.fromhex(vector["hex"])
    header, message = header_of_vector(vector), message_of(vector)
    assert encode(header, message) == packet
    assert decode(packet) == (header, message)


@by_name(of_types("STATE"))
def test_state(vector: Vector) -> None:
    packet = bytes.fromhex(vector["hex"])
    table, header, said = table_of(vector["table"]), header_of_vector(vector), vector["message"]
    values = [(older, bytes.fromhex(payload)) for older, payload in said["values"]]
    assert state_bytes(header, table, said, values) == packet
    opened, body = open_packet(packet)
    state = ffi.new("struct vs_state *")
    check(lib.vs_decode_state(table.cdata, body, len(body), state))
    assert opened == header
    assert {name: getattr(state, name) for name in STATE_FIELDS}.items() <= said.items()
    assert [getattr(state, name) for name in GOAL_FIELDS] == said["goal"]
    rows = table.of_direction(Direction.SENSOR)
    found = [
        (state.older_us[rank], bytes(state.payload[offset : offset + size]))
        for rank, (_, offset, size) in enumerate(rows)
    ]
    assert found == values


@by_name(of_types("TELEMETRY"))
def test_telemetry(vector: Vector) -> None:
    packet, table = bytes.fromhex(vector["hex"]), table_of(vector["table"])
    header, said = header_of_vector(vector), vector["message"]
    payload, shown = bytes.fromhex(said["payload"]), shown_block(said["shown"])
    log = said["log"].encode()
    raw = {"payload": payload, "log": log, "shown": list(shown), "shown_len": len(shown)}
    report = ffi.new("struct vs_telemetry *", {**said, **raw})
    out = Output(DATAGRAM_MAX)
    arguments = (header_to(header), table.cdata, report, *out.arguments)
    assert out.packet(lib.vs_encode_telemetry(*arguments)) == packet
    opened, body = open_packet(packet)
    read = ffi.new("struct vs_telemetry *")
    check(lib.vs_decode_telemetry(table.cdata, body, len(body), read))
    assert opened == header
    found = telemetry_of(read, bytes(read.payload[0 : len(payload)]))
    assert {name: getattr(found, name) for name in TELEMETRY_FIELDS} == {
        name: said[name] for name in TELEMETRY_FIELDS
    }
    assert (found.payload, found.log) == (payload, said["log"])
    rounded = [
        (
            name,
            value if isinstance(value, str) else struct.unpack("<f", struct.pack("<f", value))[0],
        )
        for name, value in said["shown"]
    ]
    assert list(found.shown) == rounded


def shown_block(items: list[tuple[str, float | str]]) -> bytes:
    """The block as a robot makes it."""
    block, length = ffi.new("uint8_t[]", lib.VS_SHOWN_MAX), ffi.new("uint8_t *")
    for name, value in items:
        text = value.encode() if isinstance(value, str) else ffi.NULL
        number = 0.0 if isinstance(value, str) else value
        check(lib.vs_shown_set(block, length, name.encode(), number, text))
    return bytes(block[0 : length[0]])


@pytest.mark.parametrize("vector", VECTORS["tables"], ids=lambda v: f"{len(v['table'])}_entries")
def test_tables(vector: Vector) -> None:
    table = table_of(vector["table"])
    assert table.encode().hex() == vector["hex"]
    assert table.hash == vector["hash"]
    assert Table.decode(bytes.fromhex(vector["hex"])) == table


@by_name(VECTORS["bad"])
def test_bad_packets_are_refused_by_name(vector: Vector) -> None:
    packet, table = bytes.fromhex(vector["hex"]), table_of(vector["table"])
    with pytest.raises(WireError) as caught:
        header, body = open_packet(packet)
        if header.type == PacketType.STATE:
            check(lib.vs_decode_state(table.cdata, body, len(body), ffi.new("struct vs_state *")))
        elif header.type == PacketType.TELEMETRY:
            report = ffi.new("struct vs_telemetry *")
            check(lib.vs_decode_telemetry(table.cdata, body, len(body), report))
        else:
            decode(packet)
    assert caught.value.name == vector["error"]


def test_the_keys_of_a_session() -> None:
    known = {name: bytes.fromhex(text) for name, text in VECTORS["session"].items()}
    root, hello = known["root"], known["hello"]
    assert (uid_of(hello), decode(hello, root)[1]) == (believed(hello).uid, believed(hello))
    for first in (known["welcome"], known["state"], known["telemetry"]):
        with pytest.raises(WireError, match="first packet of a connection"):
            uid_of(first)
    answer = answer_key(root, hello)
    for name in ("welcome", "refuse"):
        header, message = decode(known[name], answer)
        assert encode(header, message, answer) == known[name]
    assert session_keys(root, hello, known["welcome"]) == (known["down"], known["up"])
    for name, key in (("state", "down"), ("telemetry", "up")):
        assert session_of(known[name]) == open_packet(known[name], known[key])[0].session
        for other in ("root", "up" if key == "down" else "down"):
            with pytest.raises(WireError, match="tag"):
                open_packet(known[name], known[other])


def test_age_of_a_value_is_measured_against_the_header() -> None:
    assert older_us(5_000_000, 5_000_000) == 0
    assert older_us(5_000_000, 4_000_999) == 999
    assert older_us(5_000_000, 6_000_000) == 0
    assert older_us(2**62, 0) == lib.VS_NEVER_US - 1
    assert older_us(5_000_000, -1) == lib.VS_NEVER_US
