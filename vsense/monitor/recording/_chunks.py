"""Finds the chunks of a recording, and reads them from bytes that are not trusted.

A recording that was ended in order has an index at its end. Any other is walked through from chunk
to chunk, up to where it was cut off; what is damaged is left out and reported. All sizes are
checked. Functions that read bytes raise `DamagedError` where these are no such record.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Header, Metadata, MetadataIndex

from vsense.monitor.recording import form
from vsense.monitor.recording.form import Head, RecordingError

MAX_CHUNK_BYTES = 256 << 20
"""A larger chunk is damaged: ours end at 4 MB, or after one picture."""

_SMALL_BYTES, _MOST_UNFOLDING = 64 << 10, 1000
"""What a chunk may unfold to: so much, and so many times its packed size. Ours reach 7 times."""
_FEW_RECORDS, _RECORDS_PER_BYTE = 100, 1
"""How many records it may hold: so many, and so many for a packed byte. Ours reach 0.6 a byte."""

FAULTS = (McapError, ValueError, OverflowError, KeyError, struct.error, zstandard.ZstdError)
"""All that the readers of `mcap.records` raise where bytes are no such record."""

_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")


class DamagedError(Exception):
    """Bytes that are no such record; the caller knows what can be saved."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A channel, as far as messages need it: topic, and whether it keeps blobs.

    `derived`: its messages follow from others, and are for other tools.
    """

    topic: str
    blob: bool
    derived: bool = False


@dataclass(frozen=True, slots=True)
class Raw:
    """A message as it is kept; `log_ns` is UTC."""

    channel: int
    log_ns: int
    data: memoryview


def stream(data: bytes | memoryview) -> ReadDataStream:
    """A stream for the readers of `mcap.records`."""
    return ReadDataStream(io.BytesIO(data))


def records(data: memoryview, at: int = 0) -> Iterator[tuple[int, int, memoryview]]:
    """Walks over records: opcode, place, content; DamagedError where one is cut off."""
    while at < len(data):
        if at + _HEAD.size > len(data):
            raise DamagedError("a record without length")
        opcode, length = _HEAD.unpack_from(data, at)
        end = at + _HEAD.size + length
        if end > len(data):
            raise DamagedError("a record longer than what holds it")
        yield opcode, at, data[at + _HEAD.size : end]
        at = end


def _unpack(record: bytes) -> memoryview:
    """Gives the records in a chunk, from its content.

    A few bytes can be made to unfold to gigabytes: such a chunk is damaged.
    """
    try:
        chunk = Chunk.read(stream(record))
        size = chunk.uncompressed_size
        if size > min(MAX_CHUNK_BYTES, _SMALL_BYTES + _MOST_UNFOLDING * len(record)):
            raise DamagedError("a chunk too large to be one")
        data = _decompress(chunk, size)
    except FAULTS as error:
        raise DamagedError(str(error)) from None
    if len(data) != size or (chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc):
        raise DamagedError("a chunk that is not what was packed")
    return memoryview(data)


def _decompress(chunk: Chunk, size: int) -> bytes:
    if chunk.compression == "zstd":
        # A frame's own size is not trusted: it would be allocated.
        if zstandard.frame_content_size(chunk.data) not in (size, -1):
            raise DamagedError("a chunk of two sizes")
        return zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size)
    if chunk.compression == "":
        return chunk.data
    raise DamagedError(f"compression {chunk.compression[:20]!r} is not known")


def channel(record: bytes | memoryview) -> tuple[int, Topic]:
    """Reads a channel: its number, and what messages need of it."""
    try:
        entry = Channel.read(stream(record))
    except FAULTS as error:
        raise DamagedError(str(error)) from None
    marks = entry.metadata
    return entry.id, Topic(entry.topic, form.BLOB in marks, form.DERIVED in marks)


def walk(record: bytes, channels: dict[int, Topic]) -> Iterator[Raw]:
    """Gives a chunk's messages, from its content; adds to `channels` what it declares."""
    most = _FEW_RECORDS + _RECORDS_PER_BYTE * len(record)
    for count, (opcode, _, content) in enumerate(records(_unpack(record))):
        if count >= most:
            raise DamagedError("a chunk of too many records")
        if opcode == Opcode.MESSAGE:
            if len(content) < _MESSAGE.size:
                raise DamagedError("a message without head")
            number, _, log_ns, _ = _MESSAGE.unpack_from(content)
            yield Raw(number, log_ns, content[_MESSAGE.size :])
        elif opcode == Opcode.CHANNEL:
            number, info = channel(content)
            channels[number] = info


MAGIC = b"\x89MCAP0\r\n"
_TIMES = struct.Struct("<QQ")
_FOOTER = struct.Struct("<QQI")
_TAIL = _HEAD.size + _FOOTER.size + len(MAGIC)
_MAX_RECORD = 64 << 20
"""Of records that are no chunk."""
_FAULTS = (*FAULTS, DamagedError)


@dataclass(frozen=True, slots=True)
class ChunkPlace:
    """Where a chunk is: `offset` and `length` of its content in the file.

    `begin_ns` and `end_ns` are UTC of its first and last message; `channels` are those of its
    messages, None: not known.
    """

    offset: int
    length: int
    begin_ns: int
    end_ns: int
    channels: frozenset[int] | None


@dataclass(slots=True)
class Contents:
    """The chunks of a recording in their order, and the channels that are known so far.

    `complete`: it was ended in order, and all of it is here.
    """

    head: Head
    places: list[ChunkPlace]
    channels: dict[int, Topic] = field(default_factory=dict)
    complete: bool = False


def scan(file: BinaryIO, size: int, name: str) -> Contents:
    """Scans a recording of `size` bytes; errors call it `name`.

    Raises:
        RecordingError: it is no recording that this vsense reads.
        OSError: it cannot be read.
    """
    _check_magic(file, size, name)
    first = _first(file, size, name)
    try:
        contents = _read_index(file, size, name)
    except _FAULTS:
        contents = None
    return contents or _walk(file, size, name, first)


def _check_magic(file: BinaryIO, size: int, name: str) -> None:
    if size == 0:
        raise RecordingError(f"{name}: is empty, expected a recording")
    file.seek(0)
    begin = file.read(len(MAGIC))
    if begin != MAGIC[: len(begin)]:
        raise RecordingError(f"{name}: is no MCAP file, expected a recording of vsense")
    if len(begin) < len(MAGIC):
        raise RecordingError(f"{name}: ends within its head")


def _first(file: BinaryIO, size: int, name: str) -> int:
    """Reads the header; gives where the next record is."""
    for opcode, at, length in _heads(file, len(MAGIC), size):
        if opcode != Opcode.HEADER or length > _MAX_RECORD:
            break
        try:
            header = Header.read(stream(_content(file, at, length)))
        except _FAULTS:
            break
        if header.profile != form.PROFILE:
            what = f"of the profile {header.profile[:40]!r}" if header.profile else "of no profile"
            raise RecordingError(f"{name}: is an MCAP file {what}, expected a recording of vsense")
        return at + length
    raise RecordingError(f"{name}: ends within its head, or its head is damaged")


def _heads(file: BinaryIO, at: int, size: int) -> Iterator[tuple[int, int, int]]:
    """Hops over whole records from `at`: opcode, place and length of their contents."""
    while at + _HEAD.size <= size:
        file.seek(at)
        opcode, length = _HEAD.unpack(file.read(_HEAD.size))
        at += _HEAD.size
        if length > size - at:
            return
        yield opcode, at, length
        at += length


def _content(file: BinaryIO, at: int, length: int) -> bytes:
    file.seek(at)
    return file.read(length)


def _read_index(file: BinaryIO, size: int, name: str) -> Contents | None:
    """Reads the index; None: there is none, or not of all."""
    if size < 2 * _TAIL:
        return None
    tail = _content(file, size - _TAIL, _TAIL)
    opcode, length = _HEAD.unpack_from(tail)
    if (opcode, length, tail[-len(MAGIC) :]) != (Opcode.FOOTER, _FOOTER.size, MAGIC):
        return None
    footer = Footer.read(stream(tail[_HEAD.size : -len(MAGIC)]))
    begin, end = footer.summary_start, size - _TAIL
    if not 0 < begin < end:
        return None
    summary = _content(file, begin, end - begin)
    checked = zlib.crc32(tail[: _HEAD.size + 16], zlib.crc32(summary))
    if footer.summary_crc not in (0, checked):
        return None
    places: list[ChunkPlace] = []
    metadata: dict[str, dict[str, str]] = {}
    channels: dict[int, Topic] = {}
    read = 0
    for opcode, _, content in records(memoryview(summary)):
        if opcode == Opcode.CHANNEL:
            number, info = channel(content)
            channels[number] = info
        elif opcode == Opcode.CHUNK_INDEX:
            places.append(_indexed(ChunkIndex.read(stream(content)), begin))
        elif opcode == Opcode.METADATA_INDEX:
            index = MetadataIndex.read(stream(content))
            read += _read_metadata(file, index.offset, begin, metadata)
            if read > size:
                raise DamagedError("metadata that is named twice")
    places.sort(key=lambda place: place.offset)
    # A chunk that is named twice, or inside of another one, would be read as often.
    if any(a.offset + a.length > b.offset for a, b in pairwise(places)):
        raise DamagedError("chunks that overlap")
    return Contents(_head(metadata, name), places, channels, True)


def _indexed(index: ChunkIndex, end: int) -> ChunkPlace:
    at, length = index.chunk_start_offset + _HEAD.size, index.chunk_length - _HEAD.size
    if length < 0 or at + length > end or length > MAX_CHUNK_BYTES:
        raise DamagedError("a chunk outside of the file")
    numbers = frozenset(index.message_index_offsets)
    return ChunkPlace(at, length, index.message_start_time, index.message_end_time, numbers)


def _read_metadata(file: BinaryIO, offset: int, end: int, named: dict[str, dict[str, str]]) -> int:
    """Reads the record there into `entries`; gives its length [byte]."""
    opcode, at, length = next(_heads(file, offset, end), (0, 0, 0))
    if opcode == Opcode.METADATA and length <= _MAX_RECORD:
        metadata = Metadata.read(stream(_content(file, at, length)))
        named[metadata.name] = metadata.metadata
    return length


def _walk(file: BinaryIO, size: int, name: str, first: int) -> Contents:
    """Walks through a recording without index."""
    places: list[ChunkPlace] = []
    records: dict[str, dict[str, str]] = {}
    for opcode, at, length in _heads(file, first, size):
        if opcode == Opcode.CHUNK and _TIMES.size <= length <= MAX_CHUNK_BYTES:
            begin_ns, end_ns = _TIMES.unpack(_content(file, at, _TIMES.size))
            places.append(ChunkPlace(at, length, begin_ns, end_ns, None))
        elif opcode == Opcode.METADATA and length <= _MAX_RECORD:
            try:
                metadata = Metadata.read(stream(_content(file, at, length)))
            except _FAULTS:
                continue
            records[metadata.name] = metadata.metadata
        elif opcode in (Opcode.DATA_END, Opcode.FOOTER):
            break
    return Contents(_head(records, name), places)


def _head(records: Mapping[str, Mapping[str, str]], name: str) -> Head:
    if form.HEAD_RECORD not in records:
        raise RecordingError(f"{name}: ends within its head, or its head is damaged")
    return Head.from_metadata(records[form.HEAD_RECORD], name)
