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
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

from vsense.base.errors import UsageError, failing_as, instead
from vsense.base.files import PACKAGE_FOLDER
from vsense.robots import _cache
from vsense.robots._argos_code import (
    CONTROLLER_PARTS,
    FLAGS,
    LOOP_PARTS,
    STANDARD,
    TOGETHER,
    controller_uses,
)
from vsense.robots._cache import cache_directory, known
from vsense.robots.compiling import (
    CFLAGS,
    CXX_LIBRARIES,
    CXXFLAGS,
    HELPERS,
    BuildError,
    Sources,
    native,
    own_cxxflags,
)
from vsense.robots.sources import (
    CXX_SUFFIXES,
    HASH_DIGITS,
    POLICY,
    PROGRAM_SUFFIXES,
    PYTHON,
    ProgramSources,
    folders_digest,
    source_roots,
)

__all__ = ["BuildError", "SourceTree", "cache_directory", "daemon", "known", "shared"]

SHARED_FLAGS = ("-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-Wl,-z,defs")
"""For the shared object that simulations load. What a controller calls its own stays its own; and
no machine fuses two roundings into one, so that a seed gives the same run on all of them."""

RUNTIME_PARTS = (
    *("err", "bytes", "tag", "wire", "table", "shown", "body"),
    *("peer", "clock", "offer", "format", "greeting", "session"),
)
"""What of `c_src/` a robot's controller runtime needs beside `robot/`: the protocol's own files."""

DRIVER_PARTS = (
    "driver", "driver_process", "driver_record", "base_wifi", "wifi_line", "wiggle",
)  # fmt: skip
"""What of `robot/` only a daemon needs whose base can be a driver, or a robot on Wi-Fi."""

SYSTEM_PARTS = (
    "atomics",
    *("base", "base_argos", "base_asercom", "base_boards", "base_config", "base_gctronic"),
    *("base_reset", "base_serial", "base_york", "board_link", "board_process", "calls", "check"),
    "controller_hash",
    *DRIVER_PARTS,
    *("guard", "guard_link", "guard_process", "guard_rights", "key", "main", "memory", "net"),
    *(
        "networks",
        "options",
        "options_help",
        "presets",
        "radio",
        "random",
        "report",
        "restart",
        "settings",
        "signals",
        "talk",
        "trace",
        "uid",
    ),
    *("watchdog", "worker"),
)
"""What of `robot/` only a daemon needs: processes, files, network, and the base."""

SIMULATION_PARTS = ("hosted", "inprocess")
"""What of `robot/` only a simulation needs."""

FAST_PARTS = (
    *("vs_body", "vs_clock", "vs_peer", "vs_session", "vs_tag", "vs_wire"),
    *("epuck_argos", "epuck_bytes", "base", "base_serial"),
    *("guard", "loop", "memory", "policy", "robot", "telling"),
)
"""What a control step runs through, of most instructions. All else is compiled to small code."""

SHIPPED_CONTROLLER = "pollutant"

REMOTE = "remote"
"""The shipped controller of robots that the host drives."""


@dataclass(frozen=True, slots=True)
class SourceTree:
    """The folders `c_src/` and `robot/` as they lie in a checkout or in an installed package."""

    root: Path

    @property
    def prebuilt(self) -> Path:
        """Where an installed package carries its ready-made daemon."""
        return self.root / "bin" / "vsensed"

    @property
    def drivers(self) -> Path:
        """The folder of the shipped drivers, and of the file that one in Python needs."""
        return self.root / "robot" / "drivers"

    def daemon_sources(self) -> list[Path]:
        """All C files of the daemon but its controller, in a fixed order."""
        folders = (sorted((self.root / folder).glob("*.c")) for folder in ("c_src", "robot"))
        return [p for files in folders for p in files if p.stem not in SIMULATION_PARTS]

    def lab_sources(self) -> list[Path]:
        """What daemons of the lab have besides."""
        return sorted((self.root / "robot" / "lab").glob("*.c"))

    def runtime_sources(self) -> list[Path]:
        """The C files of all robots of a simulation but their controller, in a fixed order."""
        protocol = [self.root / "c_src" / f"vs_{part}.c" for part in RUNTIME_PARTS]
        robot = sorted((self.root / "robot").glob("*.c"))
        return [*protocol, *(p for p in robot if p.stem not in SYSTEM_PARTS)]

    def headers(self) -> list[Path]:
        """All headers of the daemon, in a fixed order."""
        return [p for folder in self.includes() for p in sorted(folder.glob("*.h"))]

    def argos_headers(self) -> list[Path]:
        """All headers for ARGoS's code, and their table."""
        return sorted(p for p in (self.root / "robot" / "argos").iterdir() if p.suffix != ".cpp")

    def program(
        self, controller: str | ProgramSources, beside: Path | None = None
    ) -> ProgramSources:
        """Finds a program by the name or path of its one file; see `controller`."""
        if isinstance(controller, ProgramSources):
            return controller
        return ProgramSources((self.controller(controller, beside),))

    def daemon(self, program: ProgramSources, plain: bool = False) -> Sources:
        """What a daemon with this controller is made of; `plain`: see `Sources`."""
        memory = sorted((self.root / "robot").glob("*.cpp"))
        own_cxx, folder = [*memory, *self._argos(program)], _cache_for(program)
        ours, fast = self.daemon_sources(), FAST_PARTS
        made = Sources(ours, program, self.includes(), own_cxx, fast, folder, plain)
        return replace(made, words=HELPERS)

    def runtime(self, program: ProgramSources) -> Sources:
        """What the robots of a simulation with this controller are made of."""
        own_cxx, folder = self._argos(program), _cache_for(program)
        return Sources(self.runtime_sources(), program, self.includes(), own_cxx, cache=folder)

    def loop(self, program: ProgramSources) -> Sources:
        """What the shared object of ARGoS's loop functions is made of."""
        own_cxx, folder = self._argos(program, LOOP_PARTS), _cache_for(program)
        return Sources((), program, self.includes(), own_cxx, cache=folder, what="loop functions")

    def together(self, program: ProgramSources) -> Sources:
        """What robots of a simulation are made of whose loop functions use their controller."""
        parts = list(dict.fromkeys((*CONTROLLER_PARTS, *LOOP_PARTS)))
        return replace(self.runtime(program), own_cxx=self._argos(program, parts), what=TOGETHER)

    def _argos(
        self, program: ProgramSources, parts: Sequence[str] = CONTROLLER_PARTS
    ) -> list[Path]:
        """Our files that code for ARGoS needs."""
        folder = self.root / "robot" / "argos"
        return [folder / f"{part}.cpp" for part in parts] if program.is_argos else []

    def includes(self) -> list[Path]:
        """The folders of the headers."""
        return [self.root / folder for folder in ("c_src", "robot")]

    def resolved(self) -> list[Path]:
        """The same without links in their paths."""
        return [folder.resolve() for folder in self.includes()]

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
        if path.suffix in PROGRAM_SUFFIXES and os.path.isfile(path):
            return path.resolve()
        kinds = [path.suffix] if path.suffix in (PYTHON, POLICY) else (".c", *CXX_SUFFIXES)
        names = (p.name for p in path.parent.glob("*") if p.suffix in kinds)
        beside_it = [str(Path(name).with_name(file)) for file in names] if path.suffix else []
        raise UsageError(
            f"no controller {name!r}: expected the path of a .c, .cpp, .py or .onnx file, or a"
            f" shipped one; {instead(name, [*shipped, *beside_it])}"
        )


def source_tree() -> SourceTree:
    """Finds the C sources: inside the installed package, or in the checkout around it.

    Raises:
        BuildError: neither is there.
    """
    for root in source_roots():
        if os.path.isfile(root / "robot" / "main.c"):
            return SourceTree(root)
    raise BuildError(
        f"the daemon's C sources are missing from {source_roots()[0]}: install vsense again"
    )


@lru_cache(maxsize=1)
def own_sources() -> str:
    """Digest of what vsense runs; the same in a checkout and where it is installed.

    Raises:
        BuildError: the C sources are missing, or a file cannot be read.
    """
    trees: list[tuple[str, Path, tuple[str, ...]]]
    trees = [("vsense", PACKAGE_FOLDER, (".py", ".argos", ".json"))]
    folders = source_tree().resolved()
    trees += [(folder.name, folder, (".c", ".cpp", ".h", ".hpp", ".txt")) for folder in folders]
    digest = hashlib.sha256()
    for name, folder, suffixes in trees:
        for path in sorted(p for p in folder.rglob("*") if p.suffix in suffixes):
            below = path.relative_to(folder)
            # What only the host runs is compiled, and its sources are not installed.
            if below.parts[0] not in ("_sources", "host"):
                with failing_as(BuildError, f"{path}: cannot be read"):
                    own = hashlib.sha256(path.read_bytes()).hexdigest()
                digest.update(f"{name}/{below.as_posix()} {own}\n".encode())
    return digest.hexdigest()[:HASH_DIGITS]


def on_robots(program: ProgramSources) -> ProgramSources:
    """What robots run of it: where it is Python, the controller that the host drives."""
    return source_tree().program(REMOTE) if program.is_hosted else program


def daemon(
    controller: str | ProgramSources = SHIPPED_CONTROLLER, beside: Path | None = None
) -> Path:
    """Gives the host's `vsensed` with this controller, building it where needed.

    Args:
        controller: a program, a shipped controller's name, or the path of a `.c` or `.cpp` file.
        beside: folder that a relative path is taken from (the experiment file's).

    Returns:
        Path of the executable.

    Raises:
        UsageError: no such controller.
        BuildError: no compiler, a source that does not compile, or no cache directory.
    """
    tree = source_tree()
    program = on_robots(tree.program(controller, beside))
    shipped = (tree.controllers()[SHIPPED_CONTROLLER],)
    if program.sources == shipped and os.path.isfile(tree.prebuilt):
        return tree.prebuilt
    target = cache_directory() / _fingerprint(tree, program) / "vsensed"
    return _cache.built(target, partial(compile_daemon, tree, program))


def shared(controller: str | ProgramSources, beside: Path | None = None) -> Path:
    """Gives the shared object of `robot/inprocess.h` with this controller, building it if needed.

    Args:
        controller: a program, a shipped controller's name, or the path of a `.c` or `.cpp` file.
        beside: folder that a relative path is taken from (the experiment file's).

    Returns:
        Path of the shared object.

    Raises:
        UsageError: no such controller.
        BuildError: no compiler, a source that does not compile, or no cache directory.
    """
    tree = source_tree()
    program = tree.program(controller, beside)
    sources = tree.runtime(program)
    target = cache_directory() / _fingerprint(tree, program, sources) / "inprocess.so"
    return _cache.built(target, partial(_link_runtime, sources))


def are_together(controller: ProgramSources, loop: ProgramSources) -> bool:
    """Whether loop functions ask for the objects of a controller that is for ARGoS, too."""
    return controller.is_argos and bool(controller_uses(loop))


def shared_with_loop_functions(controller: ProgramSources, loop: ProgramSources) -> Path:
    """Gives one shared object of both, which is that of `shared` and that of `loop_functions`.

    Raises:
        BuildError: no compiler, a source that does not compile, or no cache directory.
    """
    tree, program = source_tree(), controller.together(loop)
    sources = tree.together(program)
    target = cache_directory() / _fingerprint(tree, program, sources) / "inprocess.so"
    return _cache.built(target, partial(_link_runtime, sources))


def loop_functions(program: ProgramSources) -> Path:
    """Gives the shared object of ARGoS's loop functions, building it where needed.

    Raises:
        BuildError: no compiler, a source that does not compile, or no cache directory.
    """
    tree = source_tree()
    # The label is chosen when they are called.
    program = replace(program, label="")
    sources = tree.loop(program)
    target = cache_directory() / _fingerprint(tree, program, sources) / "loop_functions.so"
    return _cache.built(target, lambda target: sources.link(native(), target, SHARED_FLAGS))


def compile_daemon(tree: SourceTree, program: ProgramSources, target: Path) -> None:
    """Links `vsensed`, whose own files are compiled once for all controllers, into place whole.

    Raises:
        BuildError: the compiler is missing or refuses a source, or the folder cannot be written.
    """
    compiler, sources = native(), tree.daemon(program)
    if target == tree.prebuilt:  # part of a wheel, which names no folder of the machine it is from
        compiler = replace(compiler, debug=())
    else:
        sources = replace(sources, own=[*sources.own, *tree.lab_sources()])
    _cache.with_parts(sources, compiler).link_daemon(compiler, target)


def _link_runtime(sources: Sources, target: Path) -> None:
    compiler = native()
    _cache.with_parts(sources, compiler, SHARED_FLAGS).link(compiler, target, SHARED_FLAGS)


def _cache_for(program: ProgramSources) -> Path | None:
    """Where the compiled files of code for ARGoS stay; other code needs no cache for it."""
    return cache_directory() if program.is_argos else None


def _fingerprint(tree: SourceTree, program: ProgramSources, sources: Sources | None = None) -> str:
    """Hash of the compiler, the flags and every source and header that goes into a build."""
    compiler = native()
    flags = f"{CFLAGS}{SHARED_FLAGS}{CXXFLAGS}{own_cxxflags()}{CXX_LIBRARIES}"
    flags += f"{compiler.cxx}{compiler.debug}"
    flags += "" if sources else folders_digest(tree.includes())  # a daemon tells it
    sources = sources or tree.daemon(program)
    versions = _cache.version(compiler)
    versions += _cache.version(compiler.for_cxx()) if sources.program.is_cxx else ""
    digest = hashlib.sha256(f"{list(compiler.command)}{versions}{flags}".encode())
    argos = tree.argos_headers() if program.is_argos else []
    if program.is_argos:
        digest.update(f"{FLAGS}{STANDARD}{program}".encode())
    if program.is_policy:
        from vsense.robots.policy import c_of  # with NumPy, which setup.py has none of

        digest.update(c_of(program.sources[0]).encode())
    own = [*_cache.dependencies(sources, compiler), *tree.lab_sources()]
    for path in (*sources.own, *sources.own_cxx, *tree.headers(), *argos, *own):
        digest.update(os.fsencode(path.name) + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:24]
