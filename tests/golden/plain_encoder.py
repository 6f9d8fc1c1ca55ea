"""Protocol version 1 as PROTOCOL.md words it, with struct and zlib alone, none of our code."""

from __future__ import annotations

import struct
import zlib
from typing import Any

TYPES = {"HELLO": 1, "WELCOME": 2, "REFUSE": 3, "GOODBYE": 4, "STATE": 5, "TELEMETRY": 6}
HEADER_FIELDS = [
    "session",
    "sequence",
    "run",
    "timestep",
    "capture_ns",
    "send_ns",
    "echo_ns",
    "hold_us",
    "table_hash",
]
SIZES = {"u1": 1, "i2": 2, "u2": 2, "i4": 4, "u4": 4, "f4": 4}
NEVER = 0xFFFFFFFF


def text8(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<B", len(data)) + data


def layout_size(layout: str) -> int:
    count, _, kind = layout.rpartition("*")
    return int(count or "1") * SIZES[kind]


def table_bytes(table: list[list[Any]]) -> bytes:
    rows = [
        struct.pack("<BBH", id_, direction, layout_size(layout)) + text8(name) + text8(layout)
        for id_, direction, name, layout in table
    ]
    return struct.pack("<B", len(rows)) + b"".join(rows)


def seal(kind: int, header: dict[str, int], body: bytes, **broken: Any) -> bytes:
    """Header, body, empty authentication slot, CRC-32; `broken` overrides a part."""
    length = broken.get("length", 56 + len(body) + 20)
    start = struct.pack(
        "<HBBHHIIIIQQQII",
        broken.get("magic", 0x5356),
        broken.get("version", 1),
        kind,
        header["flags"],
        length,
        *[header[name] for name in HEADER_FIELDS],
    )
    packet = start + body + broken.get("tag", bytes(16))
    return packet + struct.pack("<I", zlib.crc32(packet) ^ broken.get("crc", 0))


def hello(m: dict[str, Any]) -> bytes:
    fixed = struct.pack("<QHH", m["nonce"], m["tag"], m["capabilities"])
    texts = [text8(m[key]) for key in ("name", "controller", "version", "hash")]
    return bytes.fromhex(m["uid"]) + fixed + b"".join(texts)


def welcome(m: dict[str, Any]) -> bytes:
    params, table = m["params"].encode(), table_bytes(m["table"])
    fixed = struct.pack("<QIIH", m["nonce"], m["timestep_us"], m["seed"], len(params))
    return fixed + params + struct.pack("<H", len(table)) + table


def state(m: dict[str, Any]) -> bytes:
    body = struct.pack("<BBBBI", m["wanted"], 0, 0, 0, m["from_timestep"])
    for older_us, payload in m["values"]:
        body += struct.pack("<I", older_us) + bytes.fromhex(payload)
    return body


def telemetry(m: dict[str, Any]) -> bytes:
    fields = [
        "state",
        "wanted",
        "stop_cause",
        "battery_low",
        "wanted_run",
        "control_step",
        "left_steps_s",
        "right_steps_s",
        "leds",
        "battery_mv",
        "received",
        "old",
        "foreign",
        "corrupt",
        "base_errors",
        "guard_restarts",
        "clock_bound_us",
    ]
    body = struct.pack("<BBBBIIhhHHIIIIIII", *[m[name] for name in fields])
    return body + bytes.fromhex(m["payload"])


BODIES = {
    "HELLO": hello,
    "WELCOME": welcome,
    "REFUSE": lambda m: struct.pack("<H", m["code"]) + text8(m["text"]),
    "GOODBYE": lambda m: struct.pack("<B", m["code"]) + text8(m["text"]),
    "STATE": state,
    "TELEMETRY": telemetry,
}
