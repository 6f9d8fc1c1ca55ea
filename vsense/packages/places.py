"""Where a package was unpacked, and what its paths mean there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vsense.errors import VsenseError
from vsense.files import PACKAGE_FOLDER
from vsense.packages.scrub import PACKAGE, VSENSE, Scrubber
from vsense.robot.programs import source_roots
from vsense.sim.job import Setup

UNTRUSTED = (
    "it would compile and run code of the package: read it, then say --trust if you believe it"
)


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
        self._own = PACKAGE_FOLDER
        pairs = [(str(package), PACKAGE), (str(anew), PACKAGE), (str(self._own), VSENSE)]
        pairs += [(str(root), VSENSE) for root in source_roots()]
        self.scrubber = Scrubber(pairs)

    def real(self, value: Any) -> Any:
        """Puts real paths in place of a package's, in all that JSON has."""
        if isinstance(value, str):
            for name, path in ((PACKAGE, self.package), (VSENSE, self._own)):
                value = value.replace(f"{name}/", f"{path}/")
            return value
        if isinstance(value, dict):
            return {key: self.real(each) for key, each in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.real(each) for each in value]
        return value

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
            setup = Setup.read(self.real(told))
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


def is_own(experiment: object, told: Mapping[str, Any]) -> bool:
    """Whether an experiment is vsense's own, and nothing that is said of it names another file.

    Args:
        experiment: the name of a shipped one, or its path from `VSENSE`.
        told: settings and places of code, as setups and recordings have them.
    """
    if not isinstance(experiment, str):
        return False
    path = experiment.removeprefix(f"{VSENSE}/experiments/").removesuffix(".argos")
    settings, code = told.get("settings") or {}, told.get("code") or {}
    if not isinstance(settings, dict) or not isinstance(code, dict):
        return False
    plain = path.replace("-", "").replace("_", "").isalnum()
    harmless = all(_is_plain(key, value) for key, value in settings.items())
    return plain and harmless and not any(code.values())


def _is_plain(key: object, value: object) -> bool:
    """Whether a setting is a number or a word, and of nothing that is a file."""
    text = str(value)
    named = str(key).rpartition(".")[2] in ("library", "label", "path", "image", "source", "file")
    return not named and not any(sign in text for sign in "/\\@") and ".." not in text
