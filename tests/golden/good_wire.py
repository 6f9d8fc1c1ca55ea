"""Valid packets: ordinary ones and those at every limit."""

from __future__ import annotations

import struct
import zlib
from typing import Any

from plain_encoder import BODIES, HEADER_FIELDS, NEVER, TYPES, seal, table_bytes

HEADER = {
    "flags": 0,
    "session": 0x11223344,
    "sequence": 7,
    "run": 2,
    "timestep": 600,
    "capture_ns": 0x0123456789ABCDEF,
    "send_ns": 0x1122334455667788,
    "echo_ns": 0x99AABBCCDDEEFF00,
    "hold_us": 49_999,
    "table_hash": 0,
}
GREETING = dict.fromkeys(("flags", *HEADER_FIELDS), 0) | {"send_ns": 5_000_000_000}
EXTREME = {"flags": 0xFFFF} | {
    name: 0xFFFFFFFFFFFFFFFF if name in ("capture_ns", "send_ns", "echo_ns") else 0xFFFFFFFF
    for name in HEADER_FIELDS
}

EMPTY: list[list[Any]] = []
POLLUTANT = [[1, 0, "pollutant", "f4"]]
MIXED = [
    [4, 0, "ground_rgb", "3*u1"],
    [200, 1, "pheromone_level", "f4"],
    [2, 0, "light", "8*f4"],
    [0, 0, "position", "2*i4"],
    [255, 1, "drops_total", "2*u4"],
    [9, 0, "räumlich", "i2"],
    [7, 2, "own", "3*i2"],
]
FULL = [[1, 0, "map", "1108*u1"], [2, 1, "notes", "641*u1"], [3, 2, "own", "38*u1"]]
WIDE = [[i, i % 3, f"{'entry':x<28}{i:03d}", "2*i2"] for i in range(32)]

HELLO = {
    "uid": bytes(range(16)).hex(),
    "nonce": bytes(range(0xA0, 0xB0)).hex(),
    "started": 0xB1B2B3B4B5B6B7B8,
    "uptime_s": 86_400,
    "tag": 23,
    "capabilities": 0,
    "params_room": 4096,
    "entries_room": 32,
    "datagram_room": 1200,
    "name": "epuck_23",
    "controller": "pollutant",
    "version": "0.1.0",
    "hash": "0f1e2d3c4b5a6978",
}
REPORT = {
    "state": 1,
    "wanted": 1,
    "stop_cause": 0,
    "battery_low": 255,
    "wanted_run": 2,
    "control_step": 599,
    "left_steps_s": -512,
    "right_steps_s": 1000,
    "leds": 0x3FF,
    "battery_mv": 0,
    "received": 12_000,
    "old": 3,
    "foreign": 2,
    "corrupt": 1,
    "base_errors": 4,
    "guard_restarts": 5,
    "clock_bound_us": 731,
    "signal_dbm": -67,
    "power_saving": 0,
    "bit_rate": 540,
    "retries": 17,
    "overruns": 6,
    "base_resets": 1,
    "log_number": 0,
    "payload": "",
    "log": "",
    "shown": [],
}
MIXED_VALUES = [
    [0, "ff7f00"],
    [250_000, struct.pack("<8f", *[0.1 * i for i in range(8)]).hex()],
    [NEVER, "0000000000000000"],
    [4_000_000_000, struct.pack("<h", -2).hex()],
]


def good(
    name: str,
    kind: str,
    header: dict[str, int],
    message: dict[str, Any],
    table: list[list[Any]] = EMPTY,
) -> dict[str, Any]:
    """A valid packet; its table hash follows from the table unless the header is extreme."""
    head = dict(header)
    if kind not in ("HELLO", "REFUSE") and header is not EXTREME:
        head["table_hash"] = zlib.crc32(table_bytes(message.get("table", table)))
    packet = seal(TYPES[kind], head, BODIES[kind](message))
    vector = {"name": name, "type": kind, "header": head, "message": message}
    return vector | {"table": table, "hex": packet.hex()}


def hellos() -> list[dict[str, Any]]:
    name = "é" * 15 + "x"
    longest = dict(HELLO, tag=65535, capabilities=65535, name=name, controller="c" * 31)
    longest |= {"started": 2**64 - 1, "uptime_s": 2**32 - 1, "params_room": 65535}
    longest |= {"entries_room": 65535, "datagram_room": 65535}
    longest |= {"version": "v" * 31, "hash": "f" * 31}
    small = dict(HELLO, params_room=0, entries_room=8, datagram_room=512)
    empty = dict(small, name="", controller="", version="", hash="")
    return [
        good("hello", "HELLO", GREETING, HELLO),
        good("hello_longest_names", "HELLO", EXTREME, longest),
        good("hello_empty_names", "HELLO", GREETING, empty),
    ]


def welcomes() -> list[dict[str, Any]]:
    nonce = bytes(range(0xC0, 0xD0)).hex()
    bare = {"nonce": nonce, "timestep_us": 100_000, "seed": 0, "params": "", "table": EMPTY}
    params = "stop_probability=0.3\nname=Größe\n"
    mixed = {"nonce": nonce, "timestep_us": 1, "seed": 42, "table": MIXED, "params": params}
    largest = dict(bare, timestep_us=2**32 - 1, seed=2**32 - 1, table=WIDE, params="p" * 4096)
    return [
        good("welcome_no_sensor", "WELCOME", HEADER, bare),
        good("welcome", "WELCOME", HEADER, mixed),
        good("welcome_largest", "WELCOME", HEADER, largest),
    ]


def notices() -> list[dict[str, Any]]:
    return [
        good("refuse", "REFUSE", GREETING, {"code": 1, "text": "tag 23 is in use"}),
        good("refuse_longest_text", "REFUSE", GREETING, {"code": 65535, "text": "t" * 200}),
        good("goodbye", "GOODBYE", HEADER, {"code": 0, "text": ""}, POLLUTANT),
        good("goodbye_longest_text", "GOODBYE", EXTREME, {"code": 255, "text": "€" * 66 + ".."}),
    ]


def states() -> list[dict[str, Any]]:
    base = {"from_timestep": 0, "log_heard": 0, "goal": [0, 0, 0]}
    nothing = dict(base, wanted=3, values=[])
    one = dict(base, wanted=1, from_timestep=603, log_heard=12, values=[[0, "0000803f"]])
    mixed = dict(base, wanted=2, from_timestep=NEVER, log_heard=NEVER, values=MIXED_VALUES)
    full = [[0, bytes(i % 251 for i in range(1108)).hex()]]
    largest = dict(base, wanted=0, values=full)
    home = dict(base, wanted=4, goal=[-32768, 1234, -31415], values=[])
    away = dict(base, wanted=4, goal=[32767, -1, 31415], values=[])
    return [
        good("state_no_sensor", "STATE", HEADER, nothing),
        good("state", "STATE", HEADER, one, POLLUTANT),
        good("state_mixed", "STATE", dict(HEADER, flags=1), mixed, MIXED),
        good("state_largest", "STATE", EXTREME, largest, FULL),
        good("state_home", "STATE", HEADER, home),
        good("state_home_away", "STATE", HEADER, away),
    ]


def reports() -> list[dict[str, Any]]:
    own = struct.pack("<I3h", 7_500, -1, 32767, -32768).hex()
    mixed = dict(REPORT, battery_low=1, payload="0000204103000000ffffffff" + own)
    largest = dict(
        REPORT,
        state=3,
        wanted=3,
        stop_cause=255,
        battery_low=0,
        left_steps_s=-32768,
        right_steps_s=32767,
        signal_dbm=-128,
        power_saving=255,
        bit_rate=65535,
        retries=NEVER,
        log_number=NEVER,
        payload=bytes(i % 253 for i in range(683)).hex(),
        log="l" * 120,
        shown=[[f"{i:015d}", "t" * 48] for i in range(3)] + [["x" * 15, "t" * 39]],
    )
    says = dict(
        REPORT,
        log_number=3,
        log="sah Rot, drehe um: 90°",
        shown=[["state", "searching"], ["n", 0.1], ["é", ""], ["light", -1.5e30]],
        power_saving=1,
        signal_dbm=127,
    )
    return [
        good("telemetry", "TELEMETRY", HEADER, REPORT, POLLUTANT),
        good("telemetry_actuators", "TELEMETRY", dict(HEADER, flags=1), mixed, MIXED),
        good("telemetry_largest", "TELEMETRY", EXTREME, largest, FULL),
        good("telemetry_says", "TELEMETRY", HEADER, says, POLLUTANT),
    ]


def goods() -> list[dict[str, Any]]:
    """Every valid packet of wire.json."""
    return hellos() + welcomes() + notices() + states() + reports()
