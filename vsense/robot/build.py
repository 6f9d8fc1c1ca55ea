"""Builds the robots' code for this machine from the C sources that come with vsense: the daemon
`vsensed`, and for simulations all robots as one shared object.

A build lands in the user's cache directory under a name made of the hash of everything that
went into it, so a second start finds it and an edited controller is never mistaken for the old
one. An installed vsense carries one daemon ready made, with the shipped controller; a machine
without a compiler can run that.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

from vsense.errors import UsageError
from vsense.robot.compiling import (
    CFLAGS,
    CXX_LIBRARIES,
    CXXFLAGS,
    SUFFIXES,
    BuildError,
    Sources,
    native,
    own_cxxflags,
)

__all__ = ["BuildError", "SourceTree", "cache_directory", "daemon", "shared"]

SHARED_FLAGS = ("-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-Wl,-z,defs")
"""For the shared object that simulations load. What a controller calls its own stays its own; and
no machine fuses two roundings into one, so that a seed gives the same run on all of them."""

RUNTIME_PARTS = (
    *("err", "bytes", "tag", "wire", "table", "shown", "body"),
    *("peer", "clock", "offer", "session"),
)
"""What of `c_src/` a robot's controller runtime needs beside `robot/`: the protocol's own files."""

SYSTEM_PARTS = (
    "atomics",
    *("base", "base_argos", "base_asercom", "base_boards", "base_config", "base_gctronic"),
    *("base_reset", "base_serial", "base_york", "board_link", "board_process", "calls", "check"),
    *("guard", "guard_link", "guard_process", "guard_rights", "key", "main", "memory", "net"),
    "options",
    *("presets", "random", "report", "restart", "settings", "signals", "talk", "trace", "uid"),
    *("watchdog", "worker"),
)
"""What of `robot/` only a daemon needs: processes, files, network, and the base."""

SIMULATION_PART = "inprocess"
"""What of `robot/` only a simulation needs."""

FAST_PARTS = (
    *("vs_body", "vs_bytes", "vs_clock", "vs_peer", "vs_session", "vs_tag", "vs_wire"),
    *("epuck_argos", "epuck_bytes", "base", "base_sensors", "base_serial"),
    *("guard", "loop", "memory", "robot"),
)
"""What a control step runs through, of most instructions. All else is compiled to small code."""

SHIPPED_CONTROLLER = "pollutant"


@dataclass(frozen=True, slots=True)
class SourceTree:
    """The folders `c_src/` and `robot/` as they lie in a checkout or in an installed package."""

    root: Path

    @property
    def prebuilt(self) -> Path:
        """Where an installed package carries its ready-made daemon."""
        return self.root / "bin" / "vsensed"

    def daemon_sources(self) -> list[Path]:
        """All C files of the daemon but its controller, in a fixed order."""
        folders = (sorted((self.root / folder).glob("*.c")) for folder in ("c_src", "robot"))
        return [p for files in folders for p in files if p.stem != SIMULATION_PART]

    def runtime_sources(self) -> list[Path]:
        """The C files of all robots of a simulation but their controller, in a fixed order."""
        protocol = [self.root / "c_src" / f"vs_{part}.c" for part in RUNTIME_PARTS]
        robot = sorted((self.root / "robot").glob("*.c"))
        return [*protocol, *(p for p in robot if p.stem not in SYSTEM_PARTS)]

    def headers(self) -> list[Path]:
        """All headers of the daemon, in a fixed order."""
        return [
            p for folder in ("c_src", "robot") for p in sorted((self.root / folder).glob("*.h"))
        ]

    def daemon(self, controller: Path) -> Sources:
        """What a daemon with this controller is made of."""
        own_cxx = sorted((self.root / "robot").glob("*.cpp"))
        return Sources(self.daemon_sources(), controller, self.includes(), own_cxx, FAST_PARTS)

    def runtime(self, controller: Path) -> Sources:
        """What the robots of a simulation with this controller are made of."""
        return Sources(self.runtime_sources(), controller, self.includes())

    def includes(self) -> list[Path]:
        """The folders of the headers."""
        return [self.root / folder for folder in ("c_src", "robot")]

    def controllers(self) -> dict[str, Path]:
        """The shipped controllers by name."""
        return {p.stem: p for p in sorted((self.root / "robot" / "controllers").glob("*.c"))}

    def controller(self, name: str, beside: Path | None = None) -> Path:
        """Finds a controller's source.

        Args:
            name: a shipped controller's name, or the path of a `.c` or `.cpp` file.
            beside: folder that a relative path is taken from.

        Raises:
            UsageError: there is no such controller.
        """
        shipped = self.controllers()
        if name in shipped:
            return shipped[name]
        path = (beside or Path()) / name
        if path.suffix in SUFFIXES and path.is_file():
            return path.resolve()
        known = ", ".join(shipped)
        raise UsageError(
            f"no controller {name!r}: expected the path of a .c or .cpp file or one of: {known}"
        )


def source_tree() -> SourceTree:
    """Finds the C sources: inside the installed package, or in the checkout around it.

    Raises:
        BuildError: neither is there.
    """
    package = Path(__file__).resolve().parents[1]
    for root in (package / "_sources", package.parent):
        if (root / "robot" / "main.c").is_file():
            return SourceTree(root)
    raise BuildError(f"the daemon's C sources are missing from {package}: install vsense again")


def daemon(controller: str = SHIPPED_CONTROLLER, beside: Path | None = None) -> Path:
    """Gives the host's `vsensed` with this controller, building it where needed.

    Args:
        controller: a shipped controller's name or the path of a `.c` or `.cpp` file.
        beside: folder that a relative path is taken from (the experiment file's).

    Returns:
        Path of the executable.

    Raises:
        UsageError: no such controller.
        BuildError: no compiler, a source that does not compile, or no cache directory.
    """
    tree = source_tree()
    source = tree.controller(controller, beside)
    if controller == SHIPPED_CONTROLLER and tree.prebuilt.is_file():
        return tree.prebuilt
    target = cache_directory() / _fingerprint(tree, source) / "vsensed"
    if not target.is_file():
        compile_daemon(tree, source, target)
    return target


def shared(controller: str, beside: Path | None = None) -> Path:
    """Gives the shared object of `robot/inprocess.h` with this controller, building it if needed.

    Args:
        controller: a shipped controller's name or the path of a `.c` or `.cpp` file.
        beside: folder that a relative path is taken from (the experiment file's).

    Returns:
        Path of the shared object.

    Raises:
        UsageError: no such controller.
        BuildError: no compiler, a source that does not compile, or no cache directory.
    """
    tree = source_tree()
    source = tree.controller(controller, beside)
    target = cache_directory() / _fingerprint(tree, source) / "inprocess.so"
    if not target.is_file():
        tree.runtime(source).link(native(), target, SHARED_FLAGS)
    return target


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


def compile_daemon(tree: SourceTree, controller: Path, target: Path) -> None:
    """Compiles and links `vsensed` in one go and moves it into place whole.

    Raises:
        BuildError: the compiler is missing or refuses a source, or the folder cannot be written.
    """
    tree.daemon(controller).link_daemon(native(), target)


def _fingerprint(tree: SourceTree, controller: Path) -> str:
    """Hash of the compiler, the flags and every source and header that goes into a build."""
    compiler = native()
    flags = f"{CFLAGS}{SHARED_FLAGS}{CXXFLAGS}{own_cxxflags()}{CXX_LIBRARIES}{compiler.cxx}"
    sources = tree.daemon(controller)
    versions = compiler.version() + (compiler.for_cxx().version() if sources.is_cxx else "")
    digest = hashlib.sha256(f"{list(compiler.command)}{versions}{flags}".encode())
    own = sources.dependencies(compiler)
    for path in (*sources.own, *sources.own_cxx, *tree.headers(), *own):
        digest.update(os.fsencode(path.name) + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:24]
