"""The frame bank: pictures of the last few timesteps in memory that two processes share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsense.lab.shared import LabError, SharedBlock

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
