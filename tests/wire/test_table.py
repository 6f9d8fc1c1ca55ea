"""The sensor table: bound by name, never larger than a datagram, refused with its reason."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.wire.strategies import tables
from vsense.base.native import WireError, ffi, lib
from vsense.robots.link.table import Direction, Entry, Table


@given(tables(most=32))
def test_decoding_undoes_encoding(table: Table) -> None:
    read = Table.decode(table.encode())
    assert read == table
    assert read.hash == table.hash
    assert read.sizes == table.sizes


@given(st.binary(max_size=100))
def test_any_bytes_give_a_table_or_one_named_error(data: bytes) -> None:
    try:
        table = Table.decode(data)
    except WireError:
        return
    assert table.encode() == data


@given(tables(most=32))
def test_payloads_lie_side_by_side(table: Table) -> None:
    ends = {True: 0, False: 0}
    rows = {e.name: (at, n) for way in Direction for e, at, n in table.of_direction(way)}
    for entry in table.entries:  # PROTOCOL.md, section 4: four bytes of age before a reading
        goes_down, (offset, size) = entry.direction == Direction.SENSOR, rows[entry.name]
        assert offset == ends[goes_down] + 4 * (entry.direction == Direction.READING)
        ends[goes_down] = offset + size
    cdata = table.cdata
    assert (ends[True], ends[False]) == (cdata.sensor_bytes, cdata.actuator_bytes)


def test_readings_of_the_robots_own_have_their_ages() -> None:
    entries = [Entry(1, "pump", "u1", Direction.ACTUATOR), Entry(2, "seen", "f4")]
    entries += [Entry(3, "own", "2*i2", Direction.READING), Entry(4, "mv", "u2", Direction(2))]
    payload = b"\x07" + (7_500).to_bytes(4, "little") + b"wxyz" + b"\xff" * 4 + b"\0\0"
    told = Table(entries).readings(payload)
    assert told == {"own": (b"wxyz", 7_500), "mv": (b"\0\0", None)}


@given(tables(most=32))
def test_entries_are_found_by_name(table: Table) -> None:
    for index, entry in enumerate(table.entries):
        assert lib.vs_table_find(table.cdata, entry.name.encode()) == index
    assert lib.vs_table_find(table.cdata, b"no such sensor\n") == lib.VS_ERR_NOT_FOUND


@pytest.mark.parametrize(
    ("entries", "name", "said"),
    [
        ([Entry(1, "map", "1113*u1")], "VS_ERR_TABLE_SIZE", "sensor 'map' (1113*u1)"),
        ([Entry(1, "a", "556*u1"), Entry(2, "b", "553*u1")], "VS_ERR_TABLE_SIZE", "'b'"),
        ([Entry(1, "n", "539*u2", Direction.ACTUATOR)], "VS_ERR_TABLE_SIZE", "actuator 'n'"),
        ([Entry(1, "n", "340*u2", Direction.READING)], "VS_ERR_TABLE_SIZE", "reading 'n'"),
        ([Entry(i, f"s{i}", "u1") for i in range(33)], "VS_ERR_TABLE_SIZE", "'s32'"),
        ([Entry(1, "a", "f8")], "VS_ERR_LAYOUT", "(f8)"),
        ([Entry(1, "a", "u1"), Entry(1, "b", "u1")], "VS_ERR_DUPLICATE", "'b'"),
        ([Entry(1, "a", "u1"), Entry(2, "a", "u1")], "VS_ERR_DUPLICATE", "'a'"),
        ([Entry(256, "a", "u1")], "VS_ERR_ARGUMENT", "'a'"),
        ([Entry(1, "", "u1")], "VS_ERR_TEXT", "''"),
        ([Entry(1, "n" * 32, "u1")], "VS_ERR_TEXT", "nnn"),
    ],
)
def test_refused_tables_name_the_entry(entries: list[Entry], name: str, said: str) -> None:
    with pytest.raises(WireError) as caught:
        Table(entries)
    assert caught.value.name == name
    assert said in str(caught.value)


def test_a_refused_entry_leaves_the_table_as_it_was() -> None:
    table = Table([Entry(1, "a", "f4")])
    before = bytes(ffi.buffer(table.cdata))
    for refused in ((1, b"b", b"f4"), (2, b"a", b"f4"), (2, b"b", b"f9"), (2, b"b", b"1112*u1")):
        number, name, layout = refused
        assert lib.vs_table_add(table.cdata, number, 0, name, layout) < 0
        assert bytes(ffi.buffer(table.cdata)) == before


def test_the_largest_table_fits_one_welcome() -> None:
    entries = [Entry(i, f"{i:031d}", f"{i + 1:>03d}*u1".lstrip("0")) for i in range(32)]
    assert len(Table(entries).encode()) <= lib.VS_TABLE_BYTES


def test_tables_that_differ_in_anything_differ_in_their_hash() -> None:
    one = Entry(1, "a", "2*u1")
    others = [
        Entry(2, "a", "2*u1"),
        Entry(1, "b", "2*u1"),
        Entry(1, "a", "u2"),
        Entry(1, "a", "2*u1", Direction.ACTUATOR),
    ]
    hashes = {Table([entry]).hash for entry in (one, *others)}
    assert len(hashes) == 5
