"""Reads from a repository's CMake files which sources make which library.

CMake itself is not needed. Commands are read in the order in which it would run them, with all
branches of conditions: which of two targets of a name counts is said in `Repository`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from vsense.base.errors import VsenseError
from vsense.robots.sources import SOURCE_SUFFIXES

LIST = "CMakeLists.txt"

ARGOSS_OWN = ("argos3core_", "argos3plugin_")
"""What the targets of ARGoS and its plug-ins are called, whose place vsense takes."""

_MAX_DEPTH = 20
"""Of CMake files that name each other."""
_MOST_LETTERS = 8 << 20
_KEYWORDS = {
    *("SHARED", "STATIC", "MODULE", "OBJECT", "EXCLUDE_FROM_ALL", "PUBLIC", "PRIVATE"),
    *("INTERFACE", "BEFORE", "AFTER", "SYSTEM", "WIN32", "MACOSX_BUNDLE"),
}
# What is never closed ends with the text: to fail there would be to look again at each beginning.
_TEXT, _CLOSED = r'"((?:\\.|[^"\\])*)', r'\\?(?:"|\Z)'
_COMMENT = re.compile(rf"({_TEXT}{_CLOSED})|#\[\[.*?(?:\]\]|\Z)|#[^\n]*", re.S)
_COMMAND = re.compile(r"(?<!\w)([A-Za-z_]\w*)\s*\(")
_PART = re.compile(rf'{_TEXT}{_CLOSED}|[()]|[^()"]+', re.S)
_ARGUMENT = re.compile(rf'{_TEXT}{_CLOSED}|([^\s"]+)', re.S)
_VARIABLE = re.compile(r"\$\{([\w.-]+)\}")


@dataclass(slots=True)
class CMakeTarget:
    """A library or program: its sources that are there, and what it is linked with."""

    sources: list[Path] = field(default_factory=list)
    links: list[str] = field(default_factory=list)
    is_program: bool = False


@dataclass(slots=True)
class Repository:
    """What the CMake files below a folder say.

    Of two targets of one name the first library counts; a program only where there is no library.

    Attributes:
        targets: by name.
        includes: folders of headers, each once.
        definitions: what a compiler is told, "-DNAME=VALUE"; what only CMake knows is empty.
    """

    root: Path
    targets: dict[str, CMakeTarget] = field(default_factory=dict)
    includes: list[Path] = field(default_factory=list)
    definitions: list[str] = field(default_factory=list)

    def sources(self, name: str) -> list[Path]:
        """The sources of a target and of all targets here that it is linked with, but ARGoS's."""
        paths: dict[Path, None] = {}
        waiting, seen = [name], set[int]()
        while waiting:
            linked = waiting.pop(0)
            target = None if linked.startswith(ARGOSS_OWN) else self.targets.get(linked)
            if target is None or id(target) in seen:
                continue
            seen.add(id(target))
            paths.update(dict.fromkeys(target.sources))
            waiting += target.links
        return list(paths)


def read(root: Path, lists: Sequence[Path]) -> Repository:
    """Reads a repository; `lists` are all its CMakeLists.txt."""
    reader = _Reader(Repository(root))
    for path in sorted(lists, key=lambda path: (len(path.parts), path)):
        reader.read(path, path.parent, {})
    return reader.repository


class _Reader:
    """Runs commands; each file once."""

    def __init__(self, repository: Repository) -> None:
        self.repository = repository
        self._done: set[Path] = set()
        self._depth = 0

    def read(self, path: Path, folder: Path, scope: dict[str, str]) -> None:
        """Reads a file; its relative paths are taken from `folder`."""
        if path in self._done or self._depth >= _MAX_DEPTH or not os.path.isfile(path):
            return
        self._done.add(path)
        self._depth += 1
        root = str(self.repository.root)
        scope |= {
            "CMAKE_SOURCE_DIR": root,
            "PROJECT_SOURCE_DIR": root,
            "ARGOS_BUILD_FOR": "simulator",
        }
        scope |= {
            "CMAKE_CURRENT_SOURCE_DIR": str(folder),
            "CMAKE_CURRENT_LIST_DIR": str(path.parent),
        }
        for command, words in _commands(path, scope):
            self._run(command, words, folder, scope)
        self._depth -= 1

    def _run(self, command: str, words: list[str], folder: Path, scope: dict[str, str]) -> None:
        if command == "set" and words:
            scope[words[0]] = ";".join(w for w in words[1:] if w not in ("PARENT_SCOPE", "CACHE"))
        elif command == "list" and words[:1] == ["APPEND"] and len(words) > 1:
            scope[words[1]] = ";".join(filter(None, [scope.get(words[1], ""), *words[2:]]))
        elif command == "file" and words[:1] in (["GLOB"], ["GLOB_RECURSE"]) and len(words) > 1:
            scope[words[1]] = ";".join(map(str, _glob(folder, words[2:], words[0] != "GLOB")))
        elif command == "add_subdirectory" and words:
            below = folder / words[0]
            self.read(below / LIST, below, dict(scope))
        elif command == "include" and words:
            self.read(folder / words[0], folder, scope)
        elif command in ("add_library", "add_executable") and words:
            self._add(words[0], words[1:], folder, command == "add_executable")
        elif command == "target_sources" and words and words[0] in self.repository.targets:
            self.repository.targets[words[0]].sources += _files(folder, words[1:])
        elif command == "target_link_libraries" and words and words[0] in self.repository.targets:
            self.repository.targets[words[0]].links += words[1:]
        elif command in ("include_directories", "target_include_directories"):
            self._include(folder, words[command.startswith("target") :])
        elif command in ("add_definitions", "add_compile_definitions"):
            named = words if command == "add_definitions" else [f"-D{word}" for word in words]
            plain = (word.replace('\\"', '"') for word in named if "$<" not in word)
            self.repository.definitions += [word for word in plain if word.startswith("-D")]

    def _add(self, name: str, words: list[str], folder: Path, is_program: bool) -> None:
        there = self.repository.targets.get(name)
        if there is None or (there.is_program and not is_program):
            files = _files(folder, words)
            self.repository.targets[name] = CMakeTarget(files, [], is_program)

    def _include(self, folder: Path, words: list[str]) -> None:
        for word in words:
            path = (folder / word).resolve()
            if (
                word not in _KEYWORDS
                and os.path.isdir(path)
                and path not in self.repository.includes
            ):
                self.repository.includes.append(path)


def _commands(path: Path, scope: dict[str, str]) -> Iterator[tuple[str, list[str]]]:
    """The commands of a file with their words; variables have the value of that moment."""
    text = path.read_text(encoding="utf-8", errors="replace")
    plain = _COMMENT.sub(lambda match: match[1] or "", text)
    at = letters = 0
    while match := _COMMAND.search(plain, at):
        at, depth = match.end(), 1
        while depth and (part := _PART.match(plain, at)):
            at, depth = part.end(), depth + {"(": 1, ")": -1}.get(part[0], 0)
        if depth:
            return
        words: list[str] = []
        for quoted, bare in _ARGUMENT.findall(plain, match.end(), at - 1):
            word = _expanded(quoted or bare, scope)
            letters += len(word)
            if letters > _MOST_LETTERS:
                raise VsenseError(
                    f"{path}: its variables unfold to more than {_MOST_LETTERS >> 20} MB"
                )
            words += filter(None, word.split(";"))
        yield match[1].lower(), words


def _expanded(word: str, scope: dict[str, str]) -> str:
    for _ in range(_MAX_DEPTH):
        if "${" not in word or len(word) > _MOST_LETTERS:
            break
        word = _VARIABLE.sub(lambda match: scope.get(match[1], ""), word, 16)
    return word


def _files(folder: Path, words: Sequence[str]) -> list[Path]:
    paths = [(folder / word).resolve() for word in words if word.endswith(SOURCE_SUFFIXES)]
    return [path for path in paths if os.path.isfile(path)]


def _glob(folder: Path, patterns: Sequence[str], deep: bool) -> list[Path]:
    paths: list[Path] = []
    for pattern in patterns:
        start, name = (folder / pattern).parent, Path(pattern).name
        if pattern not in ("RELATIVE", "CONFIGURE_DEPENDS") and os.path.isdir(start):
            paths += sorted(start.rglob(name) if deep else start.glob(name))
    return paths
