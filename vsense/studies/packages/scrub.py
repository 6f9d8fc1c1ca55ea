"""Leaves out of a package who and where: accounts, addresses and names of machines, paths."""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from vsense.base.files import PACKAGE_FOLDER
from vsense.config.experiment import SHIPPED_FOLDER

PACKAGE, VSENSE = "@package", "@vsense"
"""Where a package is unpacked, and where vsense is: what paths in a package begin with."""

OWN_FOLDERS = {f"{VSENSE}/experiments": SHIPPED_FOLDER, VSENSE: PACKAGE_FOLDER}
"""Where what a package calls vsense's own is: the names outlive the layout of the folders."""

ADDRESS = "192.0.2.1"
"""In place of any address: one that RFC 5737 has set aside for documents, so files stay valid."""

_QUAD = re.compile(r"(?<![\w.-])(?:\d{1,3}\.){3}\d{1,3}(?![\w.-]*\d)")
_SIX = re.compile(r"(?<![\w:])(?:[0-9a-fA-F]{1,4}:){3,7}[0-9a-fA-F:]{1,}(?![\w:])")
_AT = re.compile(r"(?<![\w@/])[A-Za-z_][\w.-]*@[A-Za-z0-9][\w.-]*")
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
            prefix = f"{PACKAGE}/"
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
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, dict):
            return {key: self.data(each) for key, each in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.data(each) for each in value]
        return value

    def setup(self, value: Any) -> Any:
        """How an experiment is read: only paths, and those of rosters by their names."""
        if isinstance(value, str):
            return self.paths(value)
        if isinstance(value, dict):
            found = {key: self.setup(each) for key, each in value.items()}
            if isinstance(found.get("roster"), str):
                found["roster"] = Path(found["roster"]).name
            return found
        if isinstance(value, (list, tuple)):
            return [self.setup(each) for each in value]
        return value

    def roster(self, text: str) -> str:
        """A roster without where its robots are reached."""
        try:
            told = tomlkit.parse(text)
            tables = [told.get("defaults", {}), *told.get("robot", [])]
            for table in tables:
                if table.pop("host", None) is not None:
                    self._count("addresses of robots")
            return self.text(tomlkit.dumps(told))
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


def folders_of(paths: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Adds to files and their names the folders that hold them, as deep as names say.

    Args:
        paths: a file's name in the package, and where it was.
    """
    found: dict[str, str] = {}
    for name, path in paths:
        inside, outside = Path(name), Path(path)
        while inside.name and inside.name != PACKAGE and str(outside) != "/":
            found.setdefault(str(outside), inside.as_posix())
            if inside.name in ("files", "vsense"):
                break
            inside, outside = inside.parent, outside.parent
    return found
