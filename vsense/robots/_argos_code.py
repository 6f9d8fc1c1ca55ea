"""What ARGoS's controllers and loop functions are compiled with: headers, sources, flags.

`robot/argos/headers.txt` says which of our headers stands for which one of ARGoS's. From it a
folder of headers of one line each is made in the cache.
"""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path

from vsense.robots.sources import (
    ARGOS,
    ARGOS_PAGE,
    ProgramSources,
    content,
    included,
    known_headers,
)

STANDARD = "-std=gnu++17"
"""As CMake has it, with GNU's extensions; ARGoS's users write C++11 to C++17."""

_REMOVED = (
    "AUTO_PTR",
    "BINDERS",
    "RANDOM_SHUFFLE",
    "UNARY_BINARY_FUNCTION",
    "UNEXPECTED_FUNCTIONS",
)

FLAGS = (
    "-DVSENSE",
    *(f"-D_LIBCPP_ENABLE_CXX17_REMOVED_{name}" for name in _REMOVED),
    "-D_GLIBCXX_USE_DEPRECATED=1",
)
"""Besides the standard: users may ask who compiles, and what C++17 took away from the library is
there."""

CONTROLLER_PARTS = (
    *("base", "configuration", "random"),
    *("controller", "rings", "devices", "neighbours", "pipuck", "virtual_sensors"),
)
"""What of `robot/argos/` a controller needs."""

LOOP_PARTS = ("base", "configuration", "random", "entities", "robots", "loop_functions")
"""What of `robot/argos/` loop functions need."""

TOGETHER = "controller with its loop functions"
"""What messages call a program of both, in which loop functions reach controllers."""

ENTRY = "controller"
"""Which of these makes the program's class a controller of the daemon."""

_WORDS = re.compile(
    rb"""//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'"""
    rb"""|\b(try|catch|throw|dynamic_cast|typeid)\b""",
    re.S,
)
"""Comments, texts, and what needs exceptions or types at run time."""

_GET_CONTROLLER = re.compile(
    rb"""//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|\b(GetController)\s*\(\s*\)""", re.S
)
"""Comments, texts, and where loop functions ask for the object of a controller."""


_SHOWN_USES = 3

_PLUGINS = "argos3/plugins/"


def together(source: Path, what: str) -> list[str]:
    """What those of our files are told that are another code in such a program."""
    is_other = what == TOGETHER and source.stem in ("controller", "entities", "loop_functions")
    return ["-DVS_ARGOS_TOGETHER"] if is_other else []


def lenient(version: str) -> list[str]:
    """What has a function return anything that ends without the value that it owes.

    With GCC, which calls itself so in its `version`, it otherwise runs on into whatever code
    follows, but not in a build without optimisation: published controllers have such functions.
    """
    is_gcc = "Free Software Foundation" in version
    return ["-fsanitize=unreachable", "-fsanitize-undefined-trap-on-error"] if is_gcc else []


def forwarding(argos: Path, cache: Path) -> Path:
    """Gives the folder that is searched for ARGoS's headers, made in `cache` where needed.

    Args:
        argos: our headers' folder, `robot/argos`.
    """
    table = (argos / "headers.txt").read_text(encoding="utf-8")
    digest = hashlib.sha256(f"{argos}\0{table}".encode()).hexdigest()[:16]
    folder = cache / f"argos-{digest}"
    if os.path.isdir(folder):
        return folder
    cache.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f"{folder.name}.", dir=cache) as making:
        tree = Path(making) / "whole"
        for theirs, ours in known_headers().items():
            header = tree / theirs
            header.parent.mkdir(parents=True, exist_ok=True)
            header.write_text(f'#include "{argos / ours}"\n', encoding="utf-8")
        try:
            tree.rename(folder)
        except OSError:
            if not os.path.isdir(folder):  # another process was faster: its folder is the same
                raise
    return folder


def missing_headers(program: ProgramSources) -> list[tuple[Path, int, str]]:
    """What of ARGoS's headers a program includes and nobody has: file, line, header."""
    missing = []
    for path in program.own_files():
        for name, _ in included(path):
            if not name.startswith(ARGOS) or name in known_headers():
                continue
            if not any(os.path.isfile(folder / name) for folder in program.includes):
                missing.append((path, _line(path, name), name))
    return missing


def explain_missing(missing: Sequence[tuple[Path, int, str]]) -> str:
    """What a user can do about missing headers."""
    lines = [
        f"{path}:{line}: <{name}>{', part of a plug-in' * name.startswith(_PLUGINS)}"
        for path, line, name in missing
    ]
    words = (
        "vsense has none of these headers of ARGoS. One of a library of your own, or of another"
        " repository's, is found with --include PREFIX=FOLDER (such as"
        " --include argos3/demiurge/epuck-dao=../demiurge-epuck-dao/src);"
        f" {ARGOS_PAGE} says what there is"
    )
    return "\n".join([words, *lines])


def needs_runtime(program: ProgramSources) -> bool:
    """Whether a program uses exceptions, or types at run time: `try`, `catch`, `throw`,
    `dynamic_cast` or `typeid` in a source or header of its own, outside of comments and texts."""
    return any(match[1] for path in program.own_files() for match in _WORDS.finditer(content(path)))


def controller_uses(program: ProgramSources) -> list[tuple[Path, int]]:
    """Where loop functions ask for the object of a controller: files and lines."""
    return [
        (path, _line_at(path, use.start()))
        for path in program.own_files()
        for use in _GET_CONTROLLER.finditer(content(path))
        if use[1]
    ]


def explain_controllers(program: ProgramSources) -> str:
    """What a user can do whose loop functions use a controller's class; "": they do not."""
    places = [f"{path}:{line}: GetController()" for path, line in controller_uses(program)]
    if not places:
        return ""
    if len(places) > _SHOWN_USES:
        places[_SHOWN_USES:] = [f"and in {len(places) - _SHOWN_USES} lines more"]
    words = (
        "they use the class of a controller, which they reach in `vsense sim` only, where one"
        " <..._controller> in C++ drives all robots: elsewhere it runs on robots. Have the"
        " controller show what is wanted of it with its LEDs, which loop functions see"
        " (GetLEDEquippedEntity()); lines for ARGoS"
        f" alone go between #ifndef VSENSE and #endif; see {ARGOS_PAGE}"
    )
    return "\n".join([words, *places])


def explain_simulator(program: ProgramSources) -> str:
    """What a user can do whose controller uses the simulator; "": it includes nothing of it."""
    places = [
        f"{path}:{_line(path, name)}: <{name}>"
        for path in program.own_files()
        for name, _ in included(path)
        if name.startswith(ARGOS) and "/simulator/" in name
    ]
    if not places:
        return ""
    words = (
        "it uses ARGoS's simulator, which is out of a controller's reach here: it runs on robots,"
        " too. Count control steps for the time; lines for ARGoS alone go between #ifndef VSENSE"
        f" and #endif; see {ARGOS_PAGE}"
    )
    return "\n".join([words, *places])


def _line(path: Path, name: str) -> int:
    return _line_at(path, content(path).find(name.encode()))


def _line_at(path: Path, place: int) -> int:
    return content(path).count(b"\n", 0, place) + 1
