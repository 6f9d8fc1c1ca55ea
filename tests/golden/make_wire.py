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
from good_wire import EMPTY, FULL, MIXED, POLLUTANT, WIDE, goods
from plain_encoder import table_bytes


def vectors() -> dict[str, Any]:
    """Everything that wire.json holds."""
    tables = [
        {"table": t, "hex": table_bytes(t).hex(), "hash": zlib.crc32(table_bytes(t))}
        for t in (EMPTY, POLLUTANT, MIXED, FULL, WIDE)
    ]
    return {"packets": goods(), "tables": tables, "bad": bads()}


if __name__ == "__main__":
    json.dump(vectors(), sys.stdout, indent=1, ensure_ascii=True)
    sys.stdout.write("\n")
