"""Protocol version 2 as PROTOCOL.md words it, with struct alone, none of our code."""

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
        broken.get("version", 2),
        kind,
        header["flags"],
        length,
        *[header[name] for name in HEADER_FIELDS],
    )
    packet = start + body
    tag = siphash(broken.get("key", PUBLISHED), packet)
    return packet + bytes(have ^ change for have, change in zip(tag, broken.get("tag", bytes(16))))


PUBLISHED = b"vsense, insecure"
"""The key of those that have none."""


def siphash(key: bytes, data: bytes) -> bytes:
    """SipHash-2-4 with 128 bits, as its paper defines it, one step after the other."""
    mask = 2**64 - 1

    def rounds(v: list[int], count: int) -> None:
        for _ in range(count):
            for a, b, turn, lift in ((0, 1, 13, 32), (2, 3, 16, 0), (0, 3, 21, 0), (2, 1, 17, 32)):
                v[a] = (v[a] + v[b]) & mask
                v[b] = rotated(v[b], turn) ^ v[a]
                v[a] = rotated(v[a], lift)

    def rotated(value: int, bits: int) -> int:
        return (value << bits | value >> (64 - bits)) & mask

    k = struct.unpack("<2Q", key)
    names = (b"somepseu", b"dorandom", b"lygenera", b"tedbytes")
    v = [int.from_bytes(name, "big") ^ k[i % 2] for i, name in enumerate(names)]
    v[1] ^= 0xEE
    padded = data + bytes(7 - len(data) % 8) + bytes([len(data) % 256])
    for (word,) in struct.iter_unpack("<Q", padded):
        v[3] ^= word
        rounds(v, 2)
        v[0] ^= word
    tag = b""
    for place, flip in ((2, 0xEE), (1, 0xDD)):
        v[place] ^= flip
        rounds(v, 4)
        tag += struct.pack("<Q", v[0] ^ v[1] ^ v[2] ^ v[3])
    return tag


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
