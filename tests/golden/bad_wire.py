"""Packets that must be refused, each with the error that names why."""

from __future__ import annotations

import struct
from typing import Any

from good_wire import EMPTY, GREETING, HEADER, HELLO, MIXED, POLLUTANT, REPORT
from plain_encoder import BODIES, seal, text8


def bad(name: str, error: str, packet: bytes, table: list[list[Any]] = EMPTY) -> dict[str, Any]:
    return {"name": name, "error": f"VS_ERR_{error}", "table": table, "hex": packet.hex()}


def bad_frames() -> list[dict[str, Any]]:
    body = BODIES["HELLO"](HELLO)
    packet = seal(1, GREETING, body)
    return [
        bad("magic", "MAGIC", seal(1, GREETING, body, magic=0x5653)),
        bad("other_protocol", "MAGIC", b"GET / HTTP/1.0\r\n\r\n" + bytes(80)),
        bad("iridia_client", "MAGIC", bytes(4)),
        bad("version_0", "VERSION", seal(1, GREETING, body, version=0)),
        bad("version_1", "VERSION", seal(1, GREETING, body, version=1)),
        bad("version_2", "VERSION", seal(1, GREETING, body, version=2)),
        bad("version_4", "VERSION", seal(1, GREETING, body, version=4)),
        bad("type_0", "TYPE", seal(0, GREETING, body)),
        bad("type_7", "TYPE", seal(7, GREETING, body)),
        bad("length_0", "LENGTH", seal(1, GREETING, body, length=0)),
        bad("length_71", "LENGTH", seal(1, GREETING, body, length=71)),
        bad("length_513", "LENGTH", seal(1, GREETING, body, length=513)),
        bad("welcome_8193", "LENGTH", seal(2, HEADER, bytes(8121))),
        bad("length_65535", "LENGTH", seal(1, GREETING, body, length=65535)),
        bad("state_1201", "LENGTH", seal(5, HEADER, bytes(1129))),
        bad("bytes_left_over", "LENGTH", packet + b"\0"),
        bad("empty", "SHORT", b""),
        bad("header_only", "SHORT", packet[:56]),
        bad("last_byte_missing", "SHORT", packet[:-1]),
        bad("tag_first", "TAG", seal(1, GREETING, body, tag=b"\1" + bytes(15))),
        bad("tag_last", "TAG", seal(1, GREETING, body, tag=bytes(15) + b"\x80")),
        bad("tag_twice", "TAG", seal(1, GREETING, body, tag=b"\1" * 2 + bytes(14))),
        bad("other_key", "TAG", seal(1, GREETING, body, key=bytes(16))),
    ]


def bad_texts() -> list[dict[str, Any]]:
    texts = {
        "too_long": b"n" * 32,
        "control": b"a\nb",
        "delete": b"\x7f",
        "zero": b"a\0b",
        "stray": b"\x80",
        "overlong": b"\xc0\xaf",
        "overlong_3": b"\xe0\x80\x80",
        "surrogate": b"\xed\xa0\x80",
        "beyond": b"\xf4\x90\x80\x80",
        "cut": b"\xe2\x82",
    }
    fixed = BODIES["HELLO"](HELLO)[:54]
    bodies = {name: fixed + bytes([len(text)]) + text + b"\0\0\0" for name, text in texts.items()}
    return [bad(f"name_{name}", "TEXT", seal(1, GREETING, body)) for name, body in bodies.items()]


def bad_bodies() -> list[dict[str, Any]]:
    body = BODIES["HELLO"](HELLO)
    run = {"wanted": 1, "from_timestep": 0, "log_heard": 0, "goal": [0, 0, 0]}
    one = BODIES["STATE"](run | {"values": [[0, "0000803f"]]})
    report = BODIES["TELEMETRY"](REPORT)
    return [
        bad("hello_left_over", "BODY", seal(1, GREETING, body + b"\0")),
        bad("hello_cut", "BODY", seal(1, GREETING, body[:-1])),
        bad("hello_empty", "BODY", seal(1, GREETING, b"")),
        bad("refuse_cut", "BODY", seal(3, GREETING, b"\1")),
        bad("refuse_text", "TEXT", seal(3, GREETING, b"\1\0\xc9" + b"t" * 201)),
        bad("goodbye_left_over", "BODY", seal(4, HEADER, b"\0\0\0")),
        bad("state_wanted_5", "BODY", seal(5, HEADER, b"\5" + one[1:]), POLLUTANT),
        bad("state_padding", "BODY", seal(5, HEADER, one[:1] + b"\1" + one[2:]), POLLUTANT),
        bad("state_goal_x", "BODY", seal(5, HEADER, one[:12] + b"\1" + one[13:]), POLLUTANT),
        bad("state_goal_y", "BODY", seal(5, HEADER, one[:15] + b"\1" + one[16:]), POLLUTANT),
        bad("state_goal_turn", "BODY", seal(5, HEADER, one[:2] + b"\1" + one[3:]), POLLUTANT),
        bad("state_cut", "BODY", seal(5, HEADER, one[:-1]), POLLUTANT),
        bad("state_left_over", "BODY", seal(5, HEADER, one + b"\0"), POLLUTANT),
        bad("state_other_table", "BODY", seal(5, HEADER, one), MIXED),
        bad("telemetry_state_5", "BODY", seal(6, HEADER, b"\5" + report[1:])),
        bad("telemetry_wanted_9", "BODY", seal(6, HEADER, b"\1\t" + report[2:])),
        bad("telemetry_battery_2", "BODY", seal(6, HEADER, report[:3] + b"\2" + report[4:])),
        bad("telemetry_cut", "BODY", seal(6, HEADER, report[:-1])),
        bad("telemetry_left_over", "BODY", seal(6, HEADER, report + b"\0")),
        bad("telemetry_saving_2", "BODY", seal(6, HEADER, report[:49] + b"\2" + report[50:])),
        bad("telemetry_log_long", "TEXT", seal(6, HEADER, report[:-2] + said("l" * 121) + b"\0")),
        bad("telemetry_log_lines", "TEXT", seal(6, HEADER, report[:-2] + said("a\nb") + b"\0")),
        *[
            bad(f"shown_{name}", "BODY", seal(6, HEADER, report[:-1] + bytes([len(data)]) + data))
            for name, data in BAD_SHOWN.items()
        ],
    ]


def said(text: str) -> bytes:
    return bytes([len(text)]) + text.encode()


BAD_SHOWN = {
    "kind_2": b"\1n\2\0",
    "no_name": b"\0\0\0\0\0\0",
    "number_cut": b"\1n\0\0\0\0",
    "text_cut": b"\1n\1\5four",
    "text_long": b"\1n\1\x31" + b"t" * 49,
    "name_long": b"\x10" + b"n" * 16 + b"\0\0\0\0\0",
    "name_control": b"\1\n\0\0\0\0\0",
    "only_name": b"\1n",
}


def row(id_: int, direction: int, size: int, name: str, layout: str) -> bytes:
    return struct.pack("<BBH", id_, direction, size) + text8(name) + text8(layout)


LAYOUTS = "", "f", "f8", "0*f4", "01*f4", "*f4", "4*", "4*f4 ", "4f4", " f4", "-1*f4", "1*1*f4"


def carry(name: str, error: str, table: bytes, timestep_us: int = 1, params: bytes = b"") -> Any:
    """A WELCOME with this table."""
    fixed = struct.pack("<IIH", timestep_us, 0, len(params)) + params
    body = bytes(16) + fixed + struct.pack("<H", len(table)) + table
    return bad(name, error, seal(2, HEADER, body))


def bad_tables() -> list[dict[str, Any]]:
    a, b = row(1, 0, 4, "a", "f4"), row(2, 0, 4, "b", "f4")
    layouts = [b"\1" + row(1, 0, 4, "a", layout) for layout in LAYOUTS]
    return [
        carry("timestep_0", "BODY", b"\0", timestep_us=0),
        carry("params_too_long", "BODY", b"\0", params=b"p" * 4097),
        carry("params_control", "TEXT", b"\0", params=b"a=b\r\n"),
        carry("table_empty_bytes", "BODY", b""),
        carry("table_count_33", "TABLE_SIZE", b"\x21" + a * 33),
        carry("table_entry_missing", "BODY", b"\2" + a),
        carry("table_left_over", "BODY", b"\1" + a + b),
        carry("table_same_id", "DUPLICATE", b"\2" + a + row(1, 1, 4, "b", "f4")),
        carry("table_same_name", "DUPLICATE", b"\2" + a + row(2, 1, 4, "a", "f4")),
        carry("table_no_name", "TEXT", b"\1" + row(1, 0, 4, "", "f4")),
        carry("table_direction_3", "BODY", b"\1" + row(1, 3, 4, "a", "f4")),
        carry("table_size_differs", "LAYOUT", b"\1" + row(1, 0, 8, "a", "f4")),
        carry("table_huge_count", "TABLE_SIZE", b"\1" + row(1, 0, 4, "a", "4294967297*u1")),
        carry("table_sensors_too_big", "TABLE_SIZE", b"\1" + row(1, 0, 1109, "a", "1109*u1")),
        carry("table_actuators_too_big", "TABLE_SIZE", b"\1" + row(1, 1, 684, "a", "684*u1")),
        carry("table_readings_too_big", "TABLE_SIZE", b"\1" + row(1, 2, 680, "a", "680*u1")),
        *[carry(f"layout_{i}", "LAYOUT", table) for i, table in enumerate(layouts)],
    ]


def bads() -> list[dict[str, Any]]:
    """Every packet of wire.json that must be refused."""
    return bad_frames() + bad_texts() + bad_bodies() + bad_tables()
