"""Where builds stay: found by the name of all that went into them, made by one process at a time.

What of a build is the same for every controller is compiled once, each file by a process of its
own: whoever edits a controller waits for that one file.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from vsense.robots.compiling import CFLAGS, HASH_PART, BuildError, Sources, Toolchain
from vsense.robots.sources import content


def cache_directory() -> Path:
    """The folder for builds: `$XDG_CACHE_HOME/vsense`, by default `~/.cache/vsense`.

    Raises:
        BuildError: the user has no home directory.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    if base:
        return Path(base) / "vsense"
    try:
        return Path.home() / ".cache" / "vsense"
    except RuntimeError:
        raise BuildError(
            "no home directory to keep builds in: set XDG_CACHE_HOME to a folder"
        ) from None


def built(target: Path, build: Callable[[Path], None]) -> Path:
    """Gives a build, made where it is missing: by one process, for which the others wait."""
    if not target.is_file():
        with _locked(target.parent):
            if not target.is_file():
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
    if not all(target.is_file() for target in objects.values()):
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

    missing = [source for source, target in objects.items() if not target.is_file()]
    try:
        next(iter(objects.values())).parent.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as workers:
            list(workers.map(compiled, missing))
    except OSError as error:
        raise BuildError(f"cannot build in {cache_directory()}: {error.strerror}") from error
