"""Runs C compilers over the robots' sources: this machine's, or one for a robot's processor."""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from vsense.base.errors import VsenseError
from vsense.base.terminal import Console
from vsense.robots import _argos_code, _compiled, finding
from vsense.robots.sources import HASH_DIGITS, ProgramSources, content, folders_digest, headers

SECTIONS = ("-O2", "-ffunction-sections", "-fdata-sections")

DRIVERS = "-DVSENSED_DRIVERS"
"""Daemons with it can have a driver as their base (`robot/driver.c`)."""

HOST_FLAGS = ("-DVSENSED_SLOW_CLOCK", DRIVERS)
"""Of daemons for this machine, whose clock can be slow for a lab; a robot's cannot."""

CFLAGS = ("-std=c99", "-D_POSIX_C_SOURCE=200809L", *SECTIONS, "-ffp-contract=off")
"""No machine fuses two roundings into one: a policy gives the same bits on all of them."""

HELPERS = ("-Dfork=vs_controller_fork",)
"""Of a daemon's controller: a child that it makes must not hold what the daemon has open."""

PLAIN = ("-fno-exceptions", "-fno-rtti")

CXXFLAGS = ("-std=c++17", *SECTIONS, *PLAIN, "-fno-threadsafe-statics")
"""For a controller in C++; the user's own CXXFLAGS come after them. Exceptions and their tables
would more than double the daemon, and nothing on a robot has two threads."""

LIBRARIES = ("-Wl,--gc-sections", "-Wl,--as-needed", "-lm")
"""What only the host uses of the C library is left out. The daemon needs libc alone; a user's
controller may want sines, and only then gets libm."""

CXX_LIBRARIES = ("-Wl,--as-needed", "-lstdc++", *LIBRARIES)

HASH_PART = "controller_hash"
"""The one file of `robot/` that knows the controller's hash: compilers keep the others."""

APT_LINE = "sudo apt install build-essential python3-dev python3-venv"


class BuildError(VsenseError):
    """The robots' code cannot be built here."""


@dataclass(frozen=True, slots=True)
class Toolchain:
    """A C compiler and its flags for a target.

    Attributes:
        command: the words that start it.
        flags: what it is told beside `CFLAGS`, and after them.
        environment: variables that it needs beside the caller's own.
        small: what makes it compile for the same target to smaller and slower code, in place of
            `flags`; empty: nothing does.
        cxx: the words that start the C++ compiler for the same target.
        cxx_line: the line that installs that one.
        debug: what has programs know their lines, for reports of crashes; empty: stripped.
    """

    command: tuple[str, ...]
    flags: tuple[str, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict)
    small: tuple[str, ...] = ()
    cxx: tuple[str, ...] = ("c++",)
    cxx_line: str = APT_LINE
    debug: tuple[str, ...] = ()

    def for_cxx(self) -> Toolchain:
        """The C++ compiler for the same target.

        Raises:
            BuildError: it is not there; the message holds the line that installs one.
        """
        if shutil.which(self.cxx[0]) is None:
            raise BuildError(
                f"no C++ compiler '{self.cxx[0]}' for a controller in C++; install one with:"
                f" {self.cxx_line}"
            )
        return replace(self, command=self.cxx)

    def run(self, arguments: Sequence[str]) -> subprocess.CompletedProcess[str]:
        """Runs it; in a session of its own, since Ctrl-C is for the caller to handle."""
        return subprocess.run(
            [*self.command, *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="surrogateescape",
            start_new_session=True,
            env={**os.environ, **self.environment},
        )

    def version(self) -> str:
        """What it says about itself: a newer one makes other programs of the same source.

        And on which kind of machine: several may share a home, and not run each other's programs.
        """
        machine = " ".join([platform.machine(), *platform.libc_ver()])
        return f"{self.run(['--version']).stdout}{machine}\n"


@dataclass(frozen=True, slots=True)
class Sources:
    """What is compiled together.

    Attributes:
        own: files that come with vsense.
        program: the controller's files.
        includes: folders of headers that come with vsense.
        own_cxx: C++ files that come with vsense, for a controller in C++.
        fast: names, without suffix, of those of `own` that a control step runs through. The others
            become small code, where the toolchain has such.
        cache: folder in which code for ARGoS has its headers and stays when it is compiled; None
            for other code.
        plain: code for ARGoS is compiled without exceptions and types at run time if it uses none.
        what: what the program is, as messages call it.
        words: what the compiler is told of the program beside the flags of all.
    """

    own: Sequence[Path]
    program: ProgramSources
    includes: Sequence[Path]
    own_cxx: Sequence[Path] = ()
    fast: Collection[str] = ()
    cache: Path | None = None
    plain: bool = False
    what: str = "controller"
    words: Sequence[str] = ()

    def link(self, toolchain: Toolchain, target: Path, flags: Sequence[str] = ()) -> None:
        """Compiles and links everything and moves it into place whole.

        Raises:
            BuildError: the compiler refuses a source, or the folder cannot be written.
        """
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            folder = tempfile.TemporaryDirectory(prefix=f"{target.name}.", dir=target.parent)
        except OSError as error:
            raise BuildError(f"cannot build in {target.parent}: {error.strerror}") from error
        with folder as name:
            output = Path(name) / "made"
            self._link(toolchain, output, flags)
            output.chmod(0o755)
            try:
                os.replace(output, target)
            except IsADirectoryError as error:
                raise BuildError(f"cannot write {target}: it is a folder") from error

    def _link(self, toolchain: Toolchain, output: Path, flags: Sequence[str]) -> None:
        """Compiles and links everything: the C in one go, hash, small code and C++ before it."""
        own, for_all = list(self.own), [flag for flag in flags if not flag.startswith("-D")]
        for at, path in enumerate(own):
            if path.stem == HASH_PART:
                own[at] = output.with_name(f"{HASH_PART}.o")
                self.compile(toolchain, path, own[at], flags)
        seldom = [p for p in own if p.stem not in {*self.fast, HASH_PART} and toolchain.small]
        names = [str(path) for path in own if path not in seldom]
        if seldom:
            names.append(f"{output.with_name('small')}.o")
            small = replace(toolchain, flags=toolchain.small)
            self._run(small, CFLAGS, [*for_all, "-c", "-o", names[-1], *map(str, seldom)])
        if self.program.is_cxx:
            names += self._objects(toolchain, output, for_all)
        else:
            names += [self._c_file(toolchain, output, p, for_all) for p in self.program.sources]
        libraries = CXX_LIBRARIES if self.program.is_cxx else LIBRARIES
        if self.program.is_argos and "ziglang" not in toolchain.command:
            # What is defined in headers: in ARGoS's shared libraries the first one counts, too.
            libraries = (*libraries, "-Wl,-z,muldefs")
        strip = () if toolchain.debug else ("-s",)
        self._run(toolchain, CFLAGS, [*for_all, *strip, "-o", str(output), *names, *libraries])

    def _c_file(self, toolchain: Toolchain, out: Path, source: Path, flags: Sequence[str]) -> str:
        """Compiles a program's file in C; BuildError: it is refused, or is no controller."""
        target = out.with_name(f"{out.name}_{source.stem}.o")
        if self.program.is_policy:
            from vsense.robots.policy import write_c  # with NumPy, which setup.py has none of

            source = write_c(source, target.with_suffix(".c"))
        flags = [*toolchain.debug, *self.words, *(f for f in flags if f.startswith("-f"))]
        self.compile(toolchain, source, target, flags)
        if words := _compiled.fault(target, source):
            raise BuildError(words)
        return str(target)

    def _objects(self, toolchain: Toolchain, output: Path, flags: Sequence[str]) -> list[str]:
        """Compiles the program and our C++, as many files at a time as there are processors."""
        self._check_headers()
        flags = [flag for flag in flags if flag.startswith("-f")]  # for code, not for its linker
        compiler = toolchain.for_cxx()
        version, ours = compiler.version(), self._for_all()
        ours += _argos_code.lenient(version) if self.program.is_argos else []

        def compiled(numbered: tuple[int, Path]) -> str:
            number, source = numbered
            target = output.with_name(f"{output.name}_{source.stem}-{number}.o")
            language, after = self._language(source, ours)
            after = [*after, *compiler.debug, *self.words]
            words = [*compiler.command, *compiler.flags, *language, *after, *flags]
            cached = self._cached_path(source, [version, *words])
            if cached is not None and os.path.isfile(cached):
                return str(cached)
            self._run(compiler, language, [*after, *flags, "-c", str(source), "-o", str(target)])
            if source in self.program.sources and self.what == "controller":
                self._check_cxx(target, source)
            return str(target if cached is None else _keep(target, cached))

        from concurrent.futures import ThreadPoolExecutor  # only what is built waits for it

        files = list(enumerate((*self.program.sources, *self.own_cxx)))
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as workers:
            return list(workers.map(compiled, files))

    def _check_cxx(self, target: Path, source: Path) -> None:
        """Says which variables robots share in a simulation, when they are compiled: once."""
        if (words := _compiled.fault(target, source, True)) and not self.program.is_argos:
            raise BuildError(words)
        if names := _compiled.shared_variables(target):
            Console().say(
                f"vsense: {source}: all robots of a simulation share its static variables, and"
                f" real robots do not: {', '.join(names)}"
            )

    def _cached_path(self, source: Path, words: Sequence[str]) -> Path | None:
        """Where a compiled file stays: its name tells all that went into it."""
        if self.cache is None:
            return None
        digest = hashlib.sha256("\0".join([*words, str(source)]).encode())
        ours = sorted(path for folder in self._our_folders() for path in folder.glob("*.h*"))
        for path in (source, *headers([source], self.program.includes), *ours):
            digest.update(content(path))
        return self.cache / "objects" / f"{digest.hexdigest()[:32]}.o"

    def compile(self, toolchain: Toolchain, source: Path, out: Path, flags: Sequence[str]) -> None:
        """Compiles one C file; BuildError: the compiler refuses it."""
        self._run(toolchain, CFLAGS, [*flags, "-c", str(source), "-o", str(out)])

    def link_daemon(self, toolchain: Toolchain, target: Path) -> str:
        """Links a daemon that tells what it was made of; gives its controller's hash.

        Raises:
            BuildError: see `link`; or a header is missing.
        """
        digest = self.controller_hash(toolchain)
        own = f'-DVSENSED_SOURCES="+{folders_digest(self.includes)}"'
        self.link(toolchain, target, [f'-DVSENSED_CONTROLLER_HASH="{digest}"', own])
        return digest

    def controller_hash(self, toolchain: Toolchain) -> str:
        """Hash of the controller's source and of every header that it does not share with all.

        It says which controller runs on a robot: the same file gives the same one on any machine.

        Raises:
            BuildError: a header is missing.
        """
        shared = {folder.resolve() for folder in self.includes}
        own = [p for p in self.dependencies(toolchain) if p.resolve().parent not in shared]
        own = [*(path for path in self.program.sources if path not in own), *own]
        digest = hashlib.sha256(self.program.label.encode())
        for path in own:
            digest.update(os.fsencode(path.name) + b"\0" + path.read_bytes() + b"\0")
        return digest.hexdigest()[:HASH_DIGITS]

    def dependencies(self, toolchain: Toolchain) -> list[Path]:
        """The controller's sources and every header that they include, but for the system's.

        Raises:
            BuildError: the compiler does not find one of them.
        """
        if self.program.is_argos or self.program.is_policy:
            return self.program.own_files()
        asked = ["-MM", "-MT", "it", *map(str, self.program.sources)]
        if self.program.is_cxx:
            rule = self._run(toolchain.for_cxx(), CXXFLAGS, [*own_cxxflags(), *asked])
        else:
            rule = self._run(toolchain, CFLAGS, asked)
        # A rule for make: its lines end in a backslash, and blanks in names have one before them.
        names = re.findall(r"(?:\\[ #]|\S)+", rule.replace("\\\n", " ").removeprefix("it:"))
        return [Path(re.sub(r"\\([ #])", r"\1", name).replace("$$", "$")) for name in names]

    def _our_folders(self) -> list[Path]:
        return [*self.includes, *(folder / "argos" for folder in self.includes)]

    def _check_headers(self) -> None:
        """Raises BuildError where code for ARGoS includes what nobody has."""
        if self.program.is_argos:
            missing = _argos_code.missing_headers(self.program)
            if missing:
                raise BuildError(_argos_code.explain_missing(missing))

    def _for_all(self) -> list[str]:
        """What a C++ compiler is told for every file of code for ARGoS."""
        if self.cache is None:
            return []
        with_runtime = not self.plain or _argos_code.needs_runtime(self.program)
        runtime = ("-fexceptions", "-funwind-tables") if with_runtime else PLAIN
        argos = next(path for path in self._our_folders() if os.path.isfile(path / "headers.txt"))
        try:
            folder = _argos_code.forwarding(argos, self.cache)
        except OSError as error:
            raise BuildError(f"cannot build in {self.cache}: {error.strerror}") from error
        return [*runtime, f"-I{folder}"]

    def _language(self, source: Path, for_all: Sequence[str]) -> tuple[list[str], list[str]]:
        """What a C++ compiler is told for a file before and after its target's flags.

        Args:
            for_all: as `_for_all` gives it.
        """
        program = self.program
        if not program.is_argos:
            return [*CXXFLAGS], own_cxxflags()
        options: list[str] = []
        if source not in self.own_cxx:
            options = [f"-I{folder}" for folder in program.includes]
            options += finding.definitions_of(source)
        elif source.stem == _argos_code.ENTRY:
            label, name = program.label, program.short_name
            options = [f'-DVS_ARGOS_LABEL="{label}"', f'-DVS_ARGOS_NAME="{name}"']
        options += _argos_code.together(source, self.what)
        language = [_argos_code.STANDARD, *SECTIONS, *_argos_code.FLAGS, "-fno-threadsafe-statics"]
        return language, [*for_all, *options, *own_cxxflags()]

    def _run(self, toolchain: Toolchain, language: Sequence[str], arguments: Sequence[str]) -> str:
        """Runs a compiler with our flags and these arguments; gives what it prints.

        Raises:
            BuildError: it refuses a source; the message says which.
        """
        folders = [f"-I{folder}" for folder in self.includes]
        result = toolchain.run([*language, *toolchain.flags, *folders, *arguments])
        if result.returncode != 0:
            flags = [flag for flag in own_cxxflags() if flag in arguments]
            ours = (*self.own, *self.own_cxx)
            raise BuildError(
                _compiled.explained(result.stderr, self.program, ours, self.what, flags)
            )
        return result.stdout


def _keep(output: Path, cached: Path) -> Path:
    """Puts a compiled file into the cache, whole or not at all; it may be another file system.

    Raises:
        BuildError: the cache cannot be written.
    """
    try:
        cached.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="part.", dir=cached.parent) as part:
            copy = shutil.copyfile(output, Path(part) / cached.name)
            os.replace(copy, cached)
    except OSError as error:
        raise BuildError(f"cannot keep {cached}: {error.strerror}") from error
    return cached


def own_cxxflags() -> list[str]:
    """What the user wants a C++ compiler to be told: `$CXXFLAGS`.

    Raises:
        BuildError: a quote in it is not closed.
    """
    return _words("CXXFLAGS")


def _words(variable: str) -> list[str]:
    """The words of an environment variable, of which quotes may hold several, as in a shell."""
    text = os.environ.get(variable, "")
    try:
        return shlex.split(text)
    except ValueError as error:
        raise BuildError(f"{variable}={text}: {str(error).lower()}") from None


def native() -> Toolchain:
    """The compilers for this machine: `$CC` or `cc`, and `$CXX` or `c++`.

    Raises:
        BuildError: it is not there; the message holds the line that installs one.
    """
    command = _words("CC") or ["cc"]
    if shutil.which(command[0]) is None:
        raise BuildError(f"no C compiler '{command[0]}'; install one with: {APT_LINE}")
    cxx = tuple(_words("CXX") or ["c++"])
    return Toolchain(tuple(command), HOST_FLAGS, cxx=cxx, debug=("-g",))
