"""Where builds stay: found by the name of all that went into them, made by one process at a time.

What of a build is the same for every controller is compiled once, each file by a process of its
own: whoever edits a controller waits for that one file.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import platform
import re
import shutil
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from vsense.base.files import cache_folder, replace_bytes
from vsense.robots.compiling import CFLAGS, HASH_PART, BuildError, Sources, Toolchain
from vsense.robots.sources import content

_COMPILER = re.compile(r"(?:\w+-)*(?:gcc|g\+\+|clang|clang\+\+)(?:-[\d.]+)?")
"""A compiler's own name: what else is called so may be a script that calls any."""
_SEARCHED = ("CXXFLAGS", "CPATH", "C_INCLUDE_PATH", "CPLUS_INCLUDE_PATH")
"""Variables that may say where compilers look for headers."""
_MOMENT_NS = 2_000_000_000


def cache_directory() -> Path:
    """The folder for builds: `$XDG_CACHE_HOME/vsense`, by default `~/.cache/vsense`.

    Raises:
        BuildError: the user has no home directory.
    """
    folder = cache_folder()
    if folder is None:
        raise BuildError("no home directory to keep builds in: set XDG_CACHE_HOME to a folder")
    return folder


def built(target: Path, build: Callable[[Path], None]) -> Path:
    """Gives a build, made where it is missing: by one process, for which the others wait."""
    if not os.path.isfile(target):
        with _locked(target.parent):
            if not os.path.isfile(target):
                build(target)
    return target


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Holds a folder's lock against all processes; goes without where its file system has none."""
    with ExitStack() as stack:
        with suppress(OSError):  # the build says what cannot be written
            folder.mkdir(parents=True, exist_ok=True)
            fcntl.flock(stack.enter_context((folder / "lock").open("w")), fcntl.LOCK_EX)
        yield


def known(question: Sequence[str], ask: Callable[[], list[str]], of: Collection[Path]) -> list[str]:
    """Gives what `ask` answered to a question before, or asks.

    The answer holds as long as the files and folders `of`, and those that it names, are as they
    were: when they were changed, and how large they are. Answers that name none begin with a blank.
    """
    digest = hashlib.sha256("\0".join(question).encode(errors="surrogateescape")).hexdigest()
    record = cache_directory() / "known" / digest[:24]
    with suppress(OSError, ValueError):  # nothing is known
        answer, stamps = json.loads(record.read_bytes())
        if stamps == _stamps(answer, of):
            return list(answer)
    answer = ask()
    with suppress(OSError):  # it is asked again
        stamps = _stamps(answer, of)
        # Who changes a file twice in a moment may not change its time.
        if all(changed_ns < time.time_ns() - _MOMENT_NS for changed_ns, _ in stamps):
            record.parent.mkdir(parents=True, exist_ok=True)
            replace_bytes(record, json.dumps([answer, stamps]).encode())
    return answer


def _stamps(answer: Sequence[str], of: Collection[Path]) -> list[list[int]]:
    named = [Path(name) for name in answer if not name.startswith(" ")]
    found = [path.stat() for path in (*of, *named, *(path.parent for path in named))]
    return [[stat.st_mtime_ns, stat.st_size] for stat in found]


def version(toolchain: Toolchain) -> str:
    """Its `version`; a compiler that is called directly is asked once."""
    place = Path(shutil.which(toolchain.command[0]) or "").resolve()
    if len(toolchain.command) > 1 or not _COMPILER.fullmatch(place.name):
        return toolchain.version()
    question = ["version", *os.uname(), platform.machine(), *toolchain.command, str(place)]
    return known(question, lambda: [f" {toolchain.version()}"], [place])[0][1:]


def dependencies(sources: Sources, toolchain: Toolchain) -> list[Path]:
    """Its `dependencies`; asked for each time where the user names other folders of headers.

    Those of code for ARGoS are found without a compiler.
    """
    compilers = toolchain.command, toolchain.cxx
    named = any(map(os.environ.get, _SEARCHED)) or any(len(words) > 1 for words in compilers)
    if sources.program.is_argos or named:
        return sources.dependencies(toolchain)
    words = [*toolchain.command, *toolchain.flags, *toolchain.cxx, os.getcwd()]
    words += map(str, (*sources.program.sources, *sources.includes))
    ask = lambda: [str(path) for path in sources.dependencies(toolchain)]  # noqa: E731
    found = known(["dependencies", version(toolchain), *words], ask, sources.includes)
    return [Path(name) for name in found]


def with_parts(sources: Sources, toolchain: Toolchain, flags: Sequence[str] = ()) -> Sources:
    """Gives the same program with what all controllers share compiled already.

    Args:
        flags: with which it will be linked.

    Raises:
        BuildError: the compiler refuses a source, or the cache cannot be written.
    """
    words = [*toolchain.command, *CFLAGS, *toolchain.flags, *flags]
    digest = hashlib.sha256("\0".join([toolchain.version(), *words]).encode())
    headers = [path for folder in sources.includes for path in sorted(folder.glob("*.h"))]
    shared = [path for path in sources.own if path.stem != HASH_PART]
    for path in (*shared, *headers):
        digest.update(os.fsencode(path.name) + b"\0" + content(path) + b"\0")
    folder = cache_directory() / "parts" / digest.hexdigest()[:24]
    objects = {path: folder / f"{path.parent.name}-{path.stem}.o" for path in shared}
    if not all(os.path.isfile(target) for target in objects.values()):
        with _locked(folder):
            _compile(sources, toolchain, flags, objects)
    return replace(sources, own=[objects.get(path, path) for path in sources.own])


def _compile(
    sources: Sources,
    toolchain: Toolchain,
    flags: Sequence[str],
    objects: dict[Path, Path],
) -> None:
    """Compiles what is missing, as many files at a time as there are processors."""
    flags = [flag for flag in flags if flag.startswith("-f")]  # for code, not for its linker

    def compiled(source: Path) -> None:
        part = objects[source].with_suffix(".part")
        sources.compile(toolchain, source, part, flags)
        os.replace(part, objects[source])

    from concurrent.futures import ThreadPoolExecutor  # only what is built waits for it

    missing = [source for source, target in objects.items() if not os.path.isfile(target)]
    try:
        next(iter(objects.values())).parent.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as workers:
            list(workers.map(compiled, missing))
    except OSError as error:
        raise BuildError(f"cannot build in {cache_directory()}: {error.strerror}") from error
