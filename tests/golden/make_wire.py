"""Writes wire.json: packets made from PROTOCOL.md with struct and zlib alone, none of our code.

    python tests/golden/make_wire.py > tests/golden/wire.json

A test compares the file with this script's output; C and Python are both held against the file.
"""

from __future__ import annotations

import json
import sys
import zlib
from typing import Any

from bad_wire import bads
from good_wire import EMPTY, FULL, GREETING, HEADER, HELLO, MIXED, POLLUTANT, REPORT, WIDE, goods
from plain_encoder import BODIES, TYPES, chaskey, seal, table_bytes


def vectors() -> dict[str, Any]:
    """Everything that wire.json holds."""
    tables = [
        {"table": t, "hex": table_bytes(t).hex(), "hash": zlib.crc32(table_bytes(t))}
        for t in (EMPTY, POLLUTANT, MIXED, FULL, WIDE)
    ]
    return {"packets": goods(), "tables": tables, "bad": bads(), "session": keyed_session()}


def keyed_session() -> dict[str, str]:
    """A greeting, its answer and a packet each way, of a robot that has a key."""
    root = bytes(range(0x10, 0x20))
    table, values = POLLUTANT, [[0, "0000803f"]]
    head = HEADER | {"table_hash": zlib.crc32(table_bytes(table))}
    greeting = dict(HELLO, capabilities=1)
    hello = seal(TYPES["HELLO"], GREETING, BODIES["HELLO"](greeting), key=root)
    answer = chaskey(root, b"A" + hello[-16:])
    nonce = bytes(range(0xC0, 0xD0)).hex()
    offer = {"nonce": nonce, "timestep_us": 100_000, "seed": 5, "params": "", "table": table}
    first = head | {"sequence": 0, "run": 0, "timestep": 0, "capture_ns": 0}
    welcome = seal(TYPES["WELCOME"], first, BODIES["WELCOME"](offer), key=answer)
    refuse = seal(TYPES["REFUSE"], GREETING, BODIES["REFUSE"]({"code": 1, "text": ""}), key=answer)
    down, up = (chaskey(root, way + hello[-16:] + welcome[-16:]) for way in (b"D", b"U"))
    run = {"wanted": 1, "from_timestep": 0, "log_heard": 0, "goal": [0, 0, 0], "values": values}
    state = seal(TYPES["STATE"], head, BODIES["STATE"](run), key=down)
    telemetry = seal(TYPES["TELEMETRY"], head, BODIES["TELEMETRY"](REPORT), key=up)
    packets = {"root": root, "hello": hello, "welcome": welcome, "refuse": refuse}
    packets |= {"down": down, "up": up, "state": state, "telemetry": telemetry}
    return {name: data.hex() for name, data in packets.items()}


if __name__ == "__main__":
    json.dump(vectors(), sys.stdout, indent=1, ensure_ascii=True)
    sys.stdout.write("\n")
