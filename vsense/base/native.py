"""The compiled libraries: every other module takes what it calls from here.

`ffi` and `lib` are what robot and host share; `kernel_ffi` and `kernels` are what only the host
runs: pictures, rays and physics. A struct of one is not a struct of the other. The import fails or
warns when a library is missing or older than the C sources beside it.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import _generator
from numpy.typing import NDArray

from vsense.base.errors import VsenseError

__all__ = [
    "NativeError",
    "StaleLibraryWarning",
    "WireError",
    "check",
    "ffi",
    "kernel_ffi",
    "kernels",
    "lib",
    "pointer",
    "random_in_c",
    "stale_files",
]

REBUILD = "python setup.py build_ext --inplace"


class NativeError(VsenseError):
    """A compiled library is not there or cannot be loaded."""


class StaleLibraryWarning(UserWarning):
    """A compiled library is older than its sources."""


class WireError(VsenseError):
    """A call of the C library failed: the negative `enum vs_err`, and its name in C."""

    def __init__(self, code: int, what: str = "") -> None:
        text = ffi.string(lib.vs_strerror(code)).decode()
        super().__init__(f"{what}: {text}" if what else text)
        self.code = code
        self.name: str = ffi.string(lib.vs_errname(code)).decode()


try:
    from vsense._kernels import ffi as kernel_ffi
    from vsense._kernels import lib as kernels
    from vsense._native import ffi, lib
except ImportError as error:
    raise NativeError(
        f"a compiled library of vsense cannot be loaded ({error}); build it with: {REBUILD}"
    ) from error


def check(code: int, what: str = "") -> int:
    """Gives a C function's result if it is 0 or more; else raises WireError, with `what` failed."""
    if code < 0:
        raise WireError(code, what)
    return code


def pointer(kind: str, array: NDArray[Any]) -> Any:
    """A contiguous array as C's array of that kind, for `kernels`; it keeps the array."""
    return kernel_ffi.from_buffer(f"{kind}[]", array)


def random_in_c(random: np.random.Generator, normal: bool = False) -> Any:
    """The `struct vs_random *` that draws from a generator, `normal` numbers too if need be.

    Generator and structure have to live as long as it is used. Source: NumPy's manual, "Extending
    via CFFI", for the library that has the normal distribution.
    """
    own = random.bit_generator.ctypes
    functions: list[Any] = [own.next_double, None]
    if normal:
        functions[1] = ctypes.CDLL(_generator.__file__).random_standard_normal
    next_double, standard_normal = (
        kernel_ffi.cast("double (*)(void *)", ctypes.cast(function, ctypes.c_void_p).value or 0)
        for function in functions
    )
    state, bits = (kernel_ffi.cast("void *", p.value) for p in (own.state, own.bit_generator))
    return kernel_ffi.new("struct vs_random *", (next_double, state, standard_normal, bits))


def stale_files(root: Path) -> list[str]:
    """Names sources below `root`, the checkout, that the libraries were not built from.

    Gives of each library that differs the missing files, or all of its files if only their content
    differs. Without `c_src/build_ffi.py` there is nothing to compare.
    """
    if not os.path.isfile(root / "c_src" / "build_ffi.py"):
        return []
    return [*_stale(root, ffi, lib), *_stale(root, kernel_ffi, kernels)]


def _stale(root: Path, ffi: Any, lib: Any) -> list[str]:
    """`stale_files` of one library."""
    names: list[str] = ffi.string(lib.vs_built_from()).decode().splitlines()
    missing = [name for name in names if not os.path.isfile(root / name)]
    if missing:
        return missing
    digest = hashlib.sha256()
    for name in names:
        digest.update(f"{name}\n".encode() + (root / name).read_bytes())
    same = digest.hexdigest() == ffi.string(lib.vs_built_hash()).decode()
    return [] if same else names


if stale_files(Path(__file__).resolve().parents[2]):
    warnings.warn(
        f"a compiled library is older than its C sources; rebuild it with: {REBUILD}",
        StaleLibraryWarning,
        stacklevel=2,
    )
