"""The tracker's threads, and the picture kernels that they run.

C finds and fits markers in each picture for itself and without Python's lock, so pictures are
shared out; all else is done once for all pictures, in the thread that asks.

The kernel accepts markers whose size is a little off, so one search serves heights that are not
far apart; robots of very different heights need a search each. Wherever a marker was found, its
place is given on one plane of reference, on which its picture lies.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from itertools import count
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Found, Image
from vsense.vision.cameras._camera_array import Index
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, SquareFamily
from vsense.vision.tracking._kernel import MARKER, Kernel, scales_of
from vsense.vision.tracking._prediction import MarkerSearch
from vsense.vision.tracking._rows import Rows, each_once, gather, stack_rows
from vsense.vision.tracking.mask import Mask

_OFF = 0.09
"""A marker may be so much nearer or farther than the plane that is searched, as a share."""
_LENGTHS = ("x_m", "y_m", "residual_m", "scale")


class LayeredKernel:
    """Finds and follows one family's markers at all heights; one thread at a time.

    `height_m` is the plane of reference, `heights_m` those of the markers, above the floor; `mask`
    says where they are.
    """

    def __init__(
        self,
        family: MarkerFamily | SquareFamily,
        height_m: float,
        heights_m: Iterable[float],
        mask: Mask | None = None,
    ) -> None:
        self._kernel = Kernel(family, mask)
        self._height_m = height_m
        self._heights_m = sorted({height_m, *heights_m})
        self._layers: dict[Camera, list[float]] = {}

    @property
    def overflows(self) -> int:
        """See `Kernel.overflows`."""
        return self._kernel.overflows

    def read_codes(self, codes: Any) -> None:
        """See `Kernel.read_codes`."""
        self._kernel.read_codes(codes)

    def least_inside_px(self, camera: Camera) -> float:
        """Returns how far inside a picture the centre of a marker's disc is at least [px].

        See `Kernel.inside_m`.
        """
        layers = self._layers_of(camera)
        least = min(scales_of(camera, height_m).least for height_m in layers)
        return self._kernel.inside_m * least

    def search(
        self,
        image: Image,
        camera: Camera,
        windows: NDArray[np.int32] | None = None,
        thorough: bool = True,
        wanted: int = 0,
    ) -> NDArray[np.void]:
        """See `Kernel.search`; places and sizes are given on the plane of reference."""
        parts = []
        for height_m in self._layers_of(camera):
            markers = self._kernel.search(image, camera, height_m, windows, thorough, wanted)
            parts.append(self._refer(markers, camera, height_m))
        return _joined(parts)

    def follow(self, image: Image, camera: Camera, robots: NDArray[np.void]) -> NDArray[np.void]:
        """Fits (n,) EXPECTED robots, given on the plane of reference; see `Kernel.follow`.

        Returns (k,) MARKER of those that fit, with places and sizes on the plane of reference.
        """
        layers = np.array(self._layers_of(camera))
        layer = np.abs(robots["height_m"][:, np.newaxis] - layers).argmin(axis=1)
        centre = np.array(camera.position_m[:2])
        parts = []
        for number in np.unique(layer):
            mine = robots[layer == number]
            share = self._nearer(camera, layers[number])
            places = np.stack((mine["x_m"], mine["y_m"]), axis=1)
            poses = np.column_stack((centre + share * (places - centre), mine["yaw_rad"]))
            markers = self._kernel.follow(image, camera, layers[number], poses)[0]
            parts.append(self._refer(markers, camera, layers[number]))
        return _joined(parts)

    def _nearer(self, camera: Camera, height_m: float) -> float:
        """Returns how far a plane is from the camera, as a share of the reference's distance."""
        top_m = camera.position_m[2]
        return float((top_m - height_m) / (top_m - self._height_m))

    def _refer(
        self, markers: NDArray[np.void], camera: Camera, height_m: float
    ) -> NDArray[np.void]:
        """Carries markers from a plane over to that of reference, seen from the camera."""
        share = self._nearer(camera, height_m)
        if share == 1.0:
            return markers
        for name, centre in zip(_LENGTHS, (*camera.position_m[:2], 0.0, 0.0)):
            markers[name] = centre + (markers[name] - centre) / share
        return markers

    def _layers_of(self, camera: Camera) -> list[float]:
        if camera not in self._layers:
            self._layers[camera] = list(self._divide(camera.position_m[2]))
        return self._layers[camera]

    def _divide(self, top_m: float) -> Iterable[float]:
        """Yields one height per layer; that of reference, where one layer does for all."""
        # As distances from the camera, the farthest first.
        away = [top_m - height for height in self._heights_m]
        reference = top_m - self._height_m
        if max(abs(distance / reference - 1.0) for distance in away) <= _OFF:
            yield self._height_m
            return
        while away:
            layer = [d for d in away if d >= away[0] * (1.0 - _OFF) / (1.0 + _OFF)]
            yield top_m - 0.5 * (layer[0] + layer[-1])
            away = away[len(layer) :]


def _joined(layers: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """Returns one picture's MARKER rows of all layers; what two of them show counts once.

    A layer that is not the marker's can show it, too, but hardly read it: of one place, what was
    read is kept, and of that what is most like its word.
    """
    if len(layers) == 1:
        return layers[0]
    markers = stack_rows(layers)
    order = np.lexsort((markers["error"], markers["tag"] < 0.0))
    return each_once(gather([markers[order]])).values


Result = TypeVar("Result")


class Picture(NamedTuple):
    """A (height, width) uint8 picture, and the camera that took it.

    `place` and `found` are the `Frame`'s.
    """

    image: Image
    camera: Camera
    place: int = 0
    found: Found | None = None


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

    def share(self, work: Callable[[int, int], Result], pieces: int) -> list[Result]:
        """Returns `work(worker, piece)` of every piece, in their order.

        What fails in a thread is raised here, when all have ended.
        """
        if self._pool is None:
            return [work(0, piece) for piece in range(pieces)]
        waiting = iter(range(pieces))  # each piece is taken by one thread

        def take(worker: int) -> list[tuple[int, Result]]:
            return [(piece, work(worker, piece)) for piece in waiting]

        shares = [self._pool.submit(take, n) for n in range(min(self.number, pieces))]
        wait(shares)  # also where one fails: another's kernel is busy until it ends
        results = dict(pair for share in shares for pair in share.result())
        return [results[piece] for piece in range(pieces)]

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
        self._kernels = [
            LayeredKernel(search.family, search.height_m, heights_m, search.mask)
            for _ in range(workers.number)
        ]
        self._workers = workers
        self.full: NDArray[np.bool_] = np.zeros(0, dtype=bool)

    def read_codes(self, codes: object) -> None:
        """Has arrows named by a `struct vs_codes` from now on; it must outlive the kernels."""
        for kernel in self._kernels:
            kernel.read_codes(codes)

    def least_inside_px(self, camera: Camera) -> float:
        """Returns how far inside a picture a marker's disc has its centre at least [px]."""
        return self._kernels[0].least_inside_px(camera)

    def begin(self, pictures: Sequence[Picture]) -> None:
        """Takes a timestep's pictures, for the calls that follow."""
        self._pictures = pictures
        self.full = np.zeros(len(pictures), dtype=bool)

    def search(
        self,
        windows: NDArray[np.int32] | None = None,
        of: Index | None = None,
        quick: NDArray[np.bool_] | None = None,
        wanted: Index | None = None,
    ) -> Rows:
        """Looks for markers in all pictures, or in windows of them.

        Args:
            windows: (n, 4) see `Kernel.search`.
            of: (n,) in which picture each window is.
            quick: (n,) which of the pictures need no thorough search; see `Kernel.search`.
            wanted: (n,) where so many were read, none is looked for that something lies over.

        Returns:
            (k,) MARKER, sorted by the picture.
        """

        def work(worker: int, piece: int) -> NDArray[np.void]:
            kernel, picture = self._kernels[worker], self._pictures[piece]
            mine = None if of is None or windows is None else windows[of == piece]
            if mine is not None and len(mine) == 0:
                return np.zeros(0, dtype=MARKER)
            before = kernel.overflows
            more = 0 if wanted is None else int(wanted[piece])
            markers = kernel.search(
                picture.image, picture.camera, mine, quick is None or not quick[piece], more
            )
            self.full[piece] |= kernel.overflows != before
            return markers

        return gather(self._workers.share(work, len(self._pictures)))

    def follow(self, robots: Rows) -> Rows:
        """Fits (n,) EXPECTED robots, each in its picture; see `LayeredKernel.follow`.

        Returns (k,) MARKER, sorted by the picture.
        """
        pictures = np.unique(robots.picture).tolist()

        def work(worker: int, piece: int) -> NDArray[np.void]:
            number = int(pictures[piece])
            mine = robots.values[robots.picture == number]
            picture = self._pictures[number]
            return self._kernels[worker].follow(picture.image, picture.camera, mine)

        markers = self._workers.share(work, len(pictures))
        return gather([np.zeros(0, dtype=MARKER), *markers], np.array([0, *pictures]))


def _pin(turn: int) -> None:
    """Keeps the calling thread on the processor of its turn, where the system can do that."""
    if hasattr(os, "sched_setaffinity"):
        with suppress(OSError):  # a container may forbid it
            allowed = sorted(os.sched_getaffinity(0))
            os.sched_setaffinity(0, {allowed[turn % len(allowed)]})
