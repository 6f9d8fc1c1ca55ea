"""Memory that the processes of the lab share.

`multiprocessing.shared_memory` is not used: before Python 3.13 every process that merely
attaches also unlinks the block when it ends, with warnings. A block made by `anonymous` has no
name in any folder: it is gone with the last process that maps it, whatever killed the others.

The frame bank: pictures of the last few timesteps in memory that two processes share.
"""

from __future__ import annotations

import mmap
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsense.errors import VsenseError

_NAMED = Path("/dev/shm")


class LabError(VsenseError):
    """The lab cannot do its work; the message says which part and why."""


class SharedBlock:
    """Bytes that several processes map.

    Attributes:
        name: What another process of this user passes to `open`. A block made by `anonymous`
            can be opened as long as its maker has not closed it.
        bytes: (size,) uint8, zero at first. The memory lives as long as any view of it.
    """

    def __init__(self, name: str, descriptor: int, created: Path | None = None) -> None:
        """Maps an open file; use `anonymous` or `open`."""
        self.name = name
        self.bytes: NDArray[np.uint8] = np.frombuffer(mmap.mmap(descriptor, 0), dtype=np.uint8)
        self._descriptor: int | None = descriptor
        self._created = created

    @classmethod
    def anonymous(cls, label: str, size: int) -> SharedBlock:
        """Makes a block of `size` bytes that leaves nothing behind; `label` is for people."""
        descriptor = os.memfd_create(label)
        _reserve(descriptor, size, label)
        return cls(f"/proc/{os.getpid()}/fd/{descriptor}", descriptor)

    @classmethod
    def open(cls, name: str, size: int | None = None) -> SharedBlock:
        """Opens the block of another process.

        Args:
            name: The other's `SharedBlock.name`, or a plain name that both sides agreed on.
            size: Where given and nobody has made the plain name yet, it is made with so many
                bytes, and removed again by `close`.

        Raises:
            LabError: There is no such block, or it is smaller than `size`.
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

    def close(self) -> None:
        """Lets go of the block; views that are still in use stay valid."""
        if self._descriptor is None:
            return
        os.close(self._descriptor)
        self._descriptor = None
        self.bytes = self.bytes[:0]
        if self._created is not None:
            self._created.unlink(missing_ok=True)


def _open_existing(path: Path, size: int | None) -> int:
    descriptor = os.open(path, os.O_RDWR)
    found = os.fstat(descriptor).st_size
    if found == 0 or found < (size or 0):
        os.close(descriptor)
        raise LabError(f"shared memory {path.name}: {found} bytes, expected {size or 'more'}")
    return descriptor


def _reserve(descriptor: int, size: int, name: str) -> None:
    """Takes the memory now: what is missing later would end the process with SIGBUS."""
    try:
        os.posix_fallocate(descriptor, 0, size)
    except OSError as error:
        os.close(descriptor)
        raise LabError(f"shared memory {name}: {size} bytes: {error.strerror}") from None


SLOTS = 6
"""Timesteps that the bank holds: one is being made, and a host that has fallen behind may take five
timesteps over the one that it reads before its pictures are drawn over."""

Image8 = NDArray[np.uint8]


class FrameBank:
    """Room for `SLOTS` times one picture of every camera.

    Attributes:
        name: What the other process passes to `open`.
        images: (SLOTS, cameras, h, w) uint8.
    """

    def __init__(self, block: SharedBlock, shape: tuple[int, int, int]) -> None:
        """Lays pictures of `shape` (cameras, h, w) over a block; use `make` or `open`."""
        size = SLOTS * int(np.prod(shape))
        if len(block.bytes) < size:
            raise LabError(f"frame bank: {len(block.bytes)} bytes, {size} are needed")
        self._block = block
        self.name = block.name
        self.images: Image8 = block.bytes[:size].reshape(SLOTS, *shape)

    @classmethod
    def make(cls, shape: tuple[int, int, int]) -> FrameBank:
        """Makes an empty bank that leaves nothing behind."""
        size = SLOTS * int(np.prod(shape))
        return cls(SharedBlock.anonymous("vsense-frames", size), shape)

    @classmethod
    def open(cls, name: str, shape: tuple[int, int, int]) -> FrameBank:
        """Opens the bank of another process.

        Raises:
            LabError: There is none, or it is too small.
        """
        return cls(SharedBlock.open(name), shape)

    def close(self) -> None:
        """Lets go of the bank; pictures that are still in use stay valid."""
        self.images = self.images[:0]
        self._block.close()
