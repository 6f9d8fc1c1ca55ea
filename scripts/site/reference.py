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
    "The arena": ("arena", "box", "cylinder", "leds", "e-puck", "vs:object", "vs:geofence"),
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
What their numbers mean: [sensors and actuators](devices.md). What a device takes because files of
ARGoS have it, and does not use, is not shown with it.

### Quality settings

Every virtual device takes them: what a perfect one's numbers become on their way. How they act on
each other, and in which unit they count: [quality](devices.md#quality-settings).
"""


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


def page() -> str:
    """The whole page.

    Raises:
        ValueError: no sentence says what an element or attribute is, or one explains what nobody
            reads.
    """
    asked, sentences = observed(), Sentences()
    if lacking := missing(asked, sentences):
        raise ValueError(f"no sentence in argos-names.txt or argos-vsense.xsd: {lacking}")
    if unused := sentences.unused():
        raise ValueError(f"sentences for what nobody reads: {sorted(unused)}")
    return Reference(asked, sentences).text()


class Reference:
    """The page, while it is written."""

    def __init__(self, asked: Asked, sentences: Sentences) -> None:
        self._asked = asked
        self._sentences = sentences
        kinds: dict[str, set[str]] = {}
        for element in asked.values():
            for key, attribute in element.attributes.items():
                kinds.setdefault(key, set()).update({attribute.kind} - {""})
        self._kinds = {key: found.pop() for key, found in kinds.items() if len(found) == 1}

    def text(self) -> str:
        """All chapters."""
        parts = [INTRO]
        for chapter, parents in CHAPTERS.items():
            parts.append(f"## {chapter}\n")
            parts += [self._section(place) for place in self._of_chapter(chapter, parents)]
        return "\n".join([*parts, DEVICE_INTRO, self._quality(), *self._devices(), _not_served()])

    def _of_chapter(self, chapter: str, parents: tuple[str, ...]) -> list[tuple[str, str]]:
        found = [("argos-configuration", name) for name in HEADS.get(chapter, ())]
        seen = {name for names in HEADS.values() for name in names}
        for parent in parents:
            for place in sorted(p for p in self._asked if p[0] == parent):
                if place[1] not in seen:
                    found.append(place)
                    seen.add(place[1])
        return found

    def _section(self, place: tuple[str, str]) -> str:
        (parent, name), element = place, self._asked[place]
        lines = [f"### `<{name}>`\n", str(self._sentences.element(parent, name))]
        if parent:
            lines.append(f"\nIn {', '.join(self._parents(place))}.")
        if children := _children(element, name):
            lines.append(f"\nHolds {children}.")
        if element.attributes:
            lines.append(f"\n{self._table(place, element.attributes, element.read)}")
        if example := _example(element):
            lines.append(f"\n```xml\n{example}\n```")
        return "\n".join(lines) + "\n"

    def _parents(self, place: tuple[str, str]) -> list[str]:
        """The elements that may hold one; in others its name may mean something else."""
        known, found = self._asked[place].attributes.keys(), {place[0]}
        for (_, parent), element in self._asked.items():
            other = self._asked.get((parent, place[1]), self._asked[place])
            if place[1] in element.children and other.attributes.keys() == known:
                found.add(parent)
        return [_within(parent) for parent in sorted(found)]

    def _table(
        self, place: tuple[str, str], attributes: dict[str, AskedAttribute], read: int
    ) -> str:
        """A row for each attribute; `read` is how many elements there were in the files."""
        rows = ["| attribute | what it is | type | default |", "| --- | --- | --- | --- |"]
        for key in sorted(attributes, key=lambda key: (key.startswith("vs:"), key != "id", key)):
            attribute = attributes[key]
            kind = attribute.kind or self._kinds.get(key) or "any"
            said = self._sentences.attribute(*place, key)
            rows.append(f"| `{key}` | {said} | {kind} | {_default(attribute, read)} |")
        return "\n".join(rows)

    def _quality(self) -> str:
        """The tables of what all devices have."""
        place = ("sensors", "virtual_ground_sensor")
        keys = self._asked[place].attributes
        rows = self._table(place, {key: keys[key] for key in QUALITY_KEYS}, 0)
        common = {key: AskedAttribute() for key in COMMON_KEYS}
        for (parent, _), element in self._asked.items():
            if parent in DEVICES:
                common.update(
                    {k: a for k, a in element.attributes.items() if k in common and a.kind}
                )
        head = "\n### Attributes of all devices\n\nARGoS's, IRIDIA's, and who serves the device.\n"
        return f"{rows}\n{head}\n{self._table(('sensors', 'epuck_ground'), common, 0)}\n"

    def _devices(self) -> list[str]:
        """A section for each device, with the attributes that are its own."""
        parts = []
        for kind in DEVICES:
            parts.append(f"### {kind.capitalize()}\n")
            parts += [self._device(place) for place in sorted(self._asked) if place[0] == kind]
        return parts

    def _device(self, place: tuple[str, str]) -> str:
        (kind, name), element = place, self._asked[place]
        module = module_of(kind, name)
        said = str(self._sentences.element(kind, name))
        if module is not None:
            link = module.__name__.rsplit(".", 1)[1].replace("_", "-")
            said = f"[{said.rstrip('.')}](devices.md#{kind[:-1]}-{link})."
        shared = (*QUALITY_KEYS, *COMMON_KEYS)
        # Whose value nobody reads is passed over by this device.
        own = {k: a for k, a in element.attributes.items() if k not in shared and a.kind}
        lines = [f"#### `<{name}>`{' (actuator)' if kind == 'actuators' else ''}\n", said]
        if own:
            lines.append(f"\n{self._table(place, own, element.read)}")
            lines.append(f"\n```xml\n{_example(element)}\n```")
        return "\n".join(lines) + "\n"


def _within(parent: str) -> str:
    return "a controller's element" if parent == CONTROLLER else f"`<{parent}>`"


def _children(element: AskedElement, name: str) -> str:
    """What an element may hold, without what is passed over."""
    if name in DEVICES:
        return "[devices](#devices)"
    if name == "controllers":
        return "an element of any name for each controller"
    known = sorted(element.children - argos.ENTITIES.keys() - {*argos.PHYSICS_ENGINES})
    known = [child for child in known if child not in argos.OTHER_MEDIA]
    return ", ".join(f"`<{child}>`" for child in known)


def _default(attribute: AskedAttribute, read: int) -> str:
    """What holds where an attribute is absent; `read` is how many elements there were."""
    if attribute.defaults:
        return f"`{min(attribute.defaults)}`" if len(attribute.defaults) == 1 else "depends"
    if not attribute.required:
        return "none"
    return "required" if attribute.asked == read else "required where it applies"


def _example(element: AskedElement) -> str:
    """The start tag with most attributes, in lines that fit the page."""
    tags = [tag for tag in element.examples if "=" in tag]
    if not tags:
        return ""
    words = re.findall(r'<\S+|[\w:.-]+="[^"]*"|/>', max(sorted(set(tags)), key=len))
    lines = [words[0]]
    for word in words[1:]:
        if len(lines[-1]) + len(word) > 80 and word != "/>":
            lines.append("   ")
        lines[-1] += f" {word}"
    return "\n".join(lines)


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
