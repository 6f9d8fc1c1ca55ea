"""Settings from outside an experiment file: what a campaign or `--set` changes in it.

A setting is `ELEMENT.attribute`: ELEMENT is an element's name or id, a controller's library, with
or without folder and suffix, `sensor` (every virtual sensor) or `actuator` (every virtual
actuator). Between the two may stand names of elements inside it: `distribute.entity.quantity`. What
is set on a controller is set in its <params>; `noise` of a virtual device is short for
`noise_level`. The prefix `vs:` of our own names may be left out.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import PurePath

from vsense.base.errors import UsageError, instead
from vsense.base.xml.element import Element
from vsense.config import argos
from vsense.robots.sources import SOURCE_SUFFIXES, stem_of

DEVICES = {"sensor": "sensors", "actuator": "actuators"}
"""What stands for all virtual devices of a kind, and the element that holds them."""

_SHORT = {"noise": "noise_level"}


def apply(
    root: Element,
    settings: Mapping[str, str],
    virtual: Mapping[str, Collection[str]],
    limit: int | None = None,
) -> dict[str, list[Element]]:
    """Puts settings, values by `ELEMENT.attribute`, in their places before the file is read.

    `virtual` has the names of the virtual devices by the name of the element that holds them.
    Returns by setting the elements that it changes. Raises UsageError where a setting has no such
    form, fits no element, or says how many robots there are, and `limit` does, too.
    """
    applied = {key: _apply(root, key, value, virtual) for key, value in settings.items()}
    for key, elements in applied.items() if limit is not None else ():
        robots = any(e.below(name) for e in elements for name in argos.ROBOTS)
        if key.endswith(".quantity") and robots:
            raise UsageError(
                f"{limit} robots (--robots, or a plan's count): setting {key!r} says how many there"
                " are, too; give one of them"
            )
    return applied


def check_used(root: Element, applied: Mapping[str, list[Element]]) -> None:
    """Raises UsageError where an `applied` setting changes only what is left out."""
    in_use = {id(element) for element in root.walk()}
    for key, elements in applied.items():
        if not any(id(element) in in_use for element in elements):
            where = f"{root.document.file}:{elements[0].line}"
            raise UsageError(f"setting {key!r}: <{elements[0].name}> of {where} is not in use")


def _apply(
    root: Element, key: str, value: str, virtual: Mapping[str, Collection[str]]
) -> list[Element]:
    first = _library(root, key) or key.partition(".")[0]
    *path, attribute = key.removeprefix(first).removeprefix(".").split(".")
    if not first or not attribute:
        raise UsageError(f"setting {key!r}: expected ELEMENT.attribute, such as 'sensor.noise'")
    elements = _matching(root, first, virtual)
    if not elements:
        hint = instead(first, _names(root, virtual))
        raise UsageError(f"setting {key!r}: there is no {first!r} in {root.document.file}; {hint}")
    targets = [inner for element in elements for inner in _inside(element, path)]
    if not targets:
        raise UsageError(f"setting {key!r}: {first!r} has no <{'> in <'.join(reversed(path))}>")
    names = {name for device in virtual.values() for name in device}
    for element in targets:
        element.set(_SHORT.get(attribute, attribute) if element.name in names else attribute, value)
    return targets


def _matching(root: Element, name: str, virtual: Mapping[str, Collection[str]]) -> list[Element]:
    """Finds the elements that a setting's first word means."""
    controllers = _controllers(root)
    named = [e for e in controllers if name in (e.peek("id"), *_libraries(e))]
    if named:
        return [_to_set(controller, "params") for controller in named]
    if name in DEVICES:
        section = DEVICES[name]
        devices = [d for c in controllers for s in c.below(section) for d in s.below()]
        return [device for device in devices if device.name in virtual[section]]
    return [e for e in root.walk() if name in (e.name, e.name.removeprefix("vs:"), e.peek("id"))]


def _controllers(root: Element) -> list[Element]:
    return [element for section in root.below("controllers") for element in section.below()]


def _libraries(controller: Element) -> tuple[str, ...]:
    """A controller's library as the file names it, and without folder and suffix."""
    library = controller.peek("library")
    if library is None:
        return ()
    path = PurePath(library)
    return library, path.stem if path.suffix in SOURCE_SUFFIXES else stem_of(library)


def _library(root: Element, key: str) -> str | None:
    """The longest name of a library that a setting begins with: it may hold points of its own."""
    names = {name for controller in _controllers(root) for name in _libraries(controller)}
    return max((name for name in names if key.startswith(f"{name}.")), key=len, default=None)


def _inside(element: Element, path: list[str]) -> list[Element]:
    """Follows names of elements inwards; in <params> what is missing is made."""
    elements = [element]
    for name in path:
        if element.name == "params":
            elements = [_to_set(e, name) for e in elements]
        else:
            elements = [child for e in elements for child in e.below(name)]
    return elements


def _to_set(element: Element, name: str) -> Element:
    """Gives an element inside of another; it is made where it is missing."""
    there = element.below(name)
    if not there:
        there = [Element(element.document, name, element.line, {})]
        element.append(there[0])
    return there[0]


def _names(root: Element, virtual: Mapping[str, Collection[str]]) -> set[str]:
    """What a setting's first word may be."""
    names = {e.name for e in root.walk()} | {e.peek("id") or e.name for e in root.walk()}
    names |= {
        _libraries(controller)[-1] for controller in _controllers(root) if _libraries(controller)
    }
    words = {word for word, section in DEVICES.items() if names & set(virtual[section])}
    return names - {root.name} | words
