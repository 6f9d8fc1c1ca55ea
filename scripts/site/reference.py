"""Writes the reference of experiment files: all elements and attributes that are read."""

from __future__ import annotations

import re

from scripts.site.observing import CONTROLLER, Asked, AskedAttribute, AskedElement, observed
from scripts.site.sentences import DEVICES, Sentences, missing, module_of
from vsense.config import argos

PAGE = "reference/experiment.md"
DEVICES_PAGE = "reference/devices.md"

CHAPTERS = {
    "The file": ("", "argos-configuration"),
    "The run": ("framework",),
    "Programs and loop functions": ("controllers", CONTROLLER, "loop_functions"),
    "The arena": ("arena", "box", "cylinder", "leds", "e-puck", "vs:object"),
    "Drawn places": ("distribute", "entity"),
    "Cameras, engines, media": ("vs:rig", "physics_engines", "media"),
}
"""Each chapter's elements are those within these parents, beside what has a chapter of its own."""

HEADS = {
    "The run": ("framework",),
    "Programs and loop functions": ("controllers", "loop_functions"),
    "The arena": ("arena",),
    "Cameras, engines, media": ("vs:rig", "physics_engines", "media"),
}
"""Elements of the outermost one that open a chapter."""

INTRO = """# Experiment files

Every element and attribute of an `.argos` file that vsense reads. The page is made from what the
reader asks for while it reads files that use everything, so it has all names, with the types,
bounds and defaults of the code.

The format is ARGoS's; names that begin with `vs:` are vsense's own and need
`xmlns:vs="urn:vsense:1"` in the first element. `vsense sim FILE --dry` says what a file holds, and
refuses a misspelt name with its line. `--set ELEMENT.attribute=VALUE` sets any attribute without
editing. Lengths are in m, angles in degrees, counter-clockwise; *required* is what has no default.
An editor completes and explains `vs:` names with the schema
[`argos-vsense.xsd`](../vsense/config/schema/argos-vsense.xsd). What ARGoS has beside these is
[passed over with a warning](../vsense/config/ARGOS.md).
"""

DEVICE_INTRO = """## Devices

Each element in `<sensors>` or `<actuators>` is one device of the robots that a controller drives.
What their numbers mean: [sensors and actuators](devices.md).

### Quality settings

Every virtual device takes them: what a perfect one's numbers become on their way. How they act on
each other, and in which unit they count: [quality](devices.md#quality-settings).
"""


def page() -> str:
    """The whole page.

    Raises:
        ValueError: no sentence says what an element or attribute is, or one explains what nobody
            reads.
    """
    asked, sentences = observed(), Sentences()
    lacking = missing(asked, sentences)
    if lacking:
        raise ValueError(
            "no sentence in argos-names.txt or argos-vsense.xsd: " + "; ".join(lacking)
        )
    if unused := sentences.unused():
        raise ValueError(f"sentences for what nobody reads: {sorted(unused)}")
    parts = [INTRO]
    for chapter, parents in CHAPTERS.items():
        parts.append(f"## {chapter}\n")
        for place in _of_chapter(asked, chapter, parents):
            parts.append(_section(place, asked, sentences))
    parts += [DEVICE_INTRO, _quality(asked, sentences), *_devices(asked, sentences), _not_served()]
    return "\n".join(parts)


def _of_chapter(asked: Asked, chapter: str, parents: tuple[str, ...]) -> list[tuple[str, str]]:
    heads = HEADS.get(chapter, ())
    root = "argos-configuration"
    found = [(root, name) for name in heads]
    opened = {name for names in HEADS.values() for name in names}
    seen = {name for _, name in found}
    for parent in parents:
        for place in sorted(p for p in asked if p[0] == parent):
            if place[1] not in opened and place[1] not in seen:
                found.append(place)
                seen.add(place[1])
    return found


def _section(place: tuple[str, str], asked: Asked, sentences: Sentences) -> str:
    (parent, name), element = place, asked[place]
    lines = [f"### `<{name}>`\n", str(sentences.element(parent, name))]
    alike = sorted(p for p, n in asked if n == name and p and _is_same(asked, (p, n), element))
    lines.append(f"\nIn {', '.join(map(_within, alike))}." if parent else "")
    if children := _children(element, name):
        lines.append(f"\nHolds {children}.")
    if element.attributes:
        lines += ["\n" + _table(place, element.attributes, sentences)]
    if example := _example(element):
        lines.append(f"\n```xml\n{example}\n```")
    return "\n".join(line for line in lines if line) + "\n"


def _is_same(asked: Asked, place: tuple[str, str], element: AskedElement) -> bool:
    """Whether an element has the attributes of another one of its name."""
    return asked[place].attributes.keys() == element.attributes.keys()


def _within(parent: str) -> str:
    if parent == CONTROLLER:
        return "a controller's element"
    return "`<arena>` or `<entity>`" if parent == "arena" else f"`<{parent}>`"


def _children(element: AskedElement, name: str) -> str:
    """What an element may hold, without what is passed over."""
    if name in DEVICES:
        return "[devices](#devices)"
    if name == "controllers":
        return "an element of any name for each controller"
    known = sorted(element.children - argos.ENTITIES.keys() - {*argos.PHYSICS_ENGINES})
    known = [child for child in known if child not in argos.OTHER_MEDIA]
    return ", ".join(f"`<{child}>`" for child in known)


def _table(
    place: tuple[str, str], attributes: dict[str, AskedAttribute], sentences: Sentences
) -> str:
    rows = ["| attribute | what it is | type | default |", "| --- | --- | --- | --- |"]
    for key in sorted(attributes, key=lambda key: (key.startswith("vs:"), key != "id", key)):
        asked = attributes[key]
        said = sentences.attribute(*place, key)
        rows.append(f"| `{key}` | {said} | {asked.kind or 'any'} | {_default(asked)} |")
    return "\n".join(rows)


def _default(attribute: AskedAttribute) -> str:
    if attribute.default is not None:
        return f"`{attribute.default}`"
    return "required" if attribute.required and not attribute.optional else "none"


def _example(element: AskedElement) -> str:
    """The start tag with most attributes, in lines that fit the page."""
    tags = [tag for tag in element.examples if "=" in tag]
    if not tags:
        return ""
    words = re.findall(r'<\S+|[\w:.-]+="[^"]*"|/>', max(sorted(set(tags)), key=len))
    lines = [words[0]]
    for word in words[1:]:
        if len(lines[-1]) + len(word) > 80:
            lines.append("   ")
        lines[-1] += f" {word}"
    return "\n".join(lines)


QUALITY_KEYS = (
    "noise_level", "noise_std_dev", "vs:bias", "vs:drift", "vs:low", "vs:high", "vs:bits",
    "vs:latency", "vs:drop_out", "vs:update_every", "vs:update",
)  # fmt: skip
"""Attributes of every virtual device, in the order in which they act."""

COMMON_KEYS = (
    "implementation", "medium", "show_rays", "vs:virtual", "real_experiment", "sensor_model_file",
    "calibrated", "low_level_config",
)  # fmt: skip
"""Attributes that many devices take and that say nothing of their own."""


def _quality(asked: Asked, sentences: Sentences) -> str:
    """The table of the settings that all devices have."""
    place = ("sensors", "virtual_ground_sensor")
    keys = asked[place].attributes
    quality = {key: keys[key] for key in QUALITY_KEYS}
    rows = _table(place, quality, sentences)
    others = {key: AskedAttribute(optional=True) for key in COMMON_KEYS}
    for element in asked.values():
        others.update({k: a for k, a in element.attributes.items() if k in others and a.kind})
    common = _table(("sensors", "epuck_ground"), others, sentences)
    head = "\n### Attributes of all devices\n\nARGoS's, IRIDIA's, and who serves the device.\n"
    return f"{rows}\n{head}\n{common}\n"


def _devices(asked: Asked, sentences: Sentences) -> list[str]:
    """A section for each device, with the attributes that are its own."""
    parts = []
    for kind in DEVICES:
        parts.append(f"### {kind.capitalize()}\n")
        for place in sorted(p for p in asked if p[0] == kind):
            parts.append(_device(place, asked[place], sentences))
    return parts


def _device(place: tuple[str, str], element: AskedElement, sentences: Sentences) -> str:
    kind, name = place
    module = module_of(kind, name)
    said = str(sentences.element(kind, name))
    if module is not None:
        link = module.__name__.rsplit(".", 1)[1].replace("_", "-")
        said = f"[{said.rstrip('.')}](devices.md#{kind[:-1]}-{link})."
    own = {k: a for k, a in element.attributes.items() if k not in (*QUALITY_KEYS, *COMMON_KEYS)}
    if module is not None and name not in getattr(module, "ELEMENTS", ()):
        # Attributes of robots' own devices are asked of all, virtual or not.
        own = {k: a for k, a in own.items() if a.kind}
    lines = [f"#### `<{name}>`{' (actuator)' if kind == 'actuators' else ''}\n", said]
    lines += [f"\n{_table(place, own, sentences)}"] if own else []
    if (example := _example(element)) and own:
        lines.append(f"\n```xml\n{example}\n```")
    return "\n".join(lines) + "\n"


def _not_served() -> str:
    """What is known and not done."""
    rows = ["## Known, and not done\n", "| in | element | instead |", "| --- | --- | --- |"]
    for name, instead in sorted(argos.ENTITIES.items()):
        rows.append(f"| `<arena>` | `<{name}>` | {instead} |")
    for kind in DEVICES:
        for name, instead in sorted(argos.MISSING[kind].items()):
            rows.append(f"| `<{kind}>` | `<{name}>` | {_as_text(instead)} |")
    return "\n".join(rows) + "\n"


def _as_text(words: str) -> str:
    return words.replace("<", "`<").replace(">", ">`")
