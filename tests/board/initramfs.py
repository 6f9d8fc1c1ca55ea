"""Writes the board's root file system: a cpio archive, without root rights or a cpio program.

Source: the "newc" format of the kernel's Documentation/driver-api/early-userspace/buffer-format.
"""

from __future__ import annotations

import gzip
from collections.abc import Mapping
from pathlib import PurePosixPath

_DIRECTORY, _FILE, _CHARACTER = 0o040755, 0o100755, 0o020600
CONSOLE = (5, 1)


def archive(files: Mapping[str, bytes]) -> bytes:
    """Returns the compressed archive of files (all executable), their folders and the console."""
    packed = bytearray()
    number = 0

    def add(name: str, mode: int, content: bytes = b"", device: tuple[int, int] = (0, 0)) -> None:
        nonlocal number
        number += 1
        text = name.encode() + b"\0"
        fields = (number, mode, 0, 0, 1, 0, len(content), 0, 0, *device, len(text), 0)
        packed.extend(b"070701" + b"".join(b"%08x" % field for field in fields) + text)
        packed.extend(bytes(-len(packed) % 4))
        packed.extend(content + bytes(-len(content) % 4))

    folders = {str(p) for name in files for p in PurePosixPath(name).parents if str(p) != "."}
    for folder in sorted({*folders, "dev"}):
        add(folder, _DIRECTORY)
    for name, content in files.items():
        add(name, _FILE, content)
    add("dev/console", _CHARACTER, device=CONSOLE)
    add("TRAILER!!!", 0)
    return gzip.compress(bytes(packed), 1, mtime=0)
