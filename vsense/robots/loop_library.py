"""ARGoS's loop functions in C++, loaded into this process: see `robot/argos/loop_functions.cpp`."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import VsenseError
from vsense.base.native import kernel_ffi

FUNCTIONS = (
    *("world", "construct", "Init", "Reset", "PreStep", "PostStep"),
    *("IsExperimentFinished", "PostExperiment", "Destroy", "GetFloorColor"),
)
"""What can be called; the first two are the host's words for what comes before Init."""

CALL = "void (*)(const char *, size_t, const double *, size_t, struct vs_cxx_answer *)"
"""The type of vs_cxx_call."""

Colors = NDArray[np.uint8]


class CxxLoopError(VsenseError):
    """Loop functions in C++ have failed; the message names the function."""


class LoopAddress(NamedTuple):
    """Where C calls loop functions in this process.

    Attributes:
        call: the address of vs_cxx_call.
        note: (3,) uint32 memory where it is noted who runs.
        first_number: of FUNCTIONS, there.
    """

    call: int
    note: memoryview
    first_number: int


class LoopCaller(Protocol):
    """Calls one function of the loop functions, in this process or in another one."""

    @property
    def address(self) -> LoopAddress | None:
        """For calls from C; None: they are in another process."""
        ...

    def call(
        self, function: str, lines: Sequence[str], numbers: NDArray[np.float64]
    ) -> tuple[str, Colors]:
        """Gives the answer's lines, and the colours of what was asked for.

        Raises:
            CxxLoopError: it crashed or did not return.
        """
        ...

    def close(self) -> None:
        """There is no further call."""
        ...


class LoopLibrary:
    """The shared object of loop functions, as `vsense.robots.build.loop_functions` gives it.

    It has one run at a time: the call of "world" begins the next one. `note` and `first_number` are
    those of `address`.
    """

    first_number = 0

    def __init__(self, library: Path) -> None:
        """Loads it.

        Raises:
            CxxLoopError: that is not possible.
        """
        try:
            function = ctypes.CDLL(str(library)).vs_cxx_call
        except OSError as error:
            raise CxxLoopError(f"{library}: cannot be loaded: {error}") from None
        self._address = ctypes.cast(function, ctypes.c_void_p).value or 0
        self._call: Any = kernel_ffi.cast(CALL, self._address)
        self._answer: Any = kernel_ffi.new("struct vs_cxx_answer *")
        self.note = memoryview(bytearray(12)).cast("I")

    @property
    def address(self) -> LoopAddress | None:
        """See `LoopCaller`."""
        return LoopAddress(self._address, self.note, self.first_number)

    def call(
        self, function: str, lines: Sequence[str], numbers: NDArray[np.float64]
    ) -> tuple[str, Colors]:
        """See `LoopCaller`; a crash here is that of this process."""
        text, answer = "\n".join((function, *lines)).encode(), self._answer
        row = np.ascontiguousarray(numbers, dtype=np.float64).reshape(-1)
        given = kernel_ffi.from_buffer("double[]", row)
        self._call(kernel_ffi.from_buffer(text), len(text), given, len(row), answer)
        said: bytes = kernel_ffi.buffer(answer.text, answer.text_size)[:]
        size = answer.color_count if len(row) else 0
        colors: bytes = kernel_ffi.buffer(answer.colors, size)[:]
        return said.decode(errors="replace"), np.frombuffer(colors, dtype=np.uint8)

    def close(self) -> None:
        """See `LoopCaller`; what is loaded stays."""
