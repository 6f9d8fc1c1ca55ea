"""Paths and names in a package: what stands in place of people's own, and what that means here.

Accounts, addresses, machines' names and paths stay out of a package. What was made again asks here
where the package's files are, and whether an experiment is one of vsense's own.
"""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from vsense.base.errors import VsenseError
from vsense.base.files import PACKAGE_FOLDER
from vsense.config.experiment import ARGOS_SUFFIX, SHIPPED_FOLDER, shipped
from vsense.modes.sim.job import Setup
from vsense.robots.sources import source_roots

PACKAGE_MARK, VSENSE_MARK = "@package", "@vsense"
"""Where a package is unpacked, and where vsense is: what paths in a package begin with."""

OWN_FOLDERS = {f"{VSENSE_MARK}/experiments": SHIPPED_FOLDER, VSENSE_MARK: PACKAGE_FOLDER}
"""Where what a package calls vsense's own is: the names outlive the layout of the folders."""

ADDRESS = "192.0.2.1"
"""In place of any address: one that RFC 5737 has set aside for documents, so files stay valid."""

_QUAD = re.compile(r"(?<![\w.-])(?:\d{1,3}\.){3}\d{1,3}(?![\w.-]*\d)")
_SIX = re.compile(r"(?<![\w:])(?:[0-9a-fA-F]{1,4}:){3,7}[0-9a-fA-F:]{1,}(?![\w:])")
_AT = re.compile(r"(?<![\w@/])[A-Za-z_][\w.-]{0,127}@[A-Za-z0-9][\w.-]*")
_END = r"(?=$|[/\"'<>\s,:;)\]}&=])"
_SHORTEST = 4
"""A machine's name with fewer letters may be any word."""


class Scrubber:
    """Replaces what nobody else is to know, and counts it by its kind.

    Args:
        moved: paths, and what stands in their place; the longest is looked for first.

    Attributes:
        counts: how often what was replaced, in words.
    """

    def __init__(self, moved: Iterable[tuple[str, str]]) -> None:
        home = str(Path.home())
        pairs = dict(moved)
        if home != "/":
            pairs.setdefault(home, "~")
        longest = sorted(pairs, key=lambda path: (-len(path), path))
        self._moved = {path: pairs[path] for path in longest}
        words = "|".join(map(re.escape, longest))
        self._paths = re.compile(rf"(?<![\w.])(?:{words}){_END}")
        host = socket.gethostname()
        usable = len(host) >= _SHORTEST and host != "localhost"
        self._host = re.compile(rf"\b{re.escape(host)}\b") if usable else None
        self.counts: dict[str, int] = {}

    def paths(self, text: str, beside: str = "") -> str:
        """Puts a package's names in place of paths, relative to its folder `beside`, if any."""

        def moved(match: re.Match[str]) -> str:
            self._count("paths")
            name = self._moved[match[0]]
            prefix = f"{PACKAGE_MARK}/"
            if beside and name.startswith(prefix):
                return os.path.relpath(name.removeprefix(prefix), beside)
            return name

        return self._paths.sub(moved, text)

    def text(self, text: str, beside: str = "") -> str:
        """Replaces all that is to be replaced."""
        text = self.paths(text, beside)
        text = self._sub(_AT, "USER@HOST", text, "accounts")
        text = _QUAD.sub(self._address, text)
        text = self._sub(_SIX, "::", text, "addresses")
        if self._host is not None:
            text = self._sub(self._host, "HOST", text, "names of this machine")
        return text

    def data(self, value: Any) -> Any:
        """The same for all texts in what JSON has."""
        return _with_texts(value, self.text)

    def setup(self, value: Any) -> Any:
        """How an experiment is read: only paths, and those of rosters by their names."""
        return _with_texts(value, self.paths, {"roster": lambda path: Path(path).name})

    def roster(self, text: str) -> str:
        """A roster without where its robots are reached."""
        try:
            tables = tomlkit.parse(text)
            robots = [tables.get("defaults", {}), *tables.get("robot", [])]
            for table in robots:
                if table.pop("host", None) is not None:
                    self._count("addresses of robots")
            return self.text(tomlkit.dumps(tables))
        except (TOMLKitError, AttributeError, TypeError):
            return self.text(text)

    def _address(self, match: re.Match[str]) -> str:
        parts = [int(part) for part in match[0].split(".")]
        if max(parts) > 255 or parts[0] in (0, 127, 255) or match[0] == ADDRESS:
            return match[0]
        self._count("addresses")
        return ADDRESS

    def _sub(self, pattern: re.Pattern[str], into: str, text: str, kind: str) -> str:
        text, count = pattern.subn(into, text)
        self._count(kind, count)
        return text

    def _count(self, kind: str, count: int = 1) -> None:
        if count:
            self.counts[kind] = self.counts.get(kind, 0) + count


def _with_texts(
    value: Any,
    change: Callable[[str], str],
    members: Mapping[str, Callable[[str], str]] | None = None,
) -> Any:
    """What JSON has, with all its texts changed; those of some members once more."""
    if isinstance(value, str):
        return change(value)
    if isinstance(value, (list, tuple)):
        return [_with_texts(item, change, members) for item in value]
    if not isinstance(value, dict):
        return value
    changed = {key: _with_texts(item, change, members) for key, item in value.items()}
    texts = [key for key in members or {} if isinstance(changed.get(key), str)]
    return changed | {key: (members or {})[key](changed[key]) for key in texts}


def folders_of(paths: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Adds to files and their names the folders that hold them, as deep as names say.

    Args:
        paths: a file's name in the package, and where it was.
    """
    folders: dict[str, str] = {}
    for name, path in paths:
        inside, outside = Path(name), Path(path)
        while inside.name and inside.name != PACKAGE_MARK and str(outside) != "/":
            folders.setdefault(str(outside), inside.as_posix())
            if inside.name in ("files", "vsense"):
                break
            inside, outside = inside.parent, outside.parent
    return folders


UNTRUSTED = (
    "it would compile and run code of the package: read it, then say --trust if you believe it"
)

_SHIPPED = f"{VSENSE_MARK}/experiments/"
_OF_FILES = ("library", "label", "path", "image", "source", "sources", "file", "include", "script")
_FILE = re.compile(r"[/\\@~*?]|\.\.|\.[^\W\d]")
"""In a setting: a path, a pattern, or a name with the suffix of whatever language."""


class Untrusted(VsenseError):
    """Something cannot be made again without code of a package."""

    def __init__(self) -> None:
        super().__init__(UNTRUSTED)


class PackagePlaces:
    """The folders of a package that is made again.

    Attributes:
        package: where it was unpacked.
        remade: where what is made again goes.
        scrubber: replaces these folders by what paths in a package are.
    """

    def __init__(self, package: Path, remade: Path) -> None:
        self.package, self.remade = package, remade
        pairs = [(str(package), PACKAGE_MARK), (str(remade), PACKAGE_MARK)]
        pairs += [(str(path), name) for name, path in OWN_FOLDERS.items()]
        pairs += [(str(root), VSENSE_MARK) for root in source_roots()]
        self.scrubber = Scrubber(pairs)

    def real(self, value: Any) -> Any:
        """Puts real paths in place of a package's, in all that JSON has."""
        return _with_texts(value, self._real_text)

    def _real_text(self, text: str) -> str:
        for name, path in ((PACKAGE_MARK, self.package), *OWN_FOLDERS.items()):
            text = text.replace(f"{name}/", f"{path}/")
        return text

    def experiment_path(self, experiment: object) -> Path:
        """The whole path of an experiment's file: the shipped one's, or what the package says.

        Raises:
            VsenseError: it is relative, so it would be whatever the current folder has.
        """
        path = shipped_file(experiment) or Path(str(self.real(experiment)))
        if not path.is_absolute():
            raise VsenseError(f"its experiment is {str(path)!r}, expected a whole path")
        return path

    def public(self, words: object) -> str:
        """Words, such as of an error, with a package's paths."""
        return self.scrubber.paths(str(words))

    def setup(self, values: Mapping[str, Any], trusted: bool) -> Setup:
        """Reads how a simulated run was set up.

        Raises:
            Untrusted: it names code of the package.
            VsenseError: it is damaged.
        """
        if not trusted and not is_own(values.get("experiment"), values):
            raise Untrusted
        try:
            path = self.experiment_path(values.get("experiment"))
            setup = Setup.read({**self.real(values), "experiment": str(path)})
            if not all(isinstance(text, str) for pair in setup.settings.items() for text in pair):
                raise TypeError("a setting is no text")
        except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
            raise VsenseError(f"its set-up is damaged: {error!r}") from None
        self.make_folders(setup.code.includes)
        return setup

    def make_folders(self, includes: Any) -> None:
        """Makes the folders of headers that nothing was used of: they have to be there."""
        for include in includes:
            folder = Path(str(include).rpartition("=")[2])
            if folder.is_relative_to(self.package) and ".." not in folder.parts:
                folder.mkdir(parents=True, exist_ok=True)


def shipped_file(experiment: object) -> Path | None:
    """The file of a shipped experiment, by name or path from `VSENSE_MARK`; None: it is none."""
    if not isinstance(experiment, str):
        return None
    name = experiment
    if experiment.startswith(_SHIPPED) and experiment.endswith(ARGOS_SUFFIX):
        name = experiment[len(_SHIPPED) : -len(ARGOS_SUFFIX)]
    return SHIPPED_FOLDER / f"{name}{ARGOS_SUFFIX}" if name in shipped() else None


def is_own(experiment: object, stated: Mapping[str, Any], text: str | None = None) -> bool:
    """Whether an experiment is one of vsense's own, and nothing that is said of it names a file.

    Whatever makes something of a package again asks here first, and loads what `experiment_path`
    says: never a path of the package's author.

    Args:
        experiment: the name of a shipped one, or its path from `VSENSE_MARK`.
        stated: settings and places of code, as setups and recordings have them.
        text: what the package has as the experiment's file, where that is what is read: it has to
            be the shipped one to the last byte. None: nothing of the package's is read.
    """
    path = shipped_file(experiment)
    settings, code = stated.get("settings") or {}, stated.get("code") or {}
    if path is None or not isinstance(settings, dict) or not isinstance(code, dict):
        return False
    if any(code.values()) or not all(_is_plain(key, value) for key, value in settings.items()):
        return False
    try:
        return text is None or text == path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False


def _is_plain(key: object, value: object) -> bool:
    """Whether a setting is a number or a word, and of nothing that is a file."""
    attribute = re.split(r"[.:]", str(key))[-1]
    return attribute not in _OF_FILES and _FILE.search(str(value)) is None
