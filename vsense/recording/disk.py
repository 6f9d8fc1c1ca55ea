"""A file that always ends with something whole, whatever the disk does."""

from __future__ import annotations

import errno
import io
import os
from contextlib import suppress
from pathlib import Path

from vsense.recording.form import RecordingError


class WholeFile:
    """A new file that grows by whole pieces.

    Attributes:
        path: where it is.
        length: bytes that are on the disk.
    """

    def __init__(self, path: Path, head: bytes) -> None:
        """Makes the file with its first piece; nobody ever sees it without.

        Raises:
            RecordingError: it cannot be made, or there is one already.
        """
        self.path = path
        self.length = 0
        beginning = path.with_name(f".{path.name}.begun")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists():
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
        """Writes a piece and waits until the disk has it.

        Raises:
            OSError: it could not be written whole; the file ends where it did before.
        """
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
        """Lets the file go; it must not be used any more."""
        os.close(self._fd)


def _sync(fd: int) -> None:
    try:
        getattr(os, "fdatasync", os.fsync)(fd)
    except OSError as error:
        # What has no disk behind it, such as a pipe or a device, has nothing to wait for.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise


def _sync_folder(folder: Path) -> None:
    """Has the disk know a new file's name, too."""
    fd = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        with suppress(OSError):
            os.fsync(fd)
    finally:
        os.close(fd)


class Outbox(io.BytesIO):
    """Where the MCAP writer writes: memory, until somebody takes it to the disk."""

    def __init__(self) -> None:
        """Begins empty, at the file's beginning."""
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
        """What waited is on the disk."""
        self._taken += super().tell()
        self.seek(0)
        self.truncate()
