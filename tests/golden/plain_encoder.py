"""Protocol version 2 as PROTOCOL.md words it, with struct and zlib alone, none of our code."""

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
    """Header, body, CRC-32 and 12 zeros as the tag; `broken` overrides a part."""
    length = broken.get("length", 56 + len(body) + 16)
    start = struct.pack(
        "<HBBHHIIIIQQQII",
        broken.get("magic", 0x5356),
        broken.get("version", 2),
        kind,
        header["flags"],
        length,
        *[header[name] for name in HEADER_FIELDS],
    )
    packet = start + body
    crc = struct.pack("<I", zlib.crc32(packet) ^ broken.get("crc", 0))
    return packet + crc + broken.get("zeros", bytes(12))


def hello(m: dict[str, Any]) -> bytes:
    numbers = [m[key] for key in ("started", "uptime_s", "tag", "capabilities", "params_room")]
    texts = [text8(m[key]) for key in ("name", "controller", "version", "hash")]
    start = bytes.fromhex(m["uid"]) + bytes.fromhex(m["nonce"]) + struct.pack("<QIHHH", *numbers)
    return start + b"".join(texts)


def welcome(m: dict[str, Any]) -> bytes:
    params, table = m["params"].encode(), table_bytes(m["table"])
    fixed = struct.pack("<IIH", m["timestep_us"], m["seed"], len(params))
    return bytes.fromhex(m["nonce"]) + fixed + params + struct.pack("<H", len(table)) + table


def state(m: dict[str, Any]) -> bytes:
    x, y, heading = m["goal"]
    fields = m["wanted"], 0, heading, m["from_timestep"], m["log_heard"], x, y
    body = struct.pack("<BBhIIhh", *fields)
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
        "signal_dbm",
        "power_saving",
        "bit_rate",
        "retries",
        "overruns",
        "base_resets",
        "log_number",
    ]
    body = struct.pack("<BBBBIIhhHHIIIIIIIbBHIIII", *[m[name] for name in fields])
    shown = b"".join(shown_item(*item) for item in m["shown"])
    return body + bytes.fromhex(m["payload"]) + text8(m["log"]) + bytes([len(shown)]) + shown


def shown_item(name: str, value: float | str) -> bytes:
    if isinstance(value, str):
        return text8(name) + b"\1" + text8(value)
    return text8(name) + b"\0" + struct.pack("<f", value)


BODIES = {
    "HELLO": hello,
    "WELCOME": welcome,
    "REFUSE": lambda m: struct.pack("<H", m["code"]) + text8(m["text"]),
    "GOODBYE": lambda m: struct.pack("<B", m["code"]) + text8(m["text"]),
    "STATE": state,
    "TELEMETRY": telemetry,
}
