"""No file of 1 MB takes the machine: every reader ends in bounded time and memory.

Each case is read in a process of its own that has 15 s of processor time (5 s are the promise, on a
machine that may be three times as slow) and 256 MB above the file's size; the system ends it where
it wants more. A file is read, or ends in an error of ours. Smaller files have as much less time:
128 kB are enough for what takes the square of the size.
"""

from __future__ import annotations

import hashlib
import io
import json
import multiprocessing
import resource
import struct
import sys
import tempfile
import traceback
import zipfile
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from itertools import islice, product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import zstandard

from tests.monitor.recording.conftest import BEGIN_NS, record
from vsense.base.errors import VsenseError
from vsense.base.message_bus import Message
from vsense.config import battery_history, resources, roster, tracking_session
from vsense.config.arena import read_image
from vsense.config.experiment import load
from vsense.modes import origin
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.ui.access import read_tokens
from vsense.robots import _cmake, key_holders
from vsense.robots.link import keys
from vsense.robots.link.trackers import lines
from vsense.robots.policy import read_policy
from vsense.run.runs_csv import read_runs
from vsense.studies.benchmark import _comparing
from vsense.studies.packages._archive import MANIFEST, Package
from vsense.studies.packages._contents import CONTENTS, MOST_CONTENTS, PackageContents
from vsense.studies.packages._places import Scrubber
from vsense.studies.results import read_arrays
from vsense.studies.series import _plan
from vsense.vision.calibration import checked
from vsense.vision.calibration._views import read_corners
from vsense.vision.calibration.foreign import read_foreign
from vsense.vision.cameras._recordings import read_timestamps
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.picture import read_picture
from vsense.vision.markers.families import load_family
from vsense.vision.tracking import recorded_tracker
from vsense.vision.tracking._node_rows import decode_expectation, decode_rows
from vsense.vision.tracking._prediction import MarkerSearch
from vsense.vision.tracking.node import CameraNode
from vsense.vision.tracking.specs import GrabberSpec

SIZE = 1 << 20
CPU_S = 15
FREE_BYTES = 256 << 20

Hostile = Iterator[tuple[str, bytes]]
"""Files, each with what it is."""


def tracker_lines(path: Path) -> None:
    """What a tracker sends, as the listener takes it: pieces of 64 kB."""
    inbox, data = lines.LineInbox(), path.read_bytes()
    for at in range(0, len(data), 1 << 16):
        for _, text in inbox.feed(data[at : at + (1 << 16)]):
            if text is not None:
                try:
                    lines.parse(text)
                except ValueError:
                    return  # sixteen of them close the connection


def recording(path: Path) -> None:
    with open_recording(path) as opened:
        for _ in opened.messages():
            pass


def node_setup(path: Path) -> None:
    """What a tracker asks a node for, as the node takes it: it refuses, and goes on."""
    answers: list[bytes] = []
    query = SimpleNamespace(
        payload=SimpleNamespace(to_bytes=path.read_bytes), key_expr="", drop=lambda: None,
        reply_err=answers.append, reply=lambda key, data: answers.append(data),
    )  # fmt: skip
    node: Any = object.__new__(CameraNode)
    node._service, node._clock, node._say = None, int, len
    grabber = GrabberSpec("a", "directory", str(path), path, None, 0.0, None, 1)
    node._resources = resources.Resources("", {"a": grabber}, {}, {})
    node._open(query)
    assert answers


def package(path: Path) -> None:
    with Package(path) as opened:
        opened.verify()
        PackageContents.read(opened.read(CONTENTS, MOST_CONTENTS), opened.names)


SHARED = ("tracking session", "plan", "calibration", "capture times", "corners")
"""Readers that share their parser with another one: every third file is enough."""

READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "experiment": ("xml", load),
    "cameras": ("xml", resources.load),
    "tracking session": ("xml", tracking_session.load_whole),
    "camera": ("json", lambda path: Camera.from_json(path.read_text())),
    "marker family": ("json", lambda path: load_family(str(path))),
    "calibration": ("json", checked._read),
    "calibration of OpenCV and ROS": ("yaml", read_foreign),
    "calibration of caliscope": ("toml", read_foreign),
    "benchmark.json": ("json", _comparing.read),
    "tracker's lines": ("json", tracker_lines),
    "roster": ("toml", roster.read),
    "plan": ("toml", _plan.read),
    "runs.csv": ("csv", read_runs),
    "batteries": ("csv", battery_history.read),
    "capture times": ("csv", lambda path: read_timestamps(path, False)),
    "corners": ("csv", lambda path: read_corners(path, 24)),
    "node's rows": ("node", lambda path: decode_rows(path.read_bytes(), 0, SEEN, SOUGHT)),
    "expectations for a node": ("node", lambda path: decode_expectation(path.read_bytes())),
    "setup for a node": ("setup", node_setup),
    "keys": ("text", keys.read),
    "holders of keys": ("text", key_holders.read),
    "tokens": ("text", read_tokens),
    "recording": ("mcap", recording),
    "floor": ("png", read_image),
    "camera's picture": ("png", read_picture),
    "package": ("zip", package),
    "origin": ("zip", origin.read),
    "policy": ("onnx", read_policy),
    "arrays": ("npz", read_arrays),
    "CMake's lists": ("cmake", lambda path: _cmake.read(path.parent, [path])),
    "accounts": ("words", lambda path: Scrubber([]).text(path.read_text())),
}


def filled(piece: bytes, head: bytes = b"", tail: bytes = b"", size: int = 0) -> bytes:
    """A piece as often as it fits."""
    size = size or SIZE
    return head + piece * ((size - len(head) - len(tail)) // len(piece)) + tail


SEEN = [Camera.looking_down("a", 0.0, 0.0, 2.0, 500.0, (640, 480))]
SOUGHT = [MarkerSearch(load_family("arrow4x4"), {31: 0.06})]


def node() -> Hostile:
    """Heads of both kinds of messages that promise little, all, and too much."""
    head = struct.Struct("<4sHHQQqqq4H")
    for kind, count, fill in product((1, 2), (0, 1, 4096, 65535), (b"\0", b"\xff")):
        counts = count, count, count, 0
        yield f"{kind}, {count}", filled(fill, head.pack(b"vsnd", 1, kind, 0, 1, 0, 0, 0, *counts))


def setup() -> Hostile:
    """Setups that are right, but for how much there is of one thing; and any JSON."""
    one = {"format": 1, "tracker": 1, "session": 1, "live": False, "grabbers": ["a"]}
    data = recorded_tracker.of_family(SEEN, "arrow4x4", {31: 0.06})
    camera = data["cameras"][0]
    some = [camera | {"id": str(n)} for n in range(SIZE // 400)]
    tags = [[n, 0.06] for n in range(SIZE // 20)]
    for name, other in {
        "no cameras": {"cameras": []},
        "cameras": {"cameras": some, "sees": {c["id"]: "robots" for c in some}},
        "a large camera": {"cameras": [camera | {"width_px": 1 << 30, "height_px": 1 << 30}]},
        "tags": {"trackers": {"robots": data["trackers"]["robots"] | {"heights_m": tags}}},
        "workers": {"workers": 1 << 40},
    }.items():
        yield name, json.dumps(one | {"tracking": data | other}).encode()
    yield from as_json()


def xml() -> Hostile:
    head, tail = b"<argos-configuration>", b"</argos-configuration>"
    for name, piece in {
        "comments without end": b"<!--",
        "CDATA without end": b"<![CDATA[",
        "comments of dashes": b"<!------>",
        "elements": b"<a/>",
        "attributes": b"<a b='c'/>",
        "text": b"x",
        "quotes": b"\"'",
        "values without end": b"<a b='",
        "depth": b"<a>",
        "entities": b"&#65;",
        "lights": b"<light id='x' position='1,1,1' intensity='1'/>",
    }.items():
        yield name, filled(piece, head)
        yield f"{name}, ended", filled(piece, head, tail)
    yield "a name", head + b"<" + b"a" * (SIZE - 50) + b"/>" + tail
    yield "a number", filled(b"9", b"<argos-configuration><arena size='", b"'/>" + tail)
    many = b"".join(b" a%d='1'" % n for n in range(SIZE // 17))
    yield "an element of many attributes", head + b"<a" + many + b"/>" + tail


def yaml() -> Hostile:
    for name, piece in {
        "items": b"- 1\n",
        "keys": b"a:\n",
        "lists without end": b"a: [",
        "lists": b"a: [1]\n",
        "tags": b"a: !!b !!b\n",
        "lines": b"\n",
        "comments": b" #",
        "blanks": b" ",
        "colons": b":",
    }.items():
        yield name, filled(piece)
        yield f"{name} of a camera", filled(piece, b"camera_matrix:\n  data:\n  ")
    yield "a list", filled(b"1,", b"a: [", b"]")
    yield "a matrix", filled(b"9,", b"image_width: 1\nimage_height: 1\ncamera_matrix:\n  data: [")


def toml() -> Hostile:
    size = SIZE // 4
    for name, piece in {
        "comments": b"#",
        "lines": b"\n",
        "dotted keys": b"a.",
        "tables": b"[[robot]]\n",
        "text": b"'",
        "texts of lines": b'"""',
        "escapes": b'"\\',
    }.items():
        yield name, filled(piece, size=size)
        yield f"{name}, more", filled(piece)
    yield "depth", filled(b"[", b"a = ", size=size)
    yield "inline tables", filled(b"{a=", b"a = ", size=size)
    yield "a number", filled(b"9", b"a = ", size=size)
    yield "a list", filled(b"1,", b"a = [", b"]", size=size)
    yield "keys", b"".join(b"k%d = 1\n" % n for n in range(SIZE // 52))
    yield "long keys", b"".join(b"a%d.b.c.d.e.f.g.h = 1\n" % n for n in range(SIZE // 116))
    yield "robots", b"".join(b"[[robot]]\ntag = %d\n" % n for n in range(SIZE // 95))


def as_json() -> Hostile:
    for name, piece in {
        "depth": b"[",
        "empty lists": b"[],",
        "objects": b'{"a":',
        "numbers": b"1,",
        "digits": b"9",
        "texts": b'"",',
        "escapes": b"\\u0041",
        "names": b'"a":1,',
    }.items():
        yield name, filled(piece)
        yield f"{name} in a list", filled(piece, b"[", b"0]")
        yield f"{name} in an object", filled(piece, b'{"runs":[', b"0]}")
    yield "a text", filled(b"x", b'"', b'"')


def csv() -> Hostile:
    heads = (b"capture_s,timestep\n", b"camera,moment,corner,x_px,y_px\n", b"time,tag\n")
    for name, piece in {
        "commas": b",",
        "lines": b"\n",
        "quotes": b'"',
        "rows": b"1,2,3\n",
        "a field": b"x",
        "NUL": b"\0",
    }.items():
        yield name, filled(piece)
        for head in (*heads, b"run,experiment\n"):
            yield f"{name} after {head.decode().strip()}", filled(piece, head)


def text() -> Hostile:
    for name, piece in {
        "lines": b"\n",
        "signs": b"x",
        "keys": b"1 = " + b"0f" * 32 + b"\n",
        "tokens": b"look=a-long-token\n",
        "holders": b"1 " + b"ab" * 16 + b" 23 2026-11-23 x\n",
        "equal signs": b"=",
    }.items():
        yield name, filled(piece)


def mcap() -> Hostile:
    sent = [Message("/experiment", BEGIN_NS, {"name": "x", "file_text": "<a/>"})]
    sent += [Message("/arena", BEGIN_NS + n, {"n": n, "text": f"{n:099}"}) for n in range(3000)]
    with tempfile.TemporaryDirectory() as folder:
        whole = record(Path(folder) / "run.mcap", sent, []).read_bytes()
    yield "heads", filled(b"\x06" + bytes(8), b"\x89MCAP0\r\n")
    yield "an index that names one chunk often", _indexed_often(whole)
    packed = zstandard.ZstdCompressor().compress(bytes(64 << 20))
    content = struct.pack("<QQQI", 0, 1, 64 << 20, 0) + struct.pack("<I", 4) + b"zstd"
    content += struct.pack("<Q", len(packed)) + packed
    chunk = b"\x06" + struct.pack("<Q", len(content)) + content
    end = whole.index(b"\x0f" + struct.pack("<Q", 4))  # the record DATA_END
    yield "chunks that unfold", filled(chunk, whole[:end])


def _indexed_often(whole: bytes) -> bytes:
    """The same recording, whose index names its longest chunk as often as fits."""
    footer = struct.Struct("<QQI")
    tail = len(whole) - 8 - footer.size - 9
    begin, _, _ = footer.unpack_from(whole, tail + 9)
    indexes, others = [], []
    at = begin
    while at < tail:
        length = 9 + struct.unpack_from("<Q", whole, at + 1)[0]
        (indexes if whole[at] == 0x08 else others).append(whole[at : at + length])
        at += length
    longest = max(indexes, key=lambda one: struct.unpack_from("<Q", one, 9 + 24)[0])
    often = longest * ((SIZE - len(whole)) // len(longest))
    end = b"\x02" + struct.pack("<Q", footer.size) + footer.pack(begin, 0, 0) + whole[-8:]
    return whole[:begin] + b"".join([*others, *indexes, often]) + end


def as_zip() -> Hostile:
    yield "long names", _zip({("a/" * 32_000) + str(n): b"" for n in range(8)})
    yield "many files", _zip({f"f{n}": b"" for n in range(7_000)})
    yield "contents of empty lists", _zip({CONTENTS: filled(b"[],", b"[", b"0]", 255 << 20)})
    yield "contents of 4 MB", _zip({CONTENTS: filled(b"[],", b"[", b"0]", 4 << 20)})
    sums = b"".join(b"%064d  f%d\n" % (n, n) for n in range(200_000))
    yield "checksums", _zip({"a": b"x"}, sums)
    yield "a file that unfolds", _zip({"a": bytes(200 << 20)})
    yield "facts of empty lists", _zip({origin.FACTS: filled(b"[],", b"[", b"0]", 120 << 20)})


@cache
def _zips() -> list[tuple[str, bytes]]:
    """Two readers read them; to pack hundreds of megabytes takes seconds."""
    return list(as_zip())


def _zip(files: dict[str, bytes], manifest: bytes | None = None) -> bytes:
    target, sums = io.BytesIO(), ""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
            sums += f"{hashlib.sha256(data).hexdigest()}  {name}\n"
        archive.writestr(MANIFEST, sums.encode() if manifest is None else manifest)
    return target.getvalue()


def onnx() -> Hostile:
    """Messages of protocol buffers: of a graph, a node, a constant or an attribute many parts."""

    def message(number: int, data: bytes) -> bytes:
        size = bytes(
            [len(data) >> shift & 127 | (128 if shift < 21 else 0) for shift in (0, 7, 14, 21)]
        )
        return bytes([number << 3 | 2]) + size + data

    size = SIZE - 64
    for name, piece in {
        "nodes": message(1, b"\x12\x01y"),
        "constants": message(5, b"\x10\x01"),
        "inputs": message(11, b"\x0a\x01x"),
        "outputs": message(12, b"\x0a\x01y"),
        "inputs of a node": b"\x0a\x01x",
        "depth": b"\x0a",
        "wholes": b"\x80",
    }.items():
        yield name, message(7, filled(piece, size=size))
        yield f"{name} in a node", message(7, message(1, filled(piece, b"\x12\x01y", size=size)))
        yield f"{name} in a constant", message(7, message(5, filled(piece, size=size)))
    for number in (1, 4, 5, 7, 9):
        yield f"field {number}", message(7, message(5, message(number, bytes(size)) + b"\x10\x01"))
        attribute = message(1, b"\x12\x01y" + message(5, message(number, bytes(size))))
        yield f"attribute {number}", message(7, attribute)


def png() -> Hostile:
    """Pictures of zeros, of one bit to a pixel and in colours."""
    for bits, side in product((1, 24), (4096, 16384)):
        rows = zlib.compress(bytes(min((1 + side * bits // 8) * side, 120 << 20)), 9)
        size = struct.pack(">IIBBBBB", side, side, min(bits, 8), 2 * (bits > 8), 0, 0, 0)
        data = b"\x89PNG\r\n\x1a\n"
        for name, part in ((b"IHDR", size), (b"IDAT", rows), (b"IEND", b"")):
            data += struct.pack(">I", len(part)) + name + part
            data += struct.pack(">I", zlib.crc32(name + part))
        yield f"{side} x {side} pixels of {bits} bits", data


def npz() -> Hostile:
    """Arrays that say they are larger than they are, and that unfold."""
    for count, zeros in product((1 << 25, 20 * 10**12), (0, 256 << 20)):
        head = (
            f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({count},), }}".ljust(117) + "\n"
        )
        array = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode()
        target = io.BytesIO()
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("poses.npy", array + bytes(zeros))
        yield f"{count} numbers, {zeros} bytes", target.getvalue()


def cmake() -> Hostile:
    """Commands, texts and comments that never end, however they begin."""
    yield "variables that double", b"set(a x)" + b'set(a "${a}${a}")\n' * 60
    yield "variables that repeat", b"set(a %s)" % (b"x" * 50_000) + b"set(b ${a})" * 5_000
    pieces = ("a", "a(", 'a("', "#[[\n", '"', '\\"', 'a(\\"', 'a(("\\"', '("', "a ( ", "${a}")
    for head, piece in product(("", '"', 'a("', "a(("), pieces):
        yield f"{head} {piece}", filled(piece.encode(), head.encode())


def words() -> Hostile:
    for piece in ("a.", "1.", "a-", "a@", "1.1.1.1 ", "ab:", "a"):
        yield piece, filled(piece.encode())


FORMS: dict[str, Callable[[], Hostile]] = {
    "onnx": onnx,
    "xml": xml,
    "toml": toml,
    "yaml": yaml,
    "node": node,
    "setup": setup,
    "json": as_json,
    "csv": csv,
    "text": text,
    "mcap": mcap,
    "png": png,
    "npz": npz,
    "cmake": cmake,
    "words": words,
    "zip": lambda: iter(_zips()),
}


def read_bounded(read: Callable[[Path], object], path: Path, cpu_s: int) -> str:
    """Reads a file in a process with bounds; says what went wrong, "": nothing."""
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)

    def inside() -> None:
        used = resource.getrusage(resource.RUSAGE_SELF)
        seconds = int(used.ru_utime + used.ru_stime) + cpu_s + 1
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + path.stat().st_size + FREE_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        try:
            read(path)
        except BaseException as error:
            # That memory has run out is no answer, whatever words a reader gives it.
            cause: BaseException | None = error
            while isinstance(cause, VsenseError) and cause.__context__ is not None:
                cause = cause.__context__
            if not isinstance(error, VsenseError) or isinstance(cause, MemoryError):
                place = traceback.extract_tb((cause or error).__traceback__)[-1]
                theirs.send(f"{type(cause).__name__} at {place.filename}:{place.lineno}")

    child = context.Process(target=inside)
    child.start()
    theirs.close()
    try:
        said = str(ours.recv())
    except EOFError:
        said = ""
    child.join()
    return said or (f"ended by {child.exitcode}" if child.exitcode else "")


@pytest.mark.parametrize("size", [SIZE // 8, pytest.param(SIZE, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("name", READERS)
def test_a_reader_is_bounded(
    name: str, size: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Packages, recordings and arrays are of 1 MB always."""
    if READERS[name][0] not in ("zip", "mcap", "npz"):
        monkeypatch.setattr(sys.modules[__name__], "SIZE", size)
    form, read = READERS[name]
    cpu_s = CPU_S * SIZE // (1 << 20)
    path, wrong = tmp_path / f"hostile.{form}", {}
    for what, data in islice(FORMS[form](), 0, None, 3 if name in SHARED else 1):
        assert len(data) <= max(size, SIZE) + 4096, what
        path.write_bytes(data)
        path.chmod(0o600)
        if said := read_bounded(read, path, cpu_s):
            wrong[what] = said
    assert wrong == {}
