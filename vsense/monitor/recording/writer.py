"""Writes messages into an MCAP file by whole chunks, each on the disk when `flush` returns.

Even if the disk fails, the file ends with a whole chunk.
"""

from __future__ import annotations

import errno
import io
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from vsense import __version__
from vsense.base.message_bus import Message
from vsense.monitor.foxglove import _schemas
from vsense.monitor.foxglove.channels import Derived
from vsense.monitor.recording import form
from vsense.monitor.recording.form import Head, RecordingError

FLUSH_S = 0.5
"""Time from disk to disk; with what the writing itself takes, less than a second."""


class WholeFile:
    """A new file that grows by whole pieces; it gets its name with the first one.

    `length` is in bytes on the disk. RecordingError if it cannot be made, or exists already.
    """

    def __init__(self, path: Path, head: bytes) -> None:
        self.path = path
        self.length = 0
        beginning = path.with_name(f".{path.name}.begun")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if os.path.exists(path):
                raise RecordingError(f"{path}: is there already; expected a new file")
            self._fd = os.open(beginning, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
            try:
                self.append(head)
                beginning.rename(path)
                _sync_folder(path.parent)
            except OSError:
                os.close(self._fd)
                beginning.unlink(missing_ok=True)
                raise
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written: {error.strerror}") from None

    def append(self, piece: bytes) -> None:
        """Writes a piece and waits until the disk has it; an OSError leaves the file as before."""
        try:
            view, at = memoryview(piece), self.length
            while view:
                written = os.pwrite(self._fd, view, at)
                view, at = view[written:], at + written
            _sync(self._fd)
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._fd, self.length)
            raise
        self.length += len(piece)

    def close(self) -> None:
        """Closes the file."""
        os.close(self._fd)


def _sync(fd: int) -> None:
    try:
        getattr(os, "fdatasync", os.fsync)(fd)
    except OSError as error:
        # A pipe or a device has no disk to wait for.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise


def _sync_folder(folder: Path) -> None:
    """Brings a new file's name to the disk."""
    fd = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        with suppress(OSError):
            os.fsync(fd)
    finally:
        os.close(fd)


class MemoryFile(io.BytesIO):
    """Where the MCAP writer writes: memory, which is copied to the disk and cleared."""

    def __init__(self) -> None:
        super().__init__()
        self._taken = 0

    def tell(self) -> int:
        """Where in the file the next piece will be."""
        return self._taken + super().tell()

    @property
    def waiting(self) -> int:
        """How many bytes wait."""
        return super().tell()

    def clear(self) -> None:
        """Drops what is on the disk now."""
        self._taken += super().tell()
        self.seek(0)
        self.truncate()


class _Record(bytes):
    """A record as it is in the file."""

    __slots__ = ()

    def write(self, builder: RecordBuilder) -> None:
        """Adds it to others, as the library's own records do."""
        builder.write(self)


class ChunkIndices(list[Any]):
    """What the MCAP writer keeps of each chunk until the file's end, as the bytes it then writes.

    As it comes it is 33 objects: in an hour of chunks of a second, 8 MB of a heap that nothing else
    makes grow.
    """

    def append(self, index: ChunkIndex) -> None:
        """Takes what is known of a chunk that has ended."""
        builder = RecordBuilder()
        index.write(builder)
        super().append(_Record(builder.end()))  # type: ignore[no-untyped-call]


CHUNK_BYTES = 4 << 20
"""A chunk ends at this size, even before its time."""
_NEVER = 1 << 62
Encoded = bytes
"""By another name: a recording's own `bytes` is how long it is."""
_MOST_NS = (1 << 64) - 1


class RecordingWriter:
    """One recording that grows; for one thread; for the times see `form.Head`.

    RecordingError if the file cannot be made, or exists already.
    """

    def __init__(self, path: Path, begin_ns: int, utc_shift_ns: int) -> None:
        self.path = path
        self._utc_shift_ns = utc_shift_ns
        self._outbox = MemoryFile()
        # Chunks end where `flush` says, so channels are in the chunk that uses them first.
        self._mcap = Writer(self._outbox, _NEVER, CompressionType.ZSTD)
        # The library has no other place for it; without it only memory is lost.
        vars(self._mcap)["_Writer__chunk_indices"] = ChunkIndices()
        self._mcap.start(form.PROFILE, f"vsense {__version__}")
        self._mcap.add_metadata(
            form.HEAD_RECORD, Head(__version__, begin_ns, utc_shift_ns).as_metadata()
        )
        self._channels: dict[tuple[str, bool | str], int] = {}
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._experiment: dict[str, str] = {}
        self._gathered = 0
        self._file = WholeFile(path, self._outbox.getvalue())
        self._outbox.clear()

    @property
    def bytes(self) -> int:
        """Bytes on the disk."""
        return self._file.length

    @property
    def is_full(self) -> bool:
        """Whether a chunk's bytes were added since the last one."""
        return self._gathered >= CHUNK_BYTES

    def add(self, message: Message) -> int:
        """Adds a message to the present chunk; gives its encoded size; raises as `form.encode`."""
        data = form.encode(message, self._utc_shift_ns)
        self._add(self._channel(message), message.time_ns, data)
        if message.topic == "/experiment":
            self._keep_experiment(message)
        return len(data)

    def add_derived(self, derived: Derived) -> None:
        """Adds a message that follows from ours; readers of recordings pass over it."""
        name = derived.schema
        key = derived.topic, name
        if key not in self._channels:
            text = _schemas.text(name)
            self._channels[key] = self._declare(derived.topic, name, text, {form.DERIVED: "yes"})
        self._add(self._channels[key], derived.time_ns, form.encode_data(derived.data))

    def flush(self) -> None:
        """Ends the chunk and waits until the disk has it.

        Raises:
            OSError: the disk does not take it. The file ends with its last whole chunk, and this
                chunk waits for the next try, before which nothing should be added.
        """
        if self._gathered:
            self._mcap.flush()  # type: ignore[no-untyped-call]
            self._gathered = 0
        self._to_disk()

    def close(self) -> None:
        """Writes the index, and closes the file.

        OSError if the disk does not take it; without its index the recording can still be read.
        """
        try:
            self.flush()
            self._mcap.finish()  # type: ignore[no-untyped-call]
            self._to_disk()
        finally:
            self._file.close()

    def _to_disk(self) -> None:
        if self._outbox.waiting:
            self._file.append(self._outbox.getvalue())
            self._outbox.clear()

    def _add(self, channel: int, time_ns: int, data: Encoded) -> None:
        utc_ns = min(max(time_ns + self._utc_shift_ns, 0), _MOST_NS)
        self._mcap.add_message(channel, utc_ns, data, utc_ns)
        self._gathered += len(data)

    def _channel(self, message: Message) -> int:
        key = message.topic, form.has_blob(message)
        if key not in self._channels:
            marks = {form.BLOB: "base64"} if key[1] else {}
            self._channels[key] = self._declare(message.topic, *form.schema(*key), marks)
        return self._channels[key]

    def _declare(self, topic: str, schema: str, text: Encoded, marks: dict[str, str]) -> int:
        """Makes a channel, and its schema where it is the first that has it."""
        key = schema, text
        if key not in self._schemas:
            self._schemas[key] = self._mcap.register_schema(schema, "jsonschema", text)
        return self._mcap.register_channel(topic, "json", self._schemas[key], marks)

    def _keep_experiment(self, message: Message) -> None:
        """Writes the experiment's facts for other tools."""
        wanted = ("name", "version", "seed", "blind", "command", "file_text")
        values = {key: str(message.data[key]) for key in wanted if key in message.data}
        if values != self._experiment:
            self._experiment = values
            self._mcap.add_metadata(form.EXPERIMENT_RECORD, values)


def gap_message(
    now_ns: int, from_ns: int, to_ns: int, counts: tuple[int, int], why: str
) -> Message:
    """Makes the mark of a gap; `counts` are the messages and pictures that are missing."""
    data = {
        "from_ns": from_ns,
        "to_ns": to_ns,
        "messages": counts[0],
        "pictures": counts[1],
        "why": why,
    }
    return Message(form.GAP, now_ns, data)
