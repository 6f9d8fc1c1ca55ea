"""What the lab's processes share: memory in plain blocks, the newest pictures, and logs.

`multiprocessing.shared_memory` is not used: before Python 3.13 every process that attaches also
unlinks the block when it ends, with warnings. A block made by `anonymous` has no name in any
folder: it ends with the last process that maps it, however the others have ended.

The camera process draws into the bank, the host reads. A timestep that the host has taken is lent
to it: its slot is not drawn over until the last reference to its pictures is gone. Of all other
slots the cameras take the one that was drawn longest ago. So they never wait for the host, and the
newest timestep stays until two newer ones are begun.
"""

from __future__ import annotations

import fcntl
import mmap
import os
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Image
from vsense.base.errors import VsenseError
from vsense.base.native import ffi
from vsense.base.terminal import Console
from vsense.base.writing import BackgroundWriter

_NAMED = Path("/dev/shm")


class LabError(VsenseError):
    """A part of the lab has failed; the message says which and why."""


@contextmanager
def file_errors(name: object) -> Iterator[None]:
    """Raises LabError, which names the file, for what the system refuses to do with it."""
    try:
        yield
    except OSError as error:
        raise LabError(f"{name}: {error.strerror}") from None


RETRY_APPENDS = 10
"""A full disk is tried again with every tenth of the records that come."""


class LogFile:
    """Grows by whole records.

    What a full disk does not take is left out, which is told; the run goes on, and so does the file
    when there is room again. Nobody waits for the disk but `close`, for a while.
    """

    def __init__(self, path: Path, kind: str = "") -> None:
        """Begins a new file; raises LabError where it cannot be written.

        `kind` says what it is, to people.
        """
        self._name = f"{kind} {path}".strip()
        self._length = self._left_out = 0
        with file_errors(self._name):
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
            self._descriptor: int | None = os.open(path, flags, 0o644)
        self._writer = BackgroundWriter(self._name, Console().say)

    def append(self, records: bytes | bytearray) -> None:
        """Adds whole records, or none of them."""
        self._writer.do(partial(self._append, bytes(records)))

    def _append(self, records: bytes) -> None:
        if self._descriptor is None:
            return
        if self._left_out % RETRY_APPENDS:
            self._left_out += 1
            return
        try:
            self._write(self._descriptor, memoryview(records))
        except OSError as error:
            with suppress(OSError):  # at worst half a record stays, which readers leave out
                os.ftruncate(self._descriptor, self._length)
            if not self._left_out:
                self._tell(f"{error.strerror}: it lacks what comes now, and the run goes on")
            self._left_out += 1
        else:
            if self._left_out:
                self._tell("there is room again: it goes on, and has a gap")
            self._length += len(records)
            self._left_out = 0

    def _write(self, descriptor: int, view: memoryview) -> None:
        end = self._length
        while view:
            written = os.pwrite(descriptor, view, end)
            view, end = view[written:], end + written

    def _tell(self, words: str) -> None:
        Console().say(f"{self._name}: {words}")

    def close(self) -> None:
        """Ends the file; can be called again."""
        self._writer.close(self._end)

    def _end(self) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


class SharedBlock:
    """Bytes that several processes map.

    Attributes:
        name: for `open` in another process of this user. A block made by `anonymous` can be opened
            as long as its maker has not closed it.
        bytes: (size,) uint8, zero at first. The memory stays as long as any view of it.
    """

    def __init__(self, name: str, descriptor: int, created: Path | None = None) -> None:
        """Maps an open file; use `anonymous` or `open`."""
        self.name = name
        self.bytes: NDArray[np.uint8] = np.frombuffer(mmap.mmap(descriptor, 0), dtype=np.uint8)
        self._descriptor: int | None = descriptor
        self._created = created

    @classmethod
    def anonymous(cls, label: str, size: int) -> SharedBlock:
        """Makes a block of `size` bytes without a name in any folder; `label` is for people."""
        descriptor = os.memfd_create(label)
        _reserve(descriptor, size, label)
        return cls(f"/proc/{os.getpid()}/fd/{descriptor}", descriptor)

    @classmethod
    def open(cls, name: str, size: int | None = None) -> SharedBlock:
        """Opens the block of another process by its `SharedBlock.name` or a plain name.

        With `size` a plain name that does not exist yet is made with so many bytes, and removed
        again by `close`.

        Raises:
            LabError: there is no such block, or it is smaller than `size`.
        """
        path = _NAMED / name
        try:
            return cls(name, _open_existing(path, size))
        except FileNotFoundError:
            if size is None or path.parent != _NAMED:
                raise LabError(
                    f"shared memory {name}: nobody has made it, or its maker is gone"
                ) from None
        except OSError as error:
            raise LabError(f"shared memory {name}: {error.strerror}") from None
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        _reserve(descriptor, size, name)
        return cls(name, descriptor, created=path)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Holds the lock of this block against other processes; it ends with its process."""
        assert self._descriptor is not None
        fcntl.flock(self._descriptor, fcntl.LOCK_EX)
        try:
            yield
        finally:
            fcntl.flock(self._descriptor, fcntl.LOCK_UN)

    def close(self) -> None:
        """Releases the block; views that are still in use stay valid."""
        if self._descriptor is None:
            return
        os.close(self._descriptor)
        self._descriptor = None
        self.bytes = self.bytes[:0]
        if self._created is not None:
            self._created.unlink(missing_ok=True)


def _open_existing(path: Path, size: int | None) -> int:
    descriptor = os.open(path, os.O_RDWR)
    actual = os.fstat(descriptor).st_size
    if actual == 0 or actual < (size or 0):
        os.close(descriptor)
        raise LabError(f"shared memory {path.name}: {actual} bytes, expected {size or 'more'}")
    return descriptor


def _reserve(descriptor: int, size: int, name: str) -> None:
    """Allocates the memory now: if it were missing later, SIGBUS would end the process."""
    try:
        os.posix_fallocate(descriptor, 0, size)
    except OSError as error:
        os.close(descriptor)
        raise LabError(f"shared memory {name}: {size} bytes: {error.strerror}") from None


BANK_SLOTS = 6
"""Timesteps that the bank holds: one is being drawn, one is the newest, the others can be lent. The
tracker has one, the virtual world another, and others may wait for a recorder."""
MOST_LENT = BANK_SLOTS - 2
"""With more lent, a copy is given, so that the cameras always have the slots that they need."""

_HEADER = np.dtype([("timesteps", "i8", (BANK_SLOTS,)), ("lent", "?", (BANK_SLOTS,))])
"""`timesteps` of the slots count from 1, 0 is none; both are read and written under the lock."""
_PAGE = 4096
"""The pictures begin here."""


def _copied(images: Image) -> Image:
    """Copies pictures to memory of their own, which the system gets back when they are released.

    In the heap they would leave a hole, soon strewn with small things, and the next copy would need
    another: memory would grow with every time that the machine is slow.
    """
    memory = mmap.mmap(-1, images.nbytes, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    copy: Image = np.frombuffer(memory, np.uint8).reshape(images.shape)
    copy[...] = images
    return copy


class FrameBank:
    """Room for `BANK_SLOTS` times one picture of every camera.

    Attributes:
        name: for `open` in another process.
        images: (BANK_SLOTS, cameras, h, w) uint8.
    """

    def __init__(self, block: SharedBlock, shape: tuple[int, int, int]) -> None:
        """Lays pictures of `shape` (cameras, h, w) over a block; use `make` or `open`."""
        size = _size(shape)
        if len(block.bytes) < size:
            raise LabError(f"frame bank: {len(block.bytes)} bytes, {size} are needed")
        self._block = block
        self._header = block.bytes[: _HEADER.itemsize].view(_HEADER)[0]
        self._returned: deque[int] = deque()
        self.name = block.name
        self.images: Image = block.bytes[_PAGE:size].reshape(BANK_SLOTS, *shape)

    @classmethod
    def make(cls, shape: tuple[int, int, int]) -> FrameBank:
        """Makes an empty bank."""
        return cls(SharedBlock.anonymous("vsense-frames", _size(shape)), shape)

    @classmethod
    def open(cls, name: str, shape: tuple[int, int, int]) -> FrameBank:
        """Opens the bank of another process; LabError where there is none, or it is too small."""
        return cls(SharedBlock.open(name), shape)

    def begin(self, timestep: int) -> int:
        """Chooses the slot that a timestep is drawn into; the cameras only."""
        with self._block.locked():
            drawn = np.where(self._header["lent"], np.iinfo(np.int64).max, self._timesteps)
            slot = int(np.argmin(drawn))
            self._timesteps[slot] = timestep + 1
        return slot

    def lend(self, slot: int, timestep: int) -> Image | None:
        """Lends the pictures of a timestep in `slot`; the host only, one thread.

        Returns:
            (cameras, h, w) uint8, which does not change as long as there is a reference to it or
            to a view of it; None where the cameras have begun to draw over it.
        """
        lent = self._header["lent"]
        with self._block.locked():
            while self._returned:
                lent[self._returned.popleft()] = False
            if self._timesteps[slot] != timestep + 1:
                return None
            lent[slot] = True
            scarce = int(lent.sum()) > MOST_LENT
        images = self._borrowed(slot)
        return _copied(images) if scarce else images

    def close(self) -> None:
        """Releases the bank; pictures that are still in use stay valid."""
        self.images = self.images[:0]
        self._block.close()

    @property
    def _timesteps(self) -> NDArray[np.int64]:
        timesteps: NDArray[np.int64] = self._header["timesteps"]
        return timesteps

    def _borrowed(self, slot: int) -> Image:
        """A slot's pictures, which return the slot when any thread releases them last."""
        images: Image = self.images[slot]
        returned = self._returned

        def give_back(pointer: Any, memory: Image = images) -> None:
            # `memory` keeps the bank mapped as long as the pictures are used.
            returned.append(slot)

        lent = ffi.gc(ffi.cast("uint8_t *", ffi.from_buffer(images)), give_back)
        flat: Image = np.frombuffer(ffi.buffer(lent, images.nbytes), np.uint8)
        return flat.reshape(images.shape)


def _size(shape: tuple[int, int, int]) -> int:
    return _PAGE + BANK_SLOTS * int(np.prod(shape))
