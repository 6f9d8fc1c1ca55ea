"""Protocol version 3 as PROTOCOL.md words it, with struct alone, none of our code."""

from __future__ import annotations

import struct
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
    """Header, body and tag; `broken` overrides a part, or gives the `key`."""
    length = broken.get("length", 56 + len(body) + 16)
    start = struct.pack(
        "<HBBHHIIIIQQQII",
        broken.get("magic", 0x5356),
        broken.get("version", 3),
        kind,
        header["flags"],
        length,
        *[header[name] for name in HEADER_FIELDS],
    )
    packet = start + body
    tag = chaskey(broken.get("key", PUBLISHED), packet)
    return packet + bytes(have ^ change for have, change in zip(tag, broken.get("tag", bytes(16))))


PUBLISHED = b"vsense, insecure"
"""The key of those that have none."""


def chaskey(key: bytes, data: bytes) -> bytes:
    """Chaskey-12 with all 128 bits, as its paper defines it: numbers of 128 bits, algorithm 1."""

    def rotated(value: int, bits: int) -> int:
        return (value << bits | value >> (32 - bits)) & 0xFFFFFFFF

    def permuted(block: int) -> int:
        v = [block >> 32 * i & 0xFFFFFFFF for i in range(4)]
        for _ in range(12):
            for a, b, turn, lift in ((0, 1, 5, 16), (2, 3, 8, 0), (0, 3, 13, 0), (2, 1, 7, 16)):
                v[a] = (v[a] + v[b]) & 0xFFFFFFFF
                v[b] = rotated(v[b], turn) ^ v[a]
                v[a] = rotated(v[a], lift)
        return sum(word << 32 * i for i, word in enumerate(v))

    def times_x(value: int) -> int:
        return (value << 1) ^ (value >> 127) * (1 << 128 | 0x87)

    k = int.from_bytes(key, "little")
    whole = len(data) > 0 and len(data) % 16 == 0
    last_key = times_x(k) if whole else times_x(times_x(k))
    padded = data if whole else data + b"\1" + bytes(15 - len(data) % 16)
    blocks = [int.from_bytes(padded[i : i + 16], "little") for i in range(0, len(padded), 16)]
    h = k
    for block in blocks[:-1]:
        h = permuted(h ^ block)
    return (permuted(h ^ blocks[-1] ^ last_key) ^ last_key).to_bytes(16, "little")


def hello(m: dict[str, Any]) -> bytes:
    names = "started", "uptime_s", "tag", "capabilities"
    rooms = "params_room", "entries_room", "datagram_room"
    numbers = [m[key] for key in (*names, *rooms)]
    texts = [text8(m[key]) for key in ("name", "controller", "version", "hash")]
    start = bytes.fromhex(m["uid"]) + bytes.fromhex(m["nonce"]) + struct.pack("<QIHHHHH", *numbers)
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
        *("state", "wanted", "stop_cause", "battery_low", "wanted_run", "control_step"),
        *("left_steps_s", "right_steps_s", "leds", "battery_mv", "received", "old", "foreign"),
        *("corrupt", "base_errors", "guard_restarts", "clock_bound_us", "signal_dbm"),
        *("power_saving", "bit_rate", "retries", "overruns", "base_resets", "log_number"),
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
