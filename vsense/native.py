"""The one door to the compiled library: every other module takes `ffi` and `lib` from here.

Importing it says when the library is missing or older than the C sources beside it.
"""

from __future__ import annotations

import hashlib
import warnings
from pathlib import Path

from vsense.errors import VsenseError

__all__ = ["NativeError", "StaleLibraryWarning", "WireError", "check", "ffi", "lib", "stale_files"]

REBUILD = "python setup.py build_ext --inplace"


class NativeError(VsenseError):
    """The compiled library is not there or cannot be loaded."""


class StaleLibraryWarning(UserWarning):
    """The compiled library is older than its sources."""


class WireError(VsenseError):
    """A call of the C library failed.

    Attributes:
        code: the negative `enum vs_err`.
        name: its name in C, such as `VS_ERR_CHECKSUM`.
    """

    def __init__(self, code: int, what: str = "") -> None:
        text = ffi.string(lib.vs_strerror(code)).decode()
        super().__init__(f"{what}: {text}" if what else text)
        self.code = code
        self.name: str = ffi.string(lib.vs_errname(code)).decode()


try:
    from vsense._native import ffi, lib
except ImportError as error:
    raise NativeError(
        f"the compiled library vsense._native cannot be loaded ({error}); build it with: {REBUILD}"
    ) from error


def check(code: int, what: str = "") -> int:
    """Passes a C function's result on, or raises it.

    Args:
        code: what the function returned: 0 or more is success.
        what: what was being done, for the message.

    Raises:
        WireError: the code is negative.
    """
    if code < 0:
        raise WireError(code, what)
    return code


def stale_files(root: Path) -> list[str]:
    """Names the sources below root if they are not those that the library was built from.

    Args:
        root: the checkout; without `c_src/build_ffi.py` in it there is nothing to compare.

    Returns:
        Nothing if all is well; the missing files; or all files if only their content differs.
    """
    if not (root / "c_src" / "build_ffi.py").is_file():
        return []
    names = ffi.string(lib.vs_built_from()).decode().splitlines()
    missing = [name for name in names if not (root / name).is_file()]
    if missing:
        return missing
    found = hashlib.sha256()
    for name in names:
        found.update(f"{name}\n".encode() + (root / name).read_bytes())
    same = found.hexdigest() == ffi.string(lib.vs_built_hash()).decode()
    return [] if same else names


if stale_files(Path(__file__).resolve().parent.parent):
    warnings.warn(
        f"the compiled library is older than its C sources; rebuild it with: {REBUILD}",
        StaleLibraryWarning,
        stacklevel=2,
    )
