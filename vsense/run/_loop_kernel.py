"""Loop functions in this process as C calls them, in every timestep in which they say nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import VsenseError
from vsense.base.native import kernel_ffi, kernels, lib
from vsense.robots.loop_library import CALL, FUNCTIONS, LoopAddress
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
            "note": kernel_ffi.cast("uint32_t *", note.ctypes.data),
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
        self.cdata.places = kernel_ffi.from_buffer("double[]", places)
        self.cdata.colors, self.cdata.told = (
            kernel_ffi.from_buffer("uint8_t[]", array) for array in (colors, told)
        )
        self.cdata.color_bytes = colors.nbytes
        return self.cdata
