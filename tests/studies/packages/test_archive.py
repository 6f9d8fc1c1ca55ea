"""Packages that strangers, thieves and bad disks have made: one clear error, nothing unpacked."""

from __future__ import annotations

import io
import os
import shutil
import stat
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from threading import Event

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.base.errors import VsenseError
from vsense.studies.packages import _archive, _comparing
from vsense.studies.packages._archive import (
    MANIFEST,
    DamagedPackage,
    Package,
    PackageError,
    manifest_of,
)
from vsense.studies.packages.reproduce import ReproduceOptions, reproduce

FILES: dict[str, bytes] = {"a.txt": b"one\n", "runs/b.csv": b"x\n1\n" * 50, "runs/c.npz": b"\0" * 9}


def sums(files: dict[str, bytes]) -> bytes:
    return manifest_of({name: _archive.digest_of(data)[0] for name, data in files.items()})


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    path = tmp_path / "whole.zip"
    _archive.write(path, {**FILES, MANIFEST: sums(FILES)})
    return path


def zipped(path: Path, members: list[tuple[zipfile.ZipInfo | str, bytes]]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as target:
        for name, data in members:
            target.writestr(name, data)
    return path


def test_the_same_files_are_the_same_bytes_and_come_out_again(whole: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.zip"
    os.utime(whole, (1, 1))
    _archive.write(other, dict(reversed([*FILES.items(), (MANIFEST, sums(FILES))])))
    assert other.read_bytes() == whole.read_bytes()
    with zipfile.ZipFile(whole) as archive:  # what unzip makes: files that all read, one writes
        made = {(info.create_system, info.external_attr >> 16) for info in archive.infolist()}
    assert made == {(3, stat.S_IFREG | 0o644)}
    with Package(whole) as package:
        package.verify()
        package.unpack(tmp_path / "out")
    for name, data in FILES.items():
        assert (tmp_path / "out" / name).read_bytes() == data
    if shutil.which("sha256sum"):
        asked = ["sha256sum", "-c", "--strict", "--quiet", MANIFEST]
        subprocess.run(asked, cwd=tmp_path / "out", check=True)
    with pytest.raises(PackageError, match="is there already"):
        _archive.write(whole, FILES)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["other.zip", "out", "whole.zip"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"runs/b.csv": b"x\n2\n"}, "runs/b.csv.*changed"),
        ({"runs/b.csv": None}, "runs/b.csv.*missing"),
        ({"runs/new.csv": b""}, "runs/new.csv.*added"),
        ({MANIFEST: b"abc  a.txt\n"}, f"line 1 of {MANIFEST}"),
        ({MANIFEST: sums(FILES) * 2}, "line 4"),
    ],
)
def test_what_was_changed_is_named(
    change: dict[str, bytes | None], words: str, tmp_path: Path
) -> None:
    files = {**FILES, MANIFEST: sums(FILES), **change}
    kept = [(name, data) for name, data in files.items() if data is not None]
    path = zipped(tmp_path / "changed.zip", list(kept))
    with pytest.raises(DamagedPackage, match=words), Package(path) as package:
        package.verify()


def link(name: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    info.create_system, info.external_attr = 3, (stat.S_IFLNK | 0o777) << 16
    return info


def bomb() -> list[tuple[zipfile.ZipInfo | str, bytes]]:
    return [(f"zeros-{n}", b"\0" * (1 << 20)) for n in range(5)]


HOSTILE: dict[str, Callable[[], list[tuple[zipfile.ZipInfo | str, bytes]]]] = {
    "leads out": lambda: [("../../etc/passwd", b"")],
    "path inside": lambda: [("/etc/passwd", b"")],
    "leads .*nowhere": lambda: [("runs//x", b"")],
    "signs": lambda: [("runs\\..\\x", b""), ("a", b"")],
    "is a link": lambda: [(link("runs/link"), b"/etc/passwd")],
    "is too long": lambda: [("x" * 201, b"")],
    "file and a folder": lambda: [("runs", b""), ("runs/x", b"")],
    "twice": lambda: [("a", b"1"), ("a", b"2")],
    "more than any package": bomb,
    f"has no {MANIFEST}": lambda: [("a", b"")],
}


@pytest.mark.parametrize("words", HOSTILE)
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_hostile_packages_are_refused_before_anything_is_unpacked(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_archive, "_FREE_BYTES", 1 << 20)
    path = zipped(tmp_path / "hostile.zip", HOSTILE[words]())
    with pytest.raises(PackageError, match=words):
        Package(path)


def test_what_is_encrypted_or_packed_otherwise_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as target:
        target.writestr("a", b"")
    with pytest.raises(PackageError, match="compressed"):
        Package(path)
    zipped(path, [("a", b"secret")])
    data = bytearray(path.read_bytes())
    data[data.index(b"PK\x01\x02") + 8] |= 1  # Source: APPNOTE.TXT, 4.4.4, bit 0
    path.write_bytes(data)
    with pytest.raises(PackageError, match="encrypted"):
        Package(path)


def test_what_is_no_file_or_no_zip_is_named(tmp_path: Path) -> None:
    (tmp_path / "text.zip").write_text("no zip\n")
    os.mkfifo(tmp_path / "pipe.zip")
    for name, words in (
        ("text.zip", "is no package"),
        ("pipe.zip", "is a pipe"),
        ("gone.zip", "No such file"),
        (".", "directory"),
    ):
        with pytest.raises(PackageError, match=words):
            Package(tmp_path / name)


WHOLE = io.BytesIO()
with zipfile.ZipFile(WHOLE, "w", zipfile.ZIP_DEFLATED) as _target:
    for _name, _data in {**FILES, MANIFEST: sums(FILES)}.items():
        _target.writestr(zipfile.ZipInfo(_name), _data)


@settings(max_examples=150)
@given(
    place=st.integers(0, len(WHOLE.getvalue()) - 1),
    byte=st.integers(1, 255),
    cut=st.booleans(),
)
def test_a_changed_byte_is_found_or_changes_no_file(
    place: int, byte: int, cut: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """A few bytes of a zip mean nothing: dates, comments, who made it."""
    data = bytearray(WHOLE.getvalue())
    data[place] ^= byte
    path = tmp_path_factory.getbasetemp() / "flipped.zip"
    path.write_bytes(data[:place] if cut else data)
    try:
        with Package(path) as package:
            package.verify()
            found = {name: package.read(name, 1 << 20) for name in package.names}
    except VsenseError:
        return
    assert found == FILES and not cut


@pytest.mark.parametrize(
    ("contents", "words"),
    [
        (b"[]" * (3 << 20), "vsense-package.json has 6144 kB: expected at most 4096 kB"),
        (b"{}", "vsense-package.json is damaged: it has no 'format'"),
        (b'{"format": 99}', "vsense-package.json is damaged: another format than "),
    ],
)
def test_contents_that_are_none_are_named_once(tmp_path: Path, contents: bytes, words: str) -> None:
    files = {"vsense-package.json": contents}
    path = tmp_path / "theirs.zip"
    _archive.write(path, {**files, MANIFEST: sums(files)})
    with pytest.raises(PackageError) as caught:
        reproduce(path, ReproduceOptions(only_check=True), Event(), len, len)
    assert str(caught.value).startswith(f"{path}: {words}")


def test_tables_are_compared_cell_by_cell() -> None:
    before = "t,x,who\n0,1.5,a\n1,2.5,b\n"
    assert _comparing.tables(before, before) == ""
    now = before.replace("1.5", "1.25").replace("2.5", "3.5") + "2,9,c\n"
    words = _comparing.tables(before, now)
    assert words == "5 cells, by up to 1; the first: line 2, x: 1.5 before, now 1.25"
    assert _comparing.tables(before, before.replace("\n", "\r\n")) == (
        "other bytes with the same cells"
    )


@pytest.mark.parametrize(("share", "names"), [(0.0, ["a.b", "a.n", "c[1]"]), (0.1, ["c[1]"])])
def test_figures_may_differ_by_a_share_of_the_greater(share: float, names: list[str]) -> None:
    before = {"a": {"b": 1.0, "n": 20, "same": "x"}, "c": [1, "x"]}
    now = {"a": {"b": 1.05, "n": 22.1, "same": "x"}, "c": [1, "y"]}
    told = [words.partition(": ")[0] for words in _comparing.figures("", before, now, share)]
    assert told == names
