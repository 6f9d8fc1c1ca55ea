"""Finds the sources of a library that an experiment file names, as repositories for ARGoS have it.

In this order: the CMake target of the library's name; files that are called like the library,
beside the experiment and in folders called `controllers`; the only file of the repository that
registers the label. A repository is looked through from its topmost CMakeLists.txt, or from its
`.git`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from vsense.robots import _cmake
from vsense.robots.sources import (
    CONTROLLER,
    SOURCE_SUFFIXES,
    ProgramSources,
    belongs,
    content,
    files,
    labels,
    registers,
    stem_of,
    with_sources_of_headers,
)

_MAX_UP = 5
"""Folders above the experiment in which a repository may begin."""
_MAX_FILES = 20_000
"""Of a repository that is looked through: what is larger is none of a few controllers."""
_SKIPPED = {"build", "node_modules", "__pycache__", "CMakeFiles", "runs"}
_PLACES = ("", "controllers", "src", "src/controllers", "../controllers", "../src/controllers")
"""Where files called like the library may lie, from the experiment's folder."""


def find(
    library: str, label: str, folder: Path, extra: Sequence[Path] = (), macro: str = CONTROLLER
) -> ProgramSources | None:
    """Finds a library's program.

    Args:
        library: as the file names it; "" if it names none.
        label: of the class that is wanted.
        folder: the experiment file's.
        extra: folders of headers besides those of the repository.
        macro: what registers the class.

    Returns:
        The program, with the sources of what it includes; None: there is none here.
    """
    name = stem_of(library) if library else ""
    for root in _roots(library, folder):
        repository = repository_at(root)
        sources = _sources(repository, name, label, folder, macro)
        if sources:
            return complete(sources, label, repository, extra, macro)
    return None


def find_in(
    root: Path, library: str, label: str, extra: Sequence[Path] = (), macro: str = CONTROLLER
) -> ProgramSources | None:
    """Finds a library's program in the repository that begins at `root`; see `find`."""
    repository = repository_at(root.resolve())
    name = stem_of(library) if library else ""
    sources = _sources(repository, name, label, root.resolve(), macro)
    return complete(sources, label, repository, extra, macro) if sources else None


def named(
    patterns: Sequence[str],
    folder: Path,
    library: str,
    label: str,
    extra: Sequence[Path] = (),
    macro: str = CONTROLLER,
) -> ProgramSources | None:
    """Makes a program of the files that patterns mean, or of the repository that one means.

    Args:
        patterns: of files, relative ones in `folder`; empty: nothing is named.

    Raises:
        UsageError: a pattern means no file.
    """
    if not patterns:
        return None
    if len(patterns) == 1 and os.path.isdir(folder / patterns[0]):
        program = find_in(folder / patterns[0], library, label, extra, macro)
        if program is not None:
            return program
    sources = files(patterns, folder)
    if not any(registers(path, macro) for path in sources):
        return ProgramSources(tuple(sources), tuple(extra))
    return complete(sources, label, repository_of(sources[0]), extra, macro)


def repository_of(source: Path) -> _cmake.Repository | None:
    """The repository that a source is part of; None: nothing says where it begins."""
    root = root_of(source.parent)
    return None if root is None or root == source.parent else repository_at(root)


def definitions_of(source: Path) -> list[str]:
    """What a compiler is told of names for a source, by its repository's CMake files."""
    repository = repository_of(source)
    return [] if repository is None else repository.definitions


def complete(
    sources: Sequence[Path],
    label: str,
    repository: _cmake.Repository | None,
    extra: Sequence[Path] = (),
    macro: str = CONTROLLER,
) -> ProgramSources:
    """Makes a program of sources: with the folders of its headers, and what these bring along."""
    includes = dict.fromkeys(extra)
    if repository is not None:
        includes.update(dict.fromkeys(repository.includes))
        beside = [repository.root, repository.root / "src"]
        includes.update(dict.fromkeys(path for path in beside if os.path.isdir(path)))
    includes.update(dict.fromkeys(path.parent for path in sources))
    chosen = [path for path in sources if belongs(path, macro)] or list(sources)
    # The file that registers the label comes first: errors are about it.
    chosen.sort(key=lambda path: not _has(path, label, macro))
    every = with_sources_of_headers(chosen, list(includes), macro)
    names = [label] if label else labels(every, macro)
    return ProgramSources(tuple(every), tuple(includes), names[0] if len(names) == 1 else "")


def _sources(
    repository: _cmake.Repository, name: str, label: str, folder: Path, macro: str
) -> list[Path]:
    target = repository.targets.get(name) or repository.targets.get(f"lib{name}")
    if name and target is not None:
        sources = repository.sources(name if name in repository.targets else f"lib{name}")
        if any(registers(path, macro) for path in sources):
            return sources
    if name:
        for place in _PLACES:
            sources = _beside((folder / place).resolve(), name, macro)
            if sources:
                return sources
    return _registering(repository, label, macro)


def _beside(folder: Path, name: str, macro: str) -> list[Path]:
    """Files called like the library, or all in a folder of its name."""
    alone = [folder / f"{name}{suffix}" for suffix in SOURCE_SUFFIXES]
    within = folder / name
    several = sorted(within.iterdir()) if os.path.isdir(within) else []
    for candidates in (alone, [path for path in several if path.suffix in SOURCE_SUFFIXES]):
        there = [path.resolve() for path in candidates if os.path.isfile(path)]
        if any(registers(path, macro) for path in there):
            return there
    return []


def _registering(repository: _cmake.Repository, label: str, macro: str) -> list[Path]:
    """The target of the only file that registers the label, or that file alone."""
    paths = [path for path in _files(repository.root) if _has(path, label, macro)]
    if len(paths) != 1:
        return []
    for name, target in repository.targets.items():
        if paths[0] in target.sources and not target.is_program:
            return repository.sources(name)
    return paths


def _has(path: Path, label: str, macro: str) -> bool:
    if not label:
        return registers(path, macro)
    pattern = macro.encode() + rb'\s*\([^;{]*"' + re.escape(label.encode()) + rb'"'
    return registers(path, macro) and re.search(pattern, content(path)) is not None


def _roots(library: str, folder: Path) -> list[Path]:
    """Where repositories begin: the experiment's, and the one that the library's path leads to."""
    places = [folder.resolve()]
    path = (folder / os.path.expanduser(library)).resolve() if "/" in library else None
    if path is not None:
        places += [next((p for p in path.parents if os.path.isdir(p)), folder)]
    return list(dict.fromkeys(root for place in places if (root := root_of(place)) is not None))


def root_of(place: Path) -> Path | None:
    """The topmost folder of a repository; the place itself where nothing says which."""
    root = place
    for path in (place, *list(place.parents)[:_MAX_UP]):
        if path in (Path.home(), Path(path.anchor)):
            break
        if os.path.exists(path / ".git"):
            return path
        if os.path.isfile(path / _cmake.LIST):
            root = path
    return None if root in (Path.home(), Path(root.anchor)) else root


@lru_cache(maxsize=16)
def repository_at(root: Path) -> _cmake.Repository:
    """What the CMake files of the repository say that begins at `root`."""
    return _cmake.read(root, [path for path in _files(root) if path.name == _cmake.LIST])


@lru_cache(maxsize=16)
def _files(root: Path) -> tuple[Path, ...]:
    paths: list[Path] = []
    seen = 0
    for folder, below, names in os.walk(root):
        below[:] = sorted(n for n in below if n not in _SKIPPED and not n.startswith("."))
        paths += [Path(folder, n) for n in names if n.endswith(SOURCE_SUFFIXES) or n == _cmake.LIST]
        seen += len(names)
        if seen > _MAX_FILES:
            break
    return tuple(sorted(paths))
