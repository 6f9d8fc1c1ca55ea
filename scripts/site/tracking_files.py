"""Writes the reference of the tracker's two files from the schemas that editors use.

`tests/config/test_tracking_schema.py` holds the schemas to what the readers ask for.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator

from vsense.tools.shipped._sentences import SCHEMA, documentation

_XS = "{http://www.w3.org/2001/XMLSchema}"

FILES = {
    "resources.xsd": ("resources.xml", "What there is: picture sources, trackers, cameras."),
    "experiment.xsd": ("experiment.xml", "Which of them a session uses, and what it keeps."),
}

INTRO = """# Tracking files

`vsense camera track`, `serve` and `run --tracking` read two files: `resources.xml` says what there
is in a laboratory, `experiment.xml` what a session uses of it. `vsense camera init` writes both for
the cameras that it finds; [from printed markers to an arena
state](../vsense/vision/tracking/README.md) explains them. This page is made from the schemas that
editors complete with: [`resources.xsd`](../vsense/config/schema/resources.xsd) and
[`experiment.xsd`](../vsense/config/schema/experiment.xsd).
"""


def page() -> str:
    """The whole page."""
    parts = [INTRO]
    for schema, (name, about) in FILES.items():
        root = ET.parse(SCHEMA / schema).getroot()
        types = {str(t.get("name")): t for t in root if t.get("name")}
        parts.append(f"## {name}\n\n{about}\n")
        for element in root.findall(f"{_XS}element"):
            parts += _sections(element, types)
    return "\n".join(parts)


def _sections(element: ET.Element, types: dict[str, ET.Element]) -> Iterator[str]:
    """The section of an element, then those of its children."""
    kind = types.get(str(element.get("type")), element.find(f"{_XS}complexType"))
    said = documentation(element) or ("" if kind is None else documentation(kind))
    lines = [f"### `<{element.get('name')}>`\n", *([said] if said else [])]
    children: list[ET.Element] = []
    attributes: list[ET.Element] = []
    if kind is not None:
        groups = [g for tag in ("sequence", "all") for g in kind.findall(f"{_XS}{tag}")]
        children = [child for group in groups for child in group.findall(f"{_XS}element")]
        attributes = kind.findall(f"{_XS}attribute")
    if children:
        names = ", ".join(f"`<{child.get('name')}>`" for child in children)
        lines.append(f"\nHolds {names}.")
    if attributes:
        lines += ["", "| attribute | what it is | type | default |", "| --- | --- | --- | --- |"]
        lines += [_row(attribute, types) for attribute in attributes]
    yield "\n".join(lines) + "\n"
    for child in children:
        yield from _sections(child, types)


def _row(attribute: ET.Element, types: dict[str, ET.Element]) -> str:
    name, default = attribute.get("name"), attribute.get("default")
    said = documentation(attribute) or ("Its name in both files." if name == "id" else "")
    absent = "required" if attribute.get("use") == "required" else "none"
    shown = f"`{default}`" if default is not None else absent
    return f"| `{name}` | {said.replace('|', '/')} | {_type(attribute, types)} | {shown} |"


def _type(attribute: ET.Element, types: dict[str, ET.Element]) -> str:
    """Type and bounds of an attribute in words."""
    named = str(attribute.get("type") or "")
    simple = types.get(named, attribute.find(f"{_XS}simpleType"))
    if simple is None:
        return _base(named)
    restriction = simple.find(f"{_XS}restriction")
    if restriction is None:
        return "text"
    words = [f"`{e.get('value')}`" for e in restriction.findall(f"{_XS}enumeration")]
    if words:
        return "one of " + ", ".join(words)
    bounds = [restriction.find(f"{_XS}{end}") for end in ("minInclusive", "maxInclusive")]
    ends = [str(bound.get("value")) for bound in bounds if bound is not None]
    base = _base(str(restriction.get("base")))
    return f"{base}, {' to '.join(ends)}" if len(ends) == 2 else base


def _base(name: str) -> str:
    name = name.removeprefix("xs:")
    if name.endswith(("nteger", "Short", "Int")):
        return "whole number"
    return {"decimal": "number", "boolean": "`true` or `false`"}.get(name, "text")
