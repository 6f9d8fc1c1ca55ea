"""The sentences of the reference: what each element and attribute means, and which are asked for.

Where they come from: `vsense/tools/shipped/_sentences.py`.
"""

from __future__ import annotations

import inspect
from collections.abc import Collection
from types import ModuleType

from scripts.site.observing import Asked
from vsense.config.devices import factories, of_argos
from vsense.tools.shipped._sentences import explanations, places

DEVICES = ("sensors", "actuators")


class Sentences:
    """All sentences, and which of them were asked for."""

    def __init__(self) -> None:
        self._explanations = explanations()
        self._used: set[tuple[str, str]] = set()

    def element(self, parent: str, name: str) -> str | None:
        """What an element is; None where nobody says."""
        said = self._first(places(parent, name), "")
        if said is None and parent in DEVICES and (module := module_of(parent, name)) is not None:
            return (module.__doc__ or "").partition("\n")[0]
        return said

    def attribute(self, parent: str, name: str, key: str) -> str | None:
        """What an attribute of an element is; None where nobody says."""
        return self._first([*places(parent, name), *([""] if key.startswith("vs:") else [])], key)

    def unused(self) -> set[tuple[str, str]]:
        """Element and attribute of the sentences that nobody has asked for."""
        return {key for key, text in self._explanations.items() if text} - self._used

    def _first(self, names: Collection[str], key: str) -> str | None:
        for name in names:
            if self._explanations.get((name, key)):
                self._used.add((name, key))
                return self._explanations[name, key]
        return None


def module_of(section: str, name: str) -> ModuleType | None:
    """The module of the virtual device that an element asks for; None: nobody makes it virtual."""
    if name in factories(section):
        return inspect.getmodule(factories(section)[name])
    return of_argos(section).get(name)


def missing(asked: Asked, sentences: Sentences) -> list[str]:
    """What the reader asks for and no sentence explains."""
    found = []
    for (parent, name), element in asked.items():
        if not sentences.element(parent, name):
            found.append(f"<{parent}>: <{name}>")
        for key in element.attributes:
            if not sentences.attribute(parent, name, key):
                found.append(f"<{parent}>: <{name}> {key}")
    return sorted(found)
