"""Reads files that somebody named: their kind and size are looked at before their bytes.

A file of gigabytes, a device that never ends and a pipe that nobody writes to are refused like a
file that is not there. Numbers in JSON have to be some that a measurement can be. What is written
(`replace_text`) is there whole or not at all.
"""

from __future__ import annotations

import errno
import json
import os
import re
import secrets
import shutil
import stat
from importlib import resources
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from vsense.base.errors import VsenseError

PACKAGE_FOLDER = Path(str(resources.files("vsense"))).resolve()
"""The folder of vsense's own Python files."""

MOST_FILE_BYTES = 16 << 20
"""Of a file that people write: experiments, resources, cameras, tables."""

MOST_TABLE_BYTES = 256 << 20
"""Of a table that programs write: pictures' times, corners of many views."""

LOG_END_BYTES = 64 << 10
"""So much is read of either end of a log."""

MOST_LOG_BYTES = 16 << 20
"""A log that is longer is cut."""

_KINDS = {
    stat.S_IFIFO: "is a pipe",
    stat.S_IFCHR: "is a device",
    stat.S_IFBLK: "is a device",
    stat.S_IFSOCK: "is a socket",
}

_SUSPICIOUS = re.compile(r"\d{19}|[eE]\+?\d{3}|NaN|Infinity")
"""What numbers that are refused have; most texts are parsed without looking at each number."""
_MOST_WHOLE = 1 << 63
_MEMBER = re.compile(r'"([^"\\]*)"\s*:')


def open_bytes(path: Path) -> BinaryIO:
    """Opens a regular file for reading.

    Raises:
        OSError: it cannot be opened, or is another kind of file; `strerror` says which.
    """
    # Without waiting: the other end of a pipe may never come.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    kind = stat.S_IFMT(os.fstat(descriptor).st_mode)
    if kind != stat.S_IFREG:
        os.close(descriptor)
        if kind == stat.S_IFDIR:
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        what = _KINDS.get(kind, "is no file")
        raise OSError(errno.EINVAL, f"{what}, expected a file", str(path))
    return open(descriptor, "rb")


def check_private(file: BinaryIO, path: Path, what: str, most: int, advised: int = 0o600) -> None:
    """Refuses an open file that others may touch.

    Args:
        file, path: the file, and its name for people.
        what: of it is secret: "the tokens".
        most: bits of a mode that it may have.
        advised: the mode that people are told to give it.

    Raises:
        VsenseError: its mode has other bits.
    """
    mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
    if mode & ~most:
        raise VsenseError(
            f"{path}: others may read or change {what} (mode {mode:04o}): chmod {advised:o} {path}"
        )


def read_bytes(path: Path, most_bytes: int = MOST_FILE_BYTES) -> bytes:
    """Reads a whole file.

    Raises:
        OSError: as `open_bytes`; or it has more than `most_bytes`.
    """
    with open_bytes(path) as file:
        return read_open(file, path, most_bytes)


def read_open(file: BinaryIO, path: Path, most_bytes: int = MOST_FILE_BYTES) -> bytes:
    """Reads an open file whole; OSError if it has more than `most_bytes`."""
    size = os.fstat(file.fileno()).st_size
    # No more memory is asked for than the file has bytes; it may have grown, or not know its size.
    data = b"" if size > most_bytes else file.read(size + 1)
    if len(data) > size:
        data += file.read(most_bytes + 1 - len(data))
    if size > most_bytes or len(data) > most_bytes:
        least = max(size, len(data)) / (1 << 20)
        words = f"has {least:.0f} MB, expected at most {most_bytes >> 20} MB"
        raise OSError(errno.EFBIG, words, str(path))
    return data


def read_text(path: Path, encoding: str = "utf-8", most_bytes: int = MOST_FILE_BYTES) -> str:
    """Reads a whole file of text.

    Raises:
        OSError: as `read_bytes`.
        UnicodeDecodeError: it is no text of this encoding.
    """
    return read_bytes(path, most_bytes).decode(encoding)


def cache_folder() -> Path | None:
    """The account's folder for what can be made again: `$XDG_CACHE_HOME/vsense`, by default
    `~/.cache/vsense`; None: it has no home directory."""
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return Path(base or Path.home() / ".cache") / "vsense"
    except RuntimeError:
        return None


def log_ends(path: Path) -> str:
    """What a program has printed, which may be without end: its first and last `LOG_END_BYTES`.

    Where something between them is left out both have whole lines only. OSError: there is no file.
    """
    with open_bytes(path) as file:
        begun = file.read(LOG_END_BYTES)
        size = os.fstat(file.fileno()).st_size
        if size <= 2 * LOG_END_BYTES:
            return (begun + file.read(LOG_END_BYTES)).decode(errors="replace")
        file.seek(size - LOG_END_BYTES)
        newest = file.read(LOG_END_BYTES)
    whole = begun[: begun.rfind(b"\n") + 1] + newest[newest.find(b"\n") + 1 :]
    return whole.decode(errors="replace")


def cut_log(path: Path) -> None:
    """Cuts the middle out of the log of a program that prints without end, and says so there.

    Whoever appends to it goes on at its end. OSError: it cannot be cut.
    """
    if not os.path.isfile(path) or os.path.getsize(path) <= MOST_LOG_BYTES:
        return
    words = f"vsense: here lines are cut out: more than {MOST_LOG_BYTES >> 20} MB were printed"
    with path.open("rb+") as file:
        file.seek(-LOG_END_BYTES, os.SEEK_END)
        newest = file.read()
        file.truncate(MOST_LOG_BYTES // 2)
    with path.open("ab") as file:
        file.write(b"\n%s\n%s" % (words.encode(), newest[newest.find(b"\n") + 1 :]))


def stamp_of(path: Path) -> tuple[int, ...]:
    """What is another one where somebody has changed a file; (): it is not there."""
    try:
        status = path.stat()
    except OSError:
        return ()
    return status.st_ino, status.st_size, status.st_mtime_ns


def replace_text(
    path: Path,
    text: str,
    mode: int | None = None,
    encoding: str = "utf-8",
    errors: str = "strict",
) -> None:
    """Writes a file of text whole; as `replace_bytes`."""
    replace_bytes(path, text.encode(encoding, errors), mode)


def replace_bytes(path: Path, data: bytes, mode: int | None = None) -> None:
    """Writes a file whole, in place of the one that may be there: readers see the one or the other.

    Nobody but those of its mode can ever read it; a group that the old file had stays its group.
    Without a mode it is as the old one was, or for a new one as the umask says.

    Raises:
        OSError: it cannot be written; what was there is there still.
    """
    old = path.stat() if os.path.exists(path) else None
    if mode is None and old is not None:
        mode = stat.S_IMODE(old.st_mode)
    new = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    begun = 0o666 if mode is None else 0o600
    opened = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, begun)
    try:
        with os.fdopen(opened, "wb") as file:
            file.write(data)
            file.flush()
            # The group first: no other one may read it even for a moment.
            if old is not None and mode != 0o600:
                os.fchown(file.fileno(), -1, old.st_gid)
            if mode is not None:
                os.fchmod(file.fileno(), mode)
            os.fsync(file.fileno())
        os.replace(new, path)
    except BaseException:
        new.unlink(missing_ok=True)
        raise


def free_bytes(folder: Path) -> int | None:
    """What is left on the disk of a folder; None where nobody knows."""
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return None


def parse_json(text: str) -> Any:
    """Parses JSON in which all numbers are finite and of a size that measurements have.

    Raises:
        json.JSONDecodeError: it is no JSON, is nested too deeply, or a number is none of those; the
            message then begins with the member that it belongs to.
    """

    def refuse(number: str) -> NoReturn:
        place = text.index(number)
        member = (_MEMBER.findall(text, 0, place) or ["a number"])[-1]
        shown = number if len(number) <= 20 else f"{number[:20]}..."
        words = f"{member} is {shown}, expected a finite number of at most 18 digits"
        raise json.JSONDecodeError(words, text, place)

    def integer(number: str) -> int:
        if len(number) > 20 or abs(int(number)) >= _MOST_WHOLE:
            refuse(number)
        return int(number)

    def real(number: str) -> float:
        value = float(number)
        if abs(value) == float("inf"):
            refuse(number)
        return value

    try:
        if _SUSPICIOUS.search(text) is None:
            return json.loads(text)
        return json.loads(text, parse_constant=refuse, parse_int=integer, parse_float=real)
    except RecursionError:
        raise json.JSONDecodeError("nested too deeply", text, 0) from None
