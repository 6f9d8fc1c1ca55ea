"""The sentences of the reference: what each element and attribute means, from beside the reader.

Names of vsense's own are explained in the schema for editors, those of ARGoS in `argos-names.txt`
beside it.
"""

from __future__ import annotations

import inspect
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection
from types import ModuleType

from scripts.site.contents import ROOT
from scripts.site.observing import Asked
from vsense.config.devices import factories, of_argos

SCHEMA = ROOT / "vsense" / "config" / "schema"
DEVICE = "DEVICE"
"""Stands for every device of a controller."""

DEVICES = ("sensors", "actuators")
_XS = "{http://www.w3.org/2001/XMLSchema}"


class Sentences:
    """All sentences, and which of them were asked for."""

    def __init__(self) -> None:
        self._known = {**_of_argos(), **_of_schema()}
        self._used: set[tuple[str, str]] = set()

    def element(self, parent: str, name: str) -> str | None:
        """What an element is; None where nobody says."""
        said = self._first(_places(parent, name), "")
        if said is None and parent in DEVICES and (module := module_of(parent, name)) is not None:
            return (module.__doc__ or "").partition("\n")[0]
        return said

    def attribute(self, parent: str, name: str, key: str) -> str | None:
        """What an attribute of an element is; None where nobody says."""
        return self._first([*_places(parent, name), *([""] if key.startswith("vs:") else [])], key)

    def unused(self) -> set[tuple[str, str]]:
        """Element and attribute of the sentences that nobody has asked for."""
        return {known for known, text in self._known.items() if text} - self._used

    def _first(self, names: Collection[str], key: str) -> str | None:
        for name in names:
            if self._known.get((name, key)):
                self._used.add((name, key))
                return self._known[name, key]
        return None


def _places(parent: str, name: str) -> list[str]:
    """Under which names an element is explained, the closest first."""
    device = parent in DEVICES and not name.startswith("vs:")
    return [f"{parent}/{name}", DEVICE] if device else [f"{parent}/{name}", name, *_also(parent)]


def _also(parent: str) -> list[str]:
    return [DEVICE] if parent in DEVICES else []


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


def _of_argos() -> dict[tuple[str, str], str]:
    """The sentences of `argos-names.txt`, by element and attribute."""
    found: dict[tuple[str, str], str] = {}
    element = ""
    for line in (SCHEMA / "argos-names.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            name, _, sentence = line.strip().removesuffix(":").partition(": ")
            if not line.startswith(" "):
                element, name = name, ""
            assert (element, name) not in found, f"argos-names.txt: {element} {name}: twice"
            found[element, name] = sentence.strip()
    return found


def _of_schema() -> dict[tuple[str, str], str]:
    """The sentences of vsense's own names, likewise; of attributes of any element it is ""."""
    root = ET.parse(SCHEMA / "argos-vsense.xsd").getroot()
    found = {}
    for node in root.findall(f"{_XS}element"):
        name = f"vs:{node.get('name')}"
        found[name, ""] = documentation(node)
        for attribute in node.iter(f"{_XS}attribute"):
            if attribute.get("name"):
                found[name, str(attribute.get("name"))] = documentation(attribute)
    for attribute in root.findall(f"{_XS}attribute"):
        found["", f"vs:{attribute.get('name')}"] = documentation(attribute)
    return found


def documentation(node: ET.Element) -> str:
    """What a schema says of a node, in one line."""
    text = node.findtext(f"{_XS}annotation/{_XS}documentation") or ""
    return re.sub(r"\s+", " ", text).strip()
