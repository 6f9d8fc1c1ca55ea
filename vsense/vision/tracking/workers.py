"""The tracker's threads, and the picture kernels that they run.

C finds and fits markers in each picture for itself and without Python's lock, so pictures are
shared out; all else is done once for all pictures, in the thread that asks.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import count
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.camera_array import Places
from vsense.vision.tracking.kernel import MARKER, Image
from vsense.vision.tracking.layers import LayeredKernel
from vsense.vision.tracking.prediction import MarkerSearch
from vsense.vision.tracking.rows import Rows, gather

Made = TypeVar("Made")


class Picture(NamedTuple):
    """A (height, width) uint8 picture, and the camera that took it."""

    image: Image
    camera: Camera


class Workers:
    """Threads that share pieces of work; which of them does a piece changes nothing.

    Attributes:
        number: How many there are.
    """

    def __init__(self, number: int = 1, pin: bool = False) -> None:
        """Starts the threads; a single one, unless pinned, is the caller's own.

        Args:
            number: How many, 1 or more.
            pin: Keep each on a processor of its own, where there are as many.
        """
        self.number = number
        turns = count()
        begin = (lambda: _pin(next(turns))) if pin else None
        alone = number == 1 and not pin
        self._pool = None if alone else ThreadPoolExecutor(number, "tracking", begin)

    def share(self, work: Callable[[int, int], Made], pieces: int) -> list[Made]:
        """Returns `work(worker, piece)` of every piece, in their order.

        What fails in a thread is raised here, when all have ended.
        """
        if self._pool is None:
            return [work(0, piece) for piece in range(pieces)]
        waiting = iter(range(pieces))  # each piece is taken by one thread

        def take(worker: int) -> list[tuple[int, Made]]:
            return [(piece, work(worker, piece)) for piece in waiting]

        shares = [self._pool.submit(take, n) for n in range(min(self.number, pieces))]
        wait(shares)  # also where one fails: another's kernel is busy until it ends
        made = dict(one for share in shares for one in share.result())
        return [made[piece] for piece in range(pieces)]

    def close(self) -> None:
        """Ends the threads; can be called again."""
        if self._pool is not None:
            self._pool.shutdown()


class Kernels:
    """One search's kernels, one for each worker.

    Attributes:
        full: Which of the newest pictures have more in them than the kernels' tables hold.
    """

    def __init__(self, search: MarkerSearch, workers: Workers) -> None:
        """Raises FamilyError where the kernel's tables are too small for the family."""
        heights_m = list(search.heights_m.values())
        self._each = [
            LayeredKernel(search.family, search.height_m, heights_m, search.mask)
            for _ in range(workers.number)
        ]
        self._workers = workers
        self.full: NDArray[np.bool_] = np.zeros(0, dtype=bool)

    def read_codes(self, codes: object) -> None:
        """Has arrows named by a `struct vs_codes` from now on; it must outlive the kernels."""
        for kernel in self._each:
            kernel.read_codes(codes)

    def least_inside_px(self, camera: Camera) -> float:
        """Returns how far inside a picture a marker's disc has its centre at least [px]."""
        return self._each[0].least_inside_px(camera)

    def begin(self, pictures: Sequence[Picture]) -> None:
        """Takes a timestep's pictures, for the calls that follow."""
        self._pictures = pictures
        self.full = np.zeros(len(pictures), dtype=bool)

    def search(
        self,
        windows: NDArray[np.int32] | None = None,
        of: Places | None = None,
        quick: NDArray[np.bool_] | None = None,
    ) -> Rows:
        """Looks for markers in all pictures, or in windows of them.

        Args:
            windows: (n, 4) see `Kernel.search`.
            of: (n,) in which picture each window is.
            quick: (n,) which of the pictures need no thorough search; see `Kernel.search`.

        Returns:
            (k,) MARKER, sorted by the picture.
        """

        def work(worker: int, piece: int) -> NDArray[np.void]:
            kernel, picture = self._each[worker], self._pictures[piece]
            mine = None if of is None or windows is None else windows[of == piece]
            if mine is not None and len(mine) == 0:
                return np.zeros(0, dtype=MARKER)
            before = kernel.overflows
            found = kernel.search(*picture, mine, quick is None or not quick[piece])
            self.full[piece] |= kernel.overflows != before
            return found

        return gather(self._workers.share(work, len(self._pictures)))

    def follow(self, robots: Rows) -> Rows:
        """Fits (n,) EXPECTED robots, each in its picture; see `LayeredKernel.follow`.

        Returns (k,) MARKER, sorted by the picture.
        """
        pictures = np.unique(robots.picture).tolist()

        def work(worker: int, piece: int) -> NDArray[np.void]:
            number = int(pictures[piece])
            mine = robots.values[robots.picture == number]
            return self._each[worker].follow(*self._pictures[number], mine)

        found = self._workers.share(work, len(pictures))
        return gather([np.zeros(0, dtype=MARKER), *found], np.array([0, *pictures]))


def _pin(turn: int) -> None:
    """Keeps the calling thread on the processor of its turn, where the system can do that."""
    if hasattr(os, "sched_setaffinity"):
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {allowed[turn % len(allowed)]})
