"""Zip files: written so that the same content gives the same bytes, read as what strangers made.

Nothing of a package is unpacked before all of it was looked at: names, kinds, sizes, checksums.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import shutil
import stat
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import IO

from vsense.base.errors import VsenseError, failing_as
from vsense.base.files import open_bytes
from vsense.modes import origin

MANIFEST = "manifest-sha256.txt"
"""As `sha256sum -c` reads it: all files of a package but itself."""

_MOST_MANIFEST = 16 << 20
_MOST_RATIO, _FREE_BYTES = 200, 256 << 20
"""A package may become so many times as large, and so much in any case."""
_MOST_NAME, _MOST_PART = 1000, 200
_PACKED = (".mcap", ".npz", ".png", ".webp", ".webm", ".zip", ".pdf")
"""What is compressed already."""
_PIECE = 1 << 20
_LINE = re.compile(r"([0-9a-f]{64}) [ *](.+)")
_BROKEN = (
    *(zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError),
    *(RuntimeError, ValueError, KeyError, OverflowError),
)
"""What reading a damaged zip raises, besides OSError."""

Entries = Mapping[str, bytes | Path]
"""A package's files by name: bytes, or where they are."""
EntryProgress = Callable[[str, float], None]


class PackageError(VsenseError):
    """A package that cannot be written, read or believed; the message names it."""

    exit_code = 2


class DamagedPackage(PackageError):
    """Files of a package are not what its checksums say.

    Attributes:
        files: in words, each with what is wrong.
    """

    exit_code = 1

    def __init__(self, path: Path, files: list[str]) -> None:
        more = f" and {len(files) - 20} others" if len(files) > 20 else ""
        super().__init__(f"{path}: is not what was packed: {'; '.join(files[:20])}{more}")
        self.files = files


def wrong_name(name: str) -> str:
    """Says why a file of a package cannot have a name; "": it can."""
    parts = name.split("/")
    if not name or name.startswith("/") or re.match(r"[A-Za-z]:", name):
        return "is no path inside of a package"
    if any(part in ("", ".", "..") for part in parts):
        return "leads out of the package, or nowhere"
    if "\\" in name or not name.isprintable():
        return "has signs that no file of a package has"
    if len(name.encode()) > _MOST_NAME or max(len(part.encode()) for part in parts) > _MOST_PART:
        return "is too long"
    return ""


def digest_of(source: bytes | Path) -> tuple[str, int]:
    """SHA-256 and size of a file's bytes; OSError if it cannot be read."""
    if isinstance(source, bytes):
        return hashlib.sha256(source).hexdigest(), len(source)
    with open_bytes(source) as file:
        return _digest(file)


def _digest(file: IO[bytes]) -> tuple[str, int]:
    digest, size = hashlib.sha256(), 0
    while piece := file.read(_PIECE):
        digest.update(piece)
        size += len(piece)
    return digest.hexdigest(), size


def manifest_of(digests: Mapping[str, str]) -> bytes:
    """The manifest of files, from their SHA-256 by name."""
    return "".join(f"{digests[name]}  {name}\n" for name in sorted(digests)).encode()


def write(path: Path, entries: Entries, progress: EntryProgress = lambda name, share: None) -> None:
    """Writes a package; the same entries give the same bytes.

    Raises:
        PackageError: there is a file already, or it cannot be written; nothing is left then.
    """
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        with failing_as(PackageError, f"{path}: cannot be written"):
            if os.path.exists(path):
                raise PackageError(f"{path}: is there already; expected a new file")
            with zipfile.ZipFile(part, "x", strict_timestamps=True) as archive:
                for number, name in enumerate(sorted(entries)):
                    progress(name, number / len(entries))
                    _add(archive, name, entries[name])
            part.rename(path)
    finally:
        part.unlink(missing_ok=True)


def _add(archive: zipfile.ZipFile, name: str, source: bytes | Path) -> None:
    info = zipfile.ZipInfo(name, origin.DATE)
    info.create_system, info.external_attr = 3, (stat.S_IFREG | 0o644) << 16
    stored = name.endswith(_PACKED)
    info.compress_type = zipfile.ZIP_STORED if stored else zipfile.ZIP_DEFLATED
    info.file_size = len(source) if isinstance(source, bytes) else source.stat().st_size
    with archive.open(info, "w") as target:
        if isinstance(source, bytes):
            target.write(source)
            return
        with open_bytes(source) as file:
            shutil.copyfileobj(file, target, _PIECE)


class Package:
    """A package that is there; a context that closes its file.

    Attributes:
        names: its files, but the manifest.
        size: of all of them, unpacked [byte].
    """

    def __init__(self, path: Path) -> None:
        """Opens it, and looks at everything but the bytes of its files.

        Raises:
            PackageError: it is none, or not one that vsense would make.
        """
        self.path = path
        try:
            with failing_as(PackageError, f"{path}: cannot be read"):
                self._file = open_bytes(path)
                self._bytes = path.stat().st_size
            try:
                self._zip = zipfile.ZipFile(self._file)
                infos = self._zip.infolist()
                self._check(infos)
                self.names = [info.filename for info in infos if info.filename != MANIFEST]
                self.size = sum(info.file_size for info in infos)
                self._digests = self._manifest()
            except BaseException:
                self._file.close()
                raise
        except _BROKEN as error:
            raise PackageError(
                f"{path}: is no package, or only a part of one: expected a zip file that vsense"
                f" pack has made ({error})"
            ) from None

    def __enter__(self) -> Package:
        return self

    def __exit__(self, *exception: object) -> None:
        self._zip.close()
        self._file.close()

    def read(self, name: str, most_bytes: int) -> bytes:
        """A file's bytes; PackageError if it is not there, damaged or larger than that."""
        try:
            info = self._zip.getinfo(name)
            if info.file_size > most_bytes:
                size, most = info.file_size >> 10, most_bytes >> 10
                raise self._error(f"{name} has {size} kB: expected at most {most} kB")
            with self._zip.open(info) as file:
                return file.read(most_bytes)
        except KeyError:
            raise self._error(f"has no {name}: expected a file that vsense pack made") from None
        except (OSError, *_BROKEN) as error:
            raise DamagedPackage(self.path, [f"{name} ({error})"]) from None

    def verify(self, progress: EntryProgress = lambda name, share: None) -> None:
        """Compares every file with its checksum; DamagedPackage names all that are others."""
        problems = []
        names = set(self.names)
        missing = [name for name in self._digests if name not in names]
        problems += [f"{name} is missing" for name in missing]
        problems += [f"{name} was added" for name in self.names if name not in self._digests]
        for number, name in enumerate(self.names):
            progress(name, number / len(self.names))
            if name in self._digests and (what := self._differs(name)):
                problems.append(f"{name} {what}")
        if problems:
            raise DamagedPackage(self.path, problems)

    def unpack(self, folder: Path, progress: EntryProgress = lambda name, share: None) -> None:
        """Writes all files into a folder, which is made, or empty; PackageError if it is not."""
        with failing_as(PackageError, f"{folder}: cannot be written"):
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise PackageError(f"{folder}: is not empty: expected a new folder")
            if shutil.disk_usage(folder).free < self.size:
                raise PackageError(f"{folder}: has no room for {self.size >> 20} MB")
            for number, name in enumerate((*self.names, MANIFEST)):
                progress(name, number / (len(self.names) + 1))
                target = folder / name
                target.parent.mkdir(parents=True, exist_ok=True)
                with self._zip.open(name) as file, target.open("xb") as into:
                    shutil.copyfileobj(file, into, _PIECE)

    def _check(self, infos: list[zipfile.ZipInfo]) -> None:
        if len(infos) > origin.MOST_FILES:
            raise self._error(f"has {len(infos)} files, expected at most {origin.MOST_FILES}")
        for info in infos:
            if what := _what_is_odd(info):
                raise self._error(f"its file {info.filename[:200]!r} {what}")
        names = [info.filename for info in infos]
        # Names are known to be short now: each has few folders above it.
        folders = set[str]()
        for name in names:
            above = name.rpartition("/")[0]
            while above and above not in folders:
                folders.add(above)
                above = above.rpartition("/")[0]
        if (both := next((name for name in names if name in folders), None)) is not None:
            raise self._error(f"its file {both[:200]!r} is a file and a folder")
        twice = [name for name, count in Counter(names).items() if count > 1]
        if twice:
            raise self._error(f"has {twice[0][:200]!r} twice")
        size = sum(info.file_size for info in infos)
        if size > max(_MOST_RATIO * self._bytes, _FREE_BYTES):
            raise self._error(
                f"its {self._bytes >> 10} kB would become {size >> 20} MB: more than any package of"
                " vsense does"
            )

    def _manifest(self) -> dict[str, str]:
        digests: dict[str, str] = {}
        data = self.read(MANIFEST, _MOST_MANIFEST)
        if data.count(b"\n") > origin.MOST_FILES:
            raise DamagedPackage(
                self.path, [f"{MANIFEST} names more than {origin.MOST_FILES} files"]
            )
        for number, line in enumerate(data.decode(errors="replace").splitlines(), 1):
            match = _LINE.fullmatch(line)
            if match is None or match[2] in digests:
                raise DamagedPackage(
                    self.path, [f"line {number} of {MANIFEST} is no checksum of a file"]
                )
            digests[match[2]] = match[1]
        return digests

    def _differs(self, name: str) -> str:
        """Says what is wrong with a file's bytes; "": nothing."""
        try:
            with self._zip.open(name) as file:
                digest, _ = _digest(file)
        except (OSError, *_BROKEN) as error:
            return f"cannot be unpacked ({error})"
        return "" if digest == self._digests[name] else "has changed"

    def _error(self, words: str) -> PackageError:
        return PackageError(f"{self.path}: {words}")


def _what_is_odd(info: zipfile.ZipInfo) -> str:
    """Says what a file of a zip is that no file of a package is; "": nothing."""
    kind = stat.S_IFMT(info.external_attr >> 16)
    if wrong := wrong_name(info.filename):
        return wrong
    if kind not in (0, stat.S_IFREG):
        return "is a link, or no file at all"
    if info.flag_bits & 0x41:
        return "is encrypted"
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        return "is compressed in a way that no package is"
    return ""


def entries_digests(entries: Iterable[tuple[str, bytes | Path]]) -> dict[str, tuple[str, int]]:
    """SHA-256 and size of files, by name; PackageError if one cannot be read."""
    digests = {}
    for name, source in entries:
        with failing_as(PackageError, f"{source if isinstance(source, Path) else name}"):
            digests[name] = digest_of(source)
    return digests
