"""Looks for keys in all memory of this process, in what is open here, and in the files of a folder.

What is looked for is given with each byte XOR `MASK`, so that it is no find itself.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path

HERE = Path(__file__).parent
MASK = 0x5A
CHUNK, LONGEST = 4_000_000, 64
CANARY = hashlib.sha256(b"canary").digest()
"""This one is to be found."""

_MASKED = bytes(value ^ MASK for value in range(256))


def masked(data: bytes) -> bytes:
    """It and `masked` of it are each other's."""
    return data.translate(_MASKED)


def _memory() -> Iterator[bytes]:
    with open("/proc/self/mem", "rb", buffering=0) as memory:
        for line in Path("/proc/self/maps").read_text().splitlines():
            place, rights, *_ = words = line.split()
            if rights[0] != "r" or words[-1].startswith("[v"):
                continue
            begin, end = (int(word, 16) for word in place.split("-"))
            for start in range(begin, end, CHUNK):
                try:
                    memory.seek(start)
                    yield memory.read(min(CHUNK + LONGEST, end - start))
                except (OSError, ValueError, OverflowError):
                    break  # it is gone by now, or no memory


def _descriptors() -> Iterator[bytes]:
    for name in os.listdir("/proc/self/fd"):
        path = Path("/proc/self/fd", name)
        try:
            if stat.S_ISREG(path.stat().st_mode):
                yield path.read_bytes()
        except OSError:
            continue


def search(who: str) -> None:
    """Searches, and adds a line to the report."""
    asked = json.loads((HERE / "search.json").read_text())
    needles: Mapping[str, bytes] = {n: bytes.fromhex(t) for n, t in asked["needles"].items()}
    found = dict.fromkeys(needles, 0)
    for source in (_memory(), _descriptors()):
        for data in source:
            hidden = masked(data)
            del data
            for name, needle in needles.items():
                found[name] += hidden.count(needle)
    files = [
        path.name
        for path in Path(asked["folder"]).rglob("*")
        if path.is_file()
        and any(needles[name] in masked(path.read_bytes()) for name in ("swarm", "text"))
    ]
    with open(asked["report"], "a") as report:
        counts = " ".join(f"{name} {count}" for name, count in found.items())
        report.write(f"{who} {os.getpid()} {counts} files {','.join(files) or '-'}\n")
