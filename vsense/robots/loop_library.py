"""ARGoS's loop functions in C++, loaded into this process: see `robot/argos/loop_functions.cpp`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from cffi import FFI
from numpy.typing import NDArray

from vsense.base.errors import VsenseError

FUNCTIONS = (
    *("world", "construct", "Init", "Reset", "PreStep", "PostStep"),
    *("IsExperimentFinished", "PostExperiment", "Destroy", "GetFloorColor"),
)
"""What can be called; the first two are the host's words for what comes before Init."""

_DECLARATIONS = """
struct vs_loop_answer {
    const char *text;
    size_t text_size;
    const unsigned char *colors;
    size_t color_count;
};
void vs_loop_call(const char *text, size_t size, const double *numbers, size_t count,
                  struct vs_loop_answer *answer);
"""

Colors = NDArray[np.uint8]


class CxxLoopError(VsenseError):
    """Loop functions in C++ have failed; the message names the function."""


class LoopAddress(NamedTuple):
    """Where C calls loop functions in this process.

    Attributes:
        call: the address of vs_loop_call.
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


@cache
def _ffi() -> FFI:
    ffi = FFI()
    ffi.cdef(_DECLARATIONS)
    return ffi


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
        ffi = _ffi()
        try:
            self._lib: Any = ffi.dlopen(str(library))
        except OSError as error:
            raise CxxLoopError(f"{library}: cannot be loaded: {error}") from None
        self._answer: Any = ffi.new("struct vs_loop_answer *")
        self.note = memoryview(bytearray(12)).cast("I")

    @property
    def address(self) -> LoopAddress | None:
        """See `LoopCaller`."""
        ffi = _ffi()
        call = int(ffi.cast("uintptr_t", ffi.addressof(self._lib, "vs_loop_call")))
        return LoopAddress(call, self.note, self.first_number)

    def call(
        self, function: str, lines: Sequence[str], numbers: NDArray[np.float64]
    ) -> tuple[str, Colors]:
        """See `LoopCaller`; a crash here is that of this process."""
        ffi, answer = _ffi(), self._answer
        text = "\n".join((function, *lines)).encode()
        row = np.ascontiguousarray(numbers, dtype=np.float64).reshape(-1)
        self._lib.vs_loop_call(text, len(text), ffi.from_buffer("double[]", row), len(row), answer)
        said: bytes = ffi.buffer(answer.text, answer.text_size)[:]
        colors: bytes = ffi.buffer(answer.colors, answer.color_count)[:] if len(row) else b""
        return said.decode(errors="replace"), np.frombuffer(colors, dtype=np.uint8)

    def close(self) -> None:
        """See `LoopCaller`; what is loaded stays."""
