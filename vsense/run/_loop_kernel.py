"""Loop functions in C++ as C calls them in this process, and the floor whose colours they give.

C calls them in every timestep in which they say nothing, and asks them wherever a colour is wanted.
"""

from __future__ import annotations

import mmap
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.errors import VsenseError
from vsense.base.native import kernel_ffi, kernels, lib, pointer
from vsense.base.terminal import Console
from vsense.robots.loop_library import CALL, FUNCTIONS, LoopAddress
from vsense.world.fields import OPAQUE, Floor
from vsense.world.world import World

STEP_FUNCTIONS = ("PreStep", "PostStep", "IsExperimentFinished")
"""What is called in every timestep, as C counts it."""


class LoopKernel:
    """The functions as C calls them; `cdata` is a `struct vs_cxx *`, `note` who runs (3,)."""

    def __init__(self, address: LoopAddress, hear: Callable[[str], None]) -> None:
        """`hear` takes what GetFloorColor has said; an error of it waits for `check`."""
        self._failure: VsenseError | None = None

        def told(whom: Any) -> int:
            try:
                hear(self.answer)
            except VsenseError as error:
                self._failure = error
                return int(lib.VS_ERR_STATE)
            return 0

        names = (*STEP_FUNCTIONS, "GetFloorColor")
        hears, note = (
            kernel_ffi.callback("int(void *)", told),
            np.frombuffer(address.note, np.uint32),
        )
        self._owners, self.note = hears, note
        members = {
            "call": kernel_ffi.cast(CALL, address.call),
            "note": pointer("uint32_t", note),
            "numbers": [address.first_number + FUNCTIONS.index(name) for name in names],
            "answers": 1,
            "hear": hears,
        }
        self.cdata = kernel_ffi.new("struct vs_cxx *", members)

    @property
    def answer(self) -> str:
        """The text of the newest answer."""
        answer = self.cdata.answer
        said: bytes = kernel_ffi.buffer(answer.text, answer.text_size)[:]
        return said.decode(errors="replace")

    def check(self) -> None:
        """Raises the error that GetFloorColor has met."""
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def end(self, ask: Any) -> None:
        """They are called no more: from now on `ask` says the floor's colours."""
        self.cdata.answers, self.cdata.ask = 0, ask

    def painter(self) -> dict[str, Any]:
        """Who is asked for the floor's colours, as members of `struct vs_floor`."""
        asked = kernel_ffi.addressof(kernels, "vs_cxx_paint")
        return {"ask": asked, "whom": self.cdata}

    def follow(self, world: World, told: NDArray[np.uint8]) -> Any:
        """Points to the world, and to the LEDs as they were told; holds until an entity changes."""
        colors, places = world.led_colors, np.empty((len(world.robots), 3))
        self._world = world.sightings, places, colors, told
        self.cdata.world = world.sightings.cdata
        self.cdata.places = pointer("double", places)
        self.cdata.colors, self.cdata.told = (pointer("uint8_t", array) for array in (colors, told))
        self.cdata.color_bytes = colors.nbytes
        return self.cdata


FloorRequest = Callable[[Floats], NDArray[np.uint8] | None]
"""Gives the colours (n, 3) at points (n, 2), None when nobody can be asked any more."""


class FloorPainter:
    """Asks for colours, for C too; how the floor was painted last is what is left in the end."""

    def __init__(self, ask: FloorRequest, kernel: LoopKernel | None) -> None:
        """`kernel` asks without Python, until the end."""
        self._ask, self._kernel = ask, kernel
        self._last: tuple[LoopFloor, int] | None = None
        self._painted = Floor()
        self._failure: VsenseError | None = None

    def paint(self, floor: LoopFloor, most_px: int) -> NDArray[np.uint8]:
        """The picture of a floor, with so many rows and columns at most."""
        width, height = (max(round(size * floor.pixels_per_m), 1) for size in floor.size_m)
        step = -(-max(width, height) // most_px)
        east, north = (np.arange(0, n, step) + 0.5 for n in (width, height))
        x_m = floor.centre_m[0] + floor.size_m[0] * (east / width - 0.5)
        y_m = floor.centre_m[1] + floor.size_m[1] * (0.5 - north / height)
        colors = self._aside(floor, np.stack(np.meshgrid(x_m, y_m), axis=-1))
        image = colors.reshape(len(y_m), len(x_m), 3)
        self._last, self._painted = (floor, most_px), Floor(image, floor.size_m, floor.centre_m)
        return image

    def _aside(self, floor: LoopFloor, points_m: Floats) -> NDArray[np.uint8]:
        """Colours (n, 3) at points, for people.

        What GetFloorColor draws, counts or says there must be no part of the run: it is asked in a
        fork. One that ends for it leaves the floor as it was painted last.
        """
        if self._kernel is None or not self._kernel.cdata.answers:
            return np.asarray(floor.sample(points_m)[:, :3], np.uint8)
        count = points_m.size // 2
        shared, note = mmap.mmap(-1, 3 * count), self._kernel.note.copy()
        pid = os.fork()
        if pid == 0:
            try:
                colors = floor.sample(points_m)[:, :3]
                self.check()
                shared[:] = colors.astype(np.uint8).tobytes()
                os._exit(0)
            except VsenseError as error:
                Console().print_only(f"vsense: the floor's picture: {error}")
            finally:
                os._exit(1)
        ended = os.waitpid(pid, 0)[1]
        self._kernel.note[:] = note  # the memory is shared, and says who runs
        if ended:
            return np.asarray(self._painted.sample(points_m)[:, :3], np.uint8)
        return np.frombuffer(shared, np.uint8).reshape(-1, 3)

    def end(self) -> None:
        """Paints once more what somebody has looked at: the last time that it can be asked for."""
        if self._last is not None:
            self.paint(*self._last)
        if self._kernel is not None:
            self._kernel.end(self._give)

    def check(self) -> None:
        """Raises the error that C has met when it asked for colours."""
        if self._kernel is not None:
            self._kernel.check()
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    @property
    def members(self) -> Mapping[str, Any]:
        """Who is asked, as members of `struct vs_floor`."""
        return {"ask": self._give} if self._kernel is None else self._kernel.painter()

    @cached_property
    def _give(self) -> Any:
        """What gives the colours to C; an error waits for `check`."""

        def give(whom: Any, points_m: Any, count: int, colors: Any) -> int:
            numbers, given = (
                np.frombuffer(kernel_ffi.buffer(array, 8 * size * count)).reshape(-1, size)
                for array, size in ((points_m, 2), (colors, 4))
            )
            try:
                answer = self._ask(numbers) if count else None
            except VsenseError as error:
                self._failure = error
                return int(lib.VS_ERR_STATE)
            given[:, 3] = OPAQUE
            given[:, :3] = self._painted.sample(numbers)[:, :3] if answer is None else answer
            return 0

        return kernel_ffi.callback("int(void *, const double *, uint32_t, double *)", give)


@dataclass(frozen=True)
class LoopFloor(Floor):
    """As in ARGoS no pixel is between a point and its colour. The picture is for people, and is
    painted when they look."""

    painter: FloorPainter | None = None
    pixels_per_m: float = 1.0

    @property
    def _known_by(self) -> Mapping[str, Any]:
        """See `Floor._known_by`."""
        return {} if self.painter is None else self.painter.members

    def check(self) -> None:
        """See `Floor.check`."""
        if self.painter is not None:
            self.painter.check()

    def picture(self, most_px: int) -> NDArray[np.uint8] | None:
        """See `Floor.picture`."""
        if self.painter is None:
            return None
        return self.painter.paint(replace(self, zones=()), most_px)
