"""Files that are no recordings, or no whole ones: one clear line, or what can be saved."""

from __future__ import annotations

import random
import struct
import tracemalloc
from pathlib import Path

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from tests.monitor.recording.conftest import BEGIN_NS, picture, record
from vsense.base.message_bus import Message
from vsense.monitor.recording import _chunks
from vsense.monitor.recording.form import RecordingError
from vsense.monitor.recording.reader import open_recording

SENT = [Message("/experiment", BEGIN_NS, {"name": "x", "file_text": "<a/>"})] + [
    Message("/arena", BEGIN_NS + n, {"n": n}) for n in range(5)
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("whole")
    return record(folder / "run.mcap", SENT, [picture(1)]).read_bytes()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("tails")


def look(path: Path) -> int:
    """Reads all of a file in every way; gives how many messages it holds."""
    with open_recording(path) as recording:
        found = list(recording.messages())
        recording.newest(None, 0.5)
        list(recording.messages({"/arena"}, 0.1))
        assert recording.duration_s >= 0.0 and isinstance(recording.gaps, list)
        assert isinstance(recording.experiment, dict)
        return len(found)


def test_every_truncation_opens_or_says_why(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    counts = []
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        try:
            counts.append(look(path))
        except RecordingError as error:
            assert not counts, "what opens goes on opening when more of it is there"
            assert str(error).startswith(f"{path}: ")
    assert counts == sorted(counts)
    assert counts[-1] == len(SENT) + 1


def test_flipped_bytes_are_refused_or_left_out(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "flipped.mcap"
    draw = random.Random(1)
    for _ in range(1000):
        flipped = bytearray(whole)
        for _ in range(draw.choice((1, 1, 2, 8))):
            flipped[draw.randrange(len(flipped))] = draw.randrange(256)
        path.write_bytes(flipped)
        try:
            assert look(path) <= len(SENT) + 1
        except RecordingError as error:
            assert str(error).startswith(f"{path}: ")


@given(st.binary(max_size=300))
def test_any_bytes_in_place_of_the_end(whole: bytes, folder: Path, tail: bytes) -> None:
    path = folder / "tail.mcap"
    path.write_bytes(whole[: len(whole) - 600] + tail)
    look(path)


def test_a_damaged_chunk_costs_that_chunk_only(tmp_path: Path) -> None:
    large = {"text": "".join(map(chr, random.Random(1).choices(range(33, 126), k=5 << 20)))}
    sent = [Message("/a", BEGIN_NS + n, large | {"n": n}) for n in range(3)]
    path = record(tmp_path / "run.mcap", sent)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with open_recording(path) as recording:
        assert [message.data["n"] for message in recording.messages()] == [0, 2]
        assert len(recording.damaged) == 1


def test_files_that_are_no_recordings(whole: bytes, tmp_path: Path) -> None:
    foreign, newer = tmp_path / "foreign.mcap", tmp_path / "newer.mcap"
    with foreign.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("ros2", "somebody")
        writer.finish()  # type: ignore[no-untyped-call]
    newer.write_bytes(
        whole.replace(b"\x06\0\0\0format\x03\0\0\x001.2", b"\x06\0\0\0format\x03\0\0\x002.0")
    )
    late = whole.replace(
        b"\x08\0\0\0begin_ns\x0a\0\0\x005000000000", b"\x08\0\0\0begin_ns\x0a\0\0\x00500000000x"
    )
    assert late != whole
    files = {
        "late": (late, "its head is damaged"),
        "empty": (b"", "is empty, expected a recording"),
        "text": (b"timestep,tag\n1,2\n", "is no MCAP file, expected a recording of vsense"),
        "short": (_chunks.MAGIC[:5], "ends within its head"),
        "head": (whole[:30], "ends within its head, or its head is damaged"),
        "foreign": (foreign.read_bytes(), "is an MCAP file of the profile 'ros2'"),
        "newer": (newer.read_bytes(), "is a recording of format 2.0, written by vsense"),
    }
    for name, (data, expected) in files.items():
        path = tmp_path / name
        path.write_bytes(data)
        with pytest.raises(RecordingError) as caught:
            open_recording(path)
        assert str(caught.value).startswith(f"{path}: {expected}")
    for path, expected in ((tmp_path / "no", "No such file"), (tmp_path, "Is a directory")):
        with pytest.raises(RecordingError, match=expected):
            open_recording(path)


def chunk(records: bytes) -> bytes:
    """A chunk's record."""
    packed = zstandard.ZstdCompressor().compress(records)
    name = struct.pack("<I", 4) + b"zstd"
    content = struct.pack("<QQQI", 0, 1, len(records), 0) + name
    content += struct.pack("<Q", len(packed)) + packed
    return b"\x06" + struct.pack("<Q", len(content)) + content


def messages(count: int) -> bytes:
    """Records of so many small messages of the channel 1."""
    return (b"\x05" + struct.pack("<QHIQQ", 24, 1, 0, BEGIN_NS, BEGIN_NS) + b"{}") * count


@pytest.mark.parametrize(
    ("records", "count"),
    [
        (bytes(64 << 20), 0),  # 64 MB in 2 kB
        (messages(500_000), 0),
        (messages(3000), 300),
    ],
)
def test_a_chunk_that_unfolds_to_too_much_is_damaged(
    records: bytes, count: int, whole: bytes, tmp_path: Path
) -> None:
    end = whole.index(b"\x0f" + struct.pack("<Q", 4))  # of the data: the record DATA_END
    path = tmp_path / "bomb.mcap"
    path.write_bytes(whole[:end] + chunk(records) * 3)
    tracemalloc.start()
    with open_recording(path) as recording:
        found = list(recording.messages({"/experiment", "/arena"}))
        assert len(recording.damaged) == 3
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(found) <= len(SENT) + 3 * count
    assert [message.data for message in found[: len(SENT)]] == [some.data for some in SENT]
    assert peak_bytes < 8 << 20
