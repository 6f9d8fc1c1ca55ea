"""Properties of the codec: nothing is lost, nothing is invented, bad bytes are one named error."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.wire.strategies import (
    POLLUTANT,
    STEERING,
    headers,
    messages,
    reseal,
    tables,
    telemetries,
    u32,
    with_length,
)
from vsense.base.native import WireError, check, ffi, lib
from vsense.robots.link._peer import telemetry_of
from vsense.robots.link.table import Direction, Output, Table
from vsense.robots.link.wire import (
    DATAGRAM_MAX,
    PACKET_MAX,
    TELEMETRY_FIELDS,
    Header,
    Hello,
    Notice,
    PacketType,
    Telemetry,
    Wanted,
    Welcome,
    decode,
    encode,
    header_to,
    open_packet,
    packet_length,
)


def encode_telemetry(header: Header, table: Table, said: Telemetry) -> bytes:
    values = {name: getattr(said, name) for name in TELEMETRY_FIELDS}
    report = ffi.new("struct vs_telemetry *", {**values, "payload": said.payload})
    out = Output(DATAGRAM_MAX)
    code = lib.vs_encode_telemetry(header_to(header), table.cdata, report, *out.arguments)
    return out.packet(code)


def decode_telemetry(packet: bytes, table: Table) -> tuple[Header, Telemetry]:
    header, body = open_packet(packet)
    report = ffi.new("struct vs_telemetry *")
    check(lib.vs_decode_telemetry(table.cdata, body, len(body), report))
    payload = bytes(ffi.buffer(report.payload, table.cdata.actuator_bytes))
    return header, telemetry_of(report, payload)


@given(messages)
def test_decoding_undoes_encoding(message: tuple[Header, Hello | Welcome | Notice]) -> None:
    packet = encode(*message)
    assert decode(packet) == (with_length(message[0], packet), message[1])


@given(st.data(), tables())
def test_decoding_undoes_encoding_of_telemetry(data: st.DataObject, table: Table) -> None:
    header = data.draw(headers(PacketType.TELEMETRY))
    said = data.draw(telemetries(table))
    packet = encode_telemetry(header, table, said)
    assert decode_telemetry(packet, table) == (with_length(header, packet), said)


@given(st.data(), tables(), st.sampled_from(Wanted), u32)
def test_decoding_undoes_encoding_of_state(
    data: st.DataObject, table: Table, wanted: Wanted, from_timestep: int
) -> None:
    header = data.draw(headers(PacketType.STATE))
    rows = table.of_direction(Direction.SENSOR)
    block = data.draw(
        st.binary(min_size=table.cdata.sensor_bytes, max_size=table.cdata.sensor_bytes)
    )
    ages = data.draw(st.lists(u32, min_size=len(rows), max_size=len(rows)))
    fields = {"wanted": wanted, "from_timestep": from_timestep, "older_us": ages, "payload": block}
    state, read = ffi.new("struct vs_state *", fields), ffi.new("struct vs_state *")
    out = Output(DATAGRAM_MAX)
    packet = out.packet(lib.vs_encode_state(header_to(header), table.cdata, state, *out.arguments))
    opened, body = open_packet(packet)
    check(lib.vs_decode_state(table.cdata, body, len(body), read))
    assert opened == with_length(header, packet)
    assert bytes(ffi.buffer(read)) == bytes(ffi.buffer(state))


@given(messages, st.data())
def test_encoding_undoes_decoding(
    message: tuple[Header, Hello | Welcome | Notice], data: st.DataObject
) -> None:
    """Of a changed packet that is still accepted, every byte comes back: none is overlooked."""
    packet = bytearray(encode(*message))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(8, len(packet) - 21))
        packet[at] = data.draw(st.integers(0, 255))
    changed = reseal(bytes(packet))
    try:
        header, read = decode(changed)
    except WireError:
        return
    assert encode(header, read) == changed


@given(st.binary(max_size=300) | st.binary(max_size=300).map(lambda b: b"VS\1" + b))
def test_any_bytes_give_a_packet_or_one_named_error(data: bytes) -> None:
    with pytest.raises(WireError) as caught:
        decode(data)
    assert caught.value.name.startswith("VS_ERR_")
    assert caught.value.name != "VS_ERR_?"


@given(st.sampled_from(PacketType), st.binary(max_size=200))
def test_any_body_behind_a_right_checksum_does_no_harm(kind: PacketType, body: bytes) -> None:
    start = encode(Header(PacketType.GOODBYE), Notice(0))[:56]
    packet = reseal(start[:3] + bytes([kind]) + start[4:] + body + bytes(16))
    header, found = open_packet(packet)
    assert (header.type, found) == (kind, body)
    try:
        if kind == PacketType.TELEMETRY:
            _, said = decode_telemetry(packet, POLLUTANT)
            assert encode_telemetry(header, POLLUTANT, said) == packet
        elif kind != PacketType.STATE:
            assert encode(*decode(packet)) == packet
    except WireError as error:
        assert error.name in ("VS_ERR_BODY", "VS_ERR_TEXT", "VS_ERR_TABLE_SIZE")


@given(messages, st.data())
def test_every_truncation_asks_for_more(
    message: tuple[Header, Hello | Welcome | Notice], data: st.DataObject
) -> None:
    packet = encode(*message)
    cut = data.draw(st.integers(0, len(packet) - 1))
    assert packet_length(packet[:cut]) == (None if cut < 8 else len(packet))
    with pytest.raises(WireError) as caught:
        decode(packet[:cut])
    assert caught.value.name == "VS_ERR_SHORT"


@given(messages, st.data())
def test_every_bit_flip_is_refused(
    message: tuple[Header, Hello | Welcome | Notice], data: st.DataObject
) -> None:
    packet = bytearray(encode(*message))
    bit = data.draw(st.integers(0, 8 * len(packet) - 1))
    packet[bit // 8] ^= 1 << bit % 8
    with pytest.raises(WireError):
        decode(bytes(packet))


@given(st.binary(max_size=16))
def test_framing_is_bounded(data: bytes) -> None:
    try:
        length = packet_length(b"VS\3" + data)
    except WireError as error:
        assert error.name in ("VS_ERR_TYPE", "VS_ERR_LENGTH")
    else:
        assert length is None or 72 <= length <= PACKET_MAX


@pytest.mark.parametrize(
    ("begin", "name"),
    [(b"G", "VS_ERR_MAGIC"), (b"VG", "VS_ERR_MAGIC"), (b"VS\2", "VS_ERR_VERSION"),
     (b"VS\3\0", "VS_ERR_TYPE")],
)  # fmt: skip
def test_a_wrong_byte_is_refused_as_soon_as_it_is_there(begin: bytes, name: str) -> None:
    with pytest.raises(WireError) as caught:
        packet_length(begin)
    assert caught.value.name == name
    assert packet_length(begin[:-1]) is None


@pytest.mark.parametrize(
    ("message", "name"),
    [
        (Hello(bytes(16), 1, "n" * 32, ""), "VS_ERR_TEXT"),
        (Hello(bytes(16), 1, "a\nb", ""), "VS_ERR_TEXT"),
        (Hello(bytes(16), 1, "\ud800", ""), "VS_ERR_TEXT"),
        (Welcome(Table(), 0), "VS_ERR_BODY"),
        (Welcome(Table(), 1, params="p" * 4097), "VS_ERR_TEXT"),
        (Welcome(Table(), 1, params="a\r\n"), "VS_ERR_TEXT"),
        (Notice(1, "t" * 201), "VS_ERR_TEXT"),
        (Notice(256), "VS_ERR_BODY"),
    ],
)
def test_what_cannot_be_sent_is_refused(message: Hello | Welcome | Notice, name: str) -> None:
    with pytest.raises(WireError) as caught:
        encode(Header(PacketType.GOODBYE), message)
    assert caught.value.name == name


def test_no_text_steers_a_terminal_or_turns_a_line_around() -> None:
    for code in (*range(1, 0xD800), *range(0xE000, 0xE100), 0x1F600, 0x10FFFF):
        try:
            encode(Header(PacketType.REFUSE), Notice(1, f"a{chr(code)}b"))
        except WireError as error:
            assert error.name == "VS_ERR_TEXT" and chr(code) in STEERING, hex(code)
        else:
            assert chr(code) not in STEERING, hex(code)


def test_state_and_telemetry_need_a_table() -> None:
    packet = encode_telemetry(Header(PacketType.TELEMETRY), Table(), Telemetry())
    with pytest.raises(WireError) as caught:
        decode(packet)
    assert caught.value.name == "VS_ERR_TYPE"
