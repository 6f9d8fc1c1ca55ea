"""Records of an MCAP file from bytes that nobody vouches for: bounded, checked, never more."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk

from vsense.recording import form

MAX_CHUNK_BYTES = 256 << 20
"""A chunk that says to be larger is damaged: ours end at 4 MB, or after one picture."""

FAULTS = (McapError, ValueError, OverflowError, KeyError, struct.error, zstandard.ZstdError)
"""All that the readers of `mcap.records` raise where bytes are no such record."""

_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")


class DamagedError(Exception):
    """Bytes that are no such record; the caller knows what can be saved."""


@dataclass(frozen=True, slots=True)
class Kept:
    """A channel, as far as messages need it: topic, and whether it keeps blobs."""

    topic: str
    blob: bool


@dataclass(frozen=True, slots=True)
class Raw:
    """A message as it is kept; `log_ns` is UTC."""

    channel: int
    log_ns: int
    data: memoryview


def stream(data: bytes | memoryview) -> ReadDataStream:
    """Gives bytes to the readers of `mcap.records`."""
    return ReadDataStream(io.BytesIO(data))


def records(data: memoryview, at: int = 0) -> Iterator[tuple[int, int, memoryview]]:
    """Walks over records: opcode, place, content.

    Raises:
        DamagedError: the last one is not whole.
    """
    while at < len(data):
        if at + _HEAD.size > len(data):
            raise DamagedError("a record without length")
        opcode, length = _HEAD.unpack_from(data, at)
        end = at + _HEAD.size + length
        if end > len(data):
            raise DamagedError("a record longer than what holds it")
        yield opcode, at, data[at + _HEAD.size : end]
        at = end


def unpack(record: bytes) -> memoryview:
    """Gives the records in a chunk.

    Args:
        record: the chunk's content.

    Raises:
        DamagedError: it cannot be unpacked, or is not what was packed.
    """
    try:
        chunk = Chunk.read(stream(record))
        size = chunk.uncompressed_size
        if size > MAX_CHUNK_BYTES:
            raise DamagedError("a chunk too large to be one")
        data = _decompress(chunk, size)
    except FAULTS as error:
        raise DamagedError(str(error)) from None
    if len(data) != size or (chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc):
        raise DamagedError("a chunk that is not what was packed")
    return memoryview(data)


def _decompress(chunk: Chunk, size: int) -> bytes:
    if chunk.compression == "zstd":
        # Of what a frame says of its own size nothing is believed: it would be allocated.
        if zstandard.frame_content_size(chunk.data) not in (size, -1):
            raise DamagedError("a chunk of two sizes")
        return zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size)
    if chunk.compression == "":
        return chunk.data
    raise DamagedError(f"compression {chunk.compression[:20]!r} is not known")


def channel(record: bytes | memoryview) -> tuple[int, Kept]:
    """Reads a channel.

    Raises:
        DamagedError: it is none.
    """
    try:
        found = Channel.read(stream(record))
    except FAULTS as error:
        raise DamagedError(str(error)) from None
    return found.id, Kept(found.topic, form.BLOB in found.metadata)


def walk(data: memoryview, channels: dict[int, Kept]) -> Iterator[Raw]:
    """Gives a chunk's messages; `channels` learns what the chunk declares.

    Raises:
        DamagedError: something in it is no record.
    """
    for opcode, _, content in records(data):
        if opcode == Opcode.MESSAGE:
            if len(content) < _MESSAGE.size:
                raise DamagedError("a message without head")
            number, _, log_ns, _ = _MESSAGE.unpack_from(content)
            yield Raw(number, log_ns, content[_MESSAGE.size :])
        elif opcode == Opcode.CHANNEL:
            number, kept = channel(content)
            channels[number] = kept
