"""What drives a robot, as source code: its files, folders of headers, and which class of ARGoS's.

A program is one C or C++ file that defines `vs_controller` (robot/controller.h), or any number of
C++ files for ARGoS, in which REGISTER_CONTROLLER names a class and its label; or a file in Python,
or a learnt policy.
"""

from __future__ import annotations

import glob
import hashlib
import os
import re
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from vsense.base.errors import UsageError, instead
from vsense.base.files import PACKAGE_FOLDER

ARGOS = "argos3/"
"""What names of ARGoS's headers begin with."""

CONTROLLER = "REGISTER_CONTROLLER"
LOOP_FUNCTIONS = "REGISTER_LOOP_FUNCTIONS"

CXX_SUFFIXES, PYTHON, LUA, POLICY = (".cpp", ".cc", ".cxx"), ".py", ".lua", ".onnx"
HOSTED = (PYTHON, LUA)
"""Suffixes of files that the host runs as they are; of a learnt policy a build makes C."""
PROGRAM_SUFFIXES = (".c", *CXX_SUFFIXES, PYTHON, POLICY)
"""Of a controller's file, in the order in which they are looked for."""

MAX_NAME_BYTES = 31
"""[byte] of a controller's name. Source: c_src/vs_table.h."""

_OTHERS = (
    CONTROLLER,
    LOOP_FUNCTIONS,
    "REGISTER_QTOPENGL_USER_FUNCTIONS",
    "REGISTER_USER_FUNCTIONS",
)
_MAIN = re.compile(rb"^\s*int\s+main\s*\(", re.M)
_INCLUDE = re.compile(rb'^[ \t]*#[ \t]*include[ \t]*([<"])([^>"\n]+)[>"]', re.M)


HASH_DIGITS = 12
"""Of a digest of sources so many are told: enough to tell any two apart."""

_OWN_SUFFIXES = (".c", ".h", ".cpp")

COMMIT = "commit"
"""The file in an installed package's sources that names the commit it was built from."""

_GIT_TIMEOUT_S = 5.0


def source_roots() -> tuple[Path, ...]:
    """Where vsense's own C sources may be: inside the installed package, or in the checkout."""
    return PACKAGE_FOLDER / "_sources", PACKAGE_FOLDER.parent


@lru_cache(maxsize=1)
def commit() -> str:
    """Gives the commit of the checkout or of the installed package, "" if it is not known.

    A checkout with changes has a "+" behind it.
    """
    installed, checkout = source_roots()
    if os.path.isfile(installed / COMMIT):
        return (installed / COMMIT).read_text().strip()
    return of_checkout(checkout) if os.path.exists(checkout / ".git") else ""


def of_checkout(root: Path) -> str:
    """Asks Git for the commit of a checkout; "" where it does not answer."""
    try:
        result = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--exclude=*", "--dirty=+"],
            capture_output=True,
            text=True,
            check=True,
            timeout=_GIT_TIMEOUT_S,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return result.stdout.strip()


@lru_cache(maxsize=1)
def known_headers() -> Mapping[str, str]:
    """Our headers' names in `robot/argos/` by what ARGoS's users include."""
    tables = (root / "robot" / "argos" / "headers.txt" for root in source_roots())
    table = next((path for path in tables if os.path.isfile(path)), None)
    lines = [] if table is None else table.read_text(encoding="utf-8").splitlines()
    pairs = (line.split() for line in lines if line and not line.startswith("#"))
    return {ARGOS + theirs: ours for theirs, ours in pairs}


@dataclass(frozen=True, slots=True)
class ProgramSources:
    """Sources that are compiled together.

    Attributes:
        sources: absolute paths; the first is the one that errors name.
        includes: folders of headers, absolute.
        label: which class of those that ARGoS's sources register; "": the only one.
    """

    sources: tuple[Path, ...]
    includes: tuple[Path, ...] = ()
    label: str = ""

    @property
    def is_argos(self) -> bool:
        """Whether it is written for ARGoS."""
        return any(registers(p, m) for p in self.sources for m in (CONTROLLER, LOOP_FUNCTIONS))

    def label_error(self, label: str) -> str:
        """What is wrong where classes of controllers are registered and none of that label, which
        ARGoS refuses, too; "": nothing."""
        names = labels(self.sources, CONTROLLER)
        plain = len(names) == sum(registrations(path, CONTROLLER) for path in self.sources)
        if not names or not plain or label in names:
            return ""
        where = ", ".join(path.name for path in self.sources if registers(path, CONTROLLER))
        return f"no REGISTER_CONTROLLER in {where} names {label!r}; {instead(label, names)}"

    @property
    def is_cxx(self) -> bool:
        """Whether it is C++."""
        return any(path.suffix in CXX_SUFFIXES for path in self.sources)

    @property
    def is_hosted(self) -> bool:
        """Whether it is a file in Python or Lua, which the host runs."""
        return self.sources[0].suffix in HOSTED

    @property
    def is_lua(self) -> bool:
        """Whether it is a script for ARGoS."""
        return self.sources[0].suffix == LUA

    @property
    def is_policy(self) -> bool:
        """Whether it is a learnt policy."""
        return self.sources[0].suffix == POLICY

    @property
    def name(self) -> str:
        """How people call it."""
        return self.label or self.sources[0].stem

    @property
    def short_name(self) -> str:
        """The same as a robot tells it, where it is written for ARGoS, or learnt."""
        return self.name.encode()[:MAX_NAME_BYTES].decode(errors="ignore")

    def together(self, other: ProgramSources) -> ProgramSources:
        """All files of both; the label is its own."""
        sources = dict.fromkeys((*self.sources, *other.sources))
        includes = dict.fromkeys((*self.includes, *other.includes))
        return ProgramSources(tuple(sources), tuple(includes), self.label)

    def own_files(self) -> list[Path]:
        """Its sources and all headers of its own."""
        used = headers(self.sources, self.includes)
        return [*self.sources, *(path for path in used if path not in self.sources)]


@dataclass(frozen=True, slots=True)
class CodeOptions:
    """Where users' code lies, as the command line says: `--sources` and `--include`.

    Attributes:
        sources: patterns of files by what they make: a library's name without `lib` and suffix, or
            a controller's label or id.
        includes: folders of headers; "PREFIX=FOLDER": what is included as PREFIX/... is in FOLDER.
    """

    sources: Mapping[str, Sequence[str]] = field(default_factory=dict)
    includes: Sequence[str] = ()

    @classmethod
    def of(cls, sources: Iterable[str], includes: Iterable[str]) -> CodeOptions:
        """Reads "NAME=PATTERN[,PATTERN...]" and folders.

        Raises:
            UsageError: an option has another form.
        """
        named: dict[str, list[str]] = {}
        for option in sources:
            name, equals, patterns = option.partition("=")
            if not name or not equals or not patterns:
                raise UsageError(f"--sources {option}: expected NAME=FILE[,FILE...]")
            named.setdefault(stem_of(name), []).extend(filter(None, patterns.split(",")))
        return cls(named, tuple(includes))

    def absolute(self, folder: Path) -> CodeOptions:
        """The same from wherever it is read; relative paths begin in `folder`."""

        def resolved(path: str) -> str:
            return str(folder / os.path.expanduser(path))

        sources = {name: [resolved(path) for path in paths] for name, paths in self.sources.items()}
        parts = [include.rpartition("=") for include in self.includes]
        return CodeOptions(
            sources, tuple(f"{name}{equals}{resolved(at)}" for name, equals, at in parts)
        )

    def patterns(self, *names: str) -> Sequence[str]:
        """What is said of something that has these names; empty: nothing."""
        for name in names:
            if name in self.sources:
                return self.sources[name]
        return ()


_LIBRARY = re.compile(r"(?:.*/)?(?:lib)?([^/]+?)(?:\.so|\.dylib)?")


def stem_of(library: str) -> str:
    """The name of a library without folder, `lib` and suffix."""
    match = _LIBRARY.fullmatch(library)
    return library if match is None else match[1]


def files(patterns: Iterable[str], folder: Path) -> list[Path]:
    """The sources that patterns mean, relative ones in `folder`; a folder means all in it.

    Raises:
        UsageError: a pattern means none.
    """
    paths: dict[Path, None] = {}
    for pattern in patterns:
        path = folder / os.path.expanduser(pattern)
        names = (
            [str(p) for p in path.iterdir()]
            if os.path.isdir(path)
            else [str(path)]
            if os.path.isfile(path)
            else glob.glob(str(path), recursive=True)
        )
        here = [Path(name).resolve() for name in sorted(names) if name.endswith(SOURCE_SUFFIXES)]
        if not here:
            raise UsageError(f"{pattern}: no C or C++ file, looked for in {folder}")
        paths.update(dict.fromkeys(here))
    return list(paths)


def folders(includes: Iterable[str], folder: Path, cache: Path) -> list[Path]:
    """The folders of headers that `CodeOptions.includes` means, relative ones in `folder`.

    For a prefix a folder with a link is made in `cache`.

    Raises:
        UsageError: there is no such folder.
    """
    paths = []
    for include in includes:
        prefix, equals, name = include.rpartition("=")
        path = (folder / os.path.expanduser(name)).resolve()
        if not os.path.isdir(path):
            raise UsageError(f"--include {include}: {path} is no folder")
        paths.append(_linked(prefix, path, cache) if equals else path)
    return paths


def _linked(prefix: str, path: Path, cache: Path) -> Path:
    """A folder in which `prefix` leads to a path."""
    parts = [part for part in prefix.split("/") if part not in ("", ".", "..")]
    digest = hashlib.sha256(f"{parts}\0{path}".encode()).hexdigest()[:16]
    root = cache / f"include-{digest}"
    link = root.joinpath(*parts)
    if not link.is_symlink():
        link.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):  # another process was faster
            link.symlink_to(path)
    return root


def folders_digest(folders: Iterable[Path]) -> str:
    """Digest of the sources in the folders of vsense's own, which daemons tell with their version:
    the same sources give the same one on any machine.
    """
    digest = hashlib.sha256()
    for path in (p for f in folders for p in sorted(f.iterdir()) if p.suffix in _OWN_SUFFIXES):
        digest.update(os.fsencode(path.name) + b"\0" + content(path) + b"\0")
    return digest.hexdigest()[:HASH_DIGITS]


def content(path: Path) -> bytes:
    """A source's bytes; none where it cannot be read, or is no text."""
    if path.suffix == POLICY:
        return b""
    try:
        return _content(path, path.stat().st_mtime_ns)
    except OSError:
        return b""


@lru_cache(maxsize=4096)
def _content(path: Path, time_ns: int) -> bytes:
    return path.read_bytes()


def registers(path: Path, macro: str) -> bool:
    """Whether a source uses one of ARGoS's macros; what is in comments of one line does not."""
    return registrations(path, macro) > 0


def registrations(path: Path, macro: str) -> int:
    """How often a source uses one of ARGoS's macros; see `registers`."""
    return len(re.findall(rb"^[ \t]*" + macro.encode() + rb"\s*\(", content(path), re.M))


def labels(sources: Iterable[Path], macro: str) -> list[str]:
    """The labels that sources register, as far as they are plain texts."""
    pattern = re.compile(macro.encode() + rb'\s*\([^;{"]*"([^"\n]*)"')
    matches = [label for path in sources for label in pattern.findall(content(path))]
    return [label.decode(errors="replace") for label in matches]


def belongs(path: Path, macro: str) -> bool:
    """Whether a source may be part of a program for `macro`: not of another one alone."""
    for_another = any(registers(path, other) for other in _OTHERS if other != macro)
    return (registers(path, macro) or not for_another) and _MAIN.search(content(path)) is None


def included(path: Path) -> list[tuple[str, bool]]:
    """What a file includes: name, and whether it is in quotes; conditions are not looked at."""
    return [
        (name.decode(errors="replace"), mark == b'"')
        for mark, name in _INCLUDE.findall(content(path))
    ]


def headers(sources: Sequence[Path], includes: Sequence[Path]) -> dict[Path, None]:
    """All files that sources include, directly or not, as far as they are in `includes` or beside
    the file that includes them, and vsense has none of that name; in the order of the search."""
    paths: dict[Path, None] = {}
    waiting = list(sources)
    while waiting:
        path = waiting.pop()
        for name, is_quoted in included(path):
            if name in known_headers():
                continue
            for folder in ([path.parent] if is_quoted else []) + list(includes):
                candidate = folder / name
                if os.path.isfile(candidate):
                    candidate = candidate.resolve()
                    if candidate not in paths:
                        paths[candidate] = None
                        waiting.append(candidate)
                    break
    return paths


def with_sources_of_headers(
    sources: Sequence[Path], includes: Sequence[Path], macro: str = CONTROLLER
) -> list[Path]:
    """Adds, for each header that is included, the source beside it of the same name.

    So a library that another repository builds comes along with the folder of its headers.
    """
    paths = dict.fromkeys(sources)
    while True:
        used = headers(list(paths), includes)
        more = [
            source
            for header in used
            for source in (header.with_suffix(suffix) for suffix in SOURCE_SUFFIXES)
            if source not in paths
            and source not in used
            and os.path.isfile(source)
            and belongs(source, macro)
        ]
        if not more:
            return list(paths)
        paths.update(dict.fromkeys(more))


ARGOS_PAGE = "vsense/config/ARGOS.md"
"""What users read about it."""


SOURCE_SUFFIXES = (".cpp", ".cc", ".cxx", ".c")
