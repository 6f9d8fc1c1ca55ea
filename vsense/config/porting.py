"""What was written for ARGoS itself: C++ libraries and Lua scripts, which run on no robot here.

Where somebody has ported one, the port has its name: `libforaging.so` becomes `foraging.c`, a
shipped controller or a file beside the experiment, and is taken in its place.
"""

from __future__ import annotations

import re
from pathlib import Path

from vsense.build import source_tree

PAGE = "robot/README.md, 'Porting an ARGoS controller'"
"""Where porting is explained."""

STAND_STILL = "stand_still"
"""The shipped controller that drives robots whose own program cannot run here."""

LUA = "lua_controller"
"""Element of a controller that is a Lua script."""

_LIBRARY = re.compile(r"(?:.*/)?(?:lib([^/]+?)(?:\.so|\.dylib)?|([^/]+)(?:\.so|\.dylib))")


def is_built_for_argos(library: str) -> bool:
    """Tells whether a name is that of a compiled C++ library, as ARGoS takes it.

    ARGoS adds the suffix where it is missing, so `build/libforaging` is one, too.
    """
    return _LIBRARY.fullmatch(library) is not None


def ported_controller(library: str, folder: Path) -> str | None:
    """Finds the port of a controller: a shipped one, or a C source beside the experiment file.

    Args:
        library: as ARGoS names it.
        folder: the experiment file's.

    Returns:
        What `library` may be here, None where there is no port.
    """
    stem = _stem(library)
    if stem in source_tree().controllers():
        return stem
    return f"{stem}.c" if (folder / f"{stem}.c").is_file() else None


def ported_loop_functions(library: str, folder: Path) -> Path | None:
    """Finds the port of loop functions: a Python file beside the experiment file."""
    path = folder / f"{_stem(library)}.py"
    return path if path.is_file() else None


def _stem(library: str) -> str:
    match = _LIBRARY.fullmatch(library)
    assert match is not None
    return match[1] or match[2]
