"""What each name in an experiment file means, in a sentence: for the site and for new experiments.

Names of vsense's own are explained in the schema for editors (`schema/argos-vsense.xsd`), those of
ARGoS in `schema/argos-names.txt` beside it. A test fails where one lacks its sentence.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from functools import cache
from importlib import resources

DEVICE = "DEVICE"
"""Stands for every device of a controller."""

SCHEMA = resources.files("vsense") / "config" / "schema"
_XS = "{http://www.w3.org/2001/XMLSchema}"

Explanations = dict[tuple[str, str], str]
"""Sentences by element, or "parent/element", and attribute; "" for the element itself, and as
element for an attribute of any."""


@cache
def explanations() -> Explanations:
    """All sentences; callers leave them as they are."""
    return {**_of_argos(), **_of_schema()}


def places(parent: str, name: str) -> list[str]:
    """Under which names an element is explained, the closest first."""
    if parent not in ("sensors", "actuators"):
        return [f"{parent}/{name}", name]
    return [f"{parent}/{name}", *([name] if name.startswith("vs:") else []), DEVICE]


def _of_argos() -> Explanations:
    sentences: Explanations = {}
    element = ""
    for line in (SCHEMA / "argos-names.txt").read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            name, _, sentence = line.strip().removesuffix(":").partition(": ")
            if not line.startswith(" "):
                element, name = name, ""
            assert (element, name) not in sentences, f"argos-names.txt: {element} {name}: twice"
            sentences[element, name] = sentence.strip()
    return sentences


def _of_schema() -> Explanations:
    root = ET.fromstring((SCHEMA / "argos-vsense.xsd").read_text(encoding="utf-8"))
    sentences = {}
    for node in root.findall(f"{_XS}element"):
        name = f"vs:{node.get('name')}"
        sentences[name, ""] = documentation(node)
        for attribute in node.iter(f"{_XS}attribute"):
            if attribute.get("name"):
                sentences[name, str(attribute.get("name"))] = documentation(attribute)
    for attribute in root.findall(f"{_XS}attribute"):
        sentences["", f"vs:{attribute.get('name')}"] = documentation(attribute)
    return sentences


def documentation(node: ET.Element) -> str:
    """What a schema says of a node, in one line."""
    text = node.findtext(f"{_XS}annotation/{_XS}documentation") or ""
    return re.sub(r"\s+", " ", text).strip()
