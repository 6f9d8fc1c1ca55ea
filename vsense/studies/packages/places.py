"""Where a package was unpacked, and what its paths mean there."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError
from vsense.config.experiment import SHIPPED_FOLDER, SUFFIX, shipped
from vsense.modes.sim.job import Setup
from vsense.robots.sources import source_roots
from vsense.studies.packages.scrub import OWN_FOLDERS, PACKAGE, VSENSE, Scrubber

UNTRUSTED = (
    "it would compile and run code of the package: read it, then say --trust if you believe it"
)

_SHIPPED = f"{VSENSE}/experiments/"
_OF_FILES = ("library", "label", "path", "image", "source", "sources", "file", "include", "script")
_FILE = re.compile(r"[/\\@~*?]|\.\.|\.[^\W\d]")
"""In a setting: a path, a pattern, or a name with the suffix of whatever language."""


class Untrusted(VsenseError):
    """Something cannot be made anew without code of a package."""

    def __init__(self) -> None:
        super().__init__(UNTRUSTED)


class PackagePlaces:
    """The folders of a package that is made anew.

    Attributes:
        package: where it was unpacked.
        anew: where what is made anew goes.
        scrubber: replaces these folders by what paths in a package are.
    """

    def __init__(self, package: Path, anew: Path) -> None:
        self.package, self.anew = package, anew
        pairs = [(str(package), PACKAGE), (str(anew), PACKAGE)]
        pairs += [(str(path), name) for name, path in OWN_FOLDERS.items()]
        pairs += [(str(root), VSENSE) for root in source_roots()]
        self.scrubber = Scrubber(pairs)

    def real(self, value: Any) -> Any:
        """Puts real paths in place of a package's, in all that JSON has."""
        if isinstance(value, str):
            for name, path in ((PACKAGE, self.package), *OWN_FOLDERS.items()):
                value = value.replace(f"{name}/", f"{path}/")
            return value
        if isinstance(value, dict):
            return {key: self.real(each) for key, each in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.real(each) for each in value]
        return value

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

    def setup(self, told: Mapping[str, Any], trusted: bool) -> Setup:
        """Reads how a simulated run was set up.

        Raises:
            Untrusted: it names code of the package.
            VsenseError: it is damaged.
        """
        if not trusted and not is_own(told.get("experiment"), told):
            raise Untrusted
        try:
            path = self.experiment_path(told.get("experiment"))
            setup = Setup.read({**self.real(told), "experiment": str(path)})
            if not all(isinstance(text, str) for pair in setup.settings.items() for text in pair):
                raise TypeError("a setting is no text")
        except (KeyError, TypeError, ValueError, AttributeError) as error:
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
    """The file of a shipped experiment, by its name or its path from `VSENSE`; None: it is none."""
    if not isinstance(experiment, str):
        return None
    name = experiment
    if experiment.startswith(_SHIPPED) and experiment.endswith(SUFFIX):
        name = experiment[len(_SHIPPED) : -len(SUFFIX)]
    return SHIPPED_FOLDER / f"{name}{SUFFIX}" if name in shipped() else None


def is_own(experiment: object, told: Mapping[str, Any], text: str | None = None) -> bool:
    """Whether an experiment is one of vsense's own, and nothing that is said of it names a file.

    Whatever makes something of a package anew asks here first, and loads what `experiment_path`
    says: never a path of the package's author.

    Args:
        experiment: the name of a shipped one, or its path from `VSENSE`.
        told: settings and places of code, as setups and recordings have them.
        text: what the package has as the experiment's file, where that is what is read: it has to
            be the shipped one to the last byte. None: nothing of the package's is read.
    """
    path = shipped_file(experiment)
    settings, code = told.get("settings") or {}, told.get("code") or {}
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
