"""Reads `<media>`: ids that devices and lights refer to.

In ARGoS a medium is an index of what can be sensed. Here everything in the arena is found without
one, so of a medium only its id counts, and for range and bearing whether bodies are in the way.
"""

from __future__ import annotations

from collections.abc import Mapping

from vsense.config import argos
from vsense.config.element import Element
from vsense.config.wording import listed

Media = Mapping[str, Element]
"""The media by id."""

OCCLUSIONS = "check_occlusions"
"""Attribute of a range-and-bearing medium, and of the virtual sensor that uses it."""


def read_media(root: Element) -> Media:
    """Reads the media of an experiment.

    Args:
        root: <argos-configuration>.

    Raises:
        ConfigError: two have one id, or an attribute is wrong.
    """
    section = root.optional_child("media")
    found: dict[str, Element] = {}
    for element in section.children(*argos.MEDIA, *argos.OTHER_MEDIA) if section else ():
        name = element.text("id")
        if name in found:
            line = found[name].line
            raise element.error(f"{name!r} is the id of another medium, in line {line}", "id")
        found[name] = element
        if element.name in argos.OTHER_MEDIA:
            element.leave_out("nothing is sent through it")
            continue
        if element.has("grid_size"):
            element.numbers("grid_size", 3, 1.0, 1e6)
        if element.name == "range_and_bearing":
            element.boolean(OCCLUSIONS, True)
    return found


def check_medium(element: Element, media: Media) -> None:
    """Reads the medium that a device or a light may name, and tells the device what it says.

    Raises:
        ConfigError: there is no such medium.
    """
    if not element.has("medium"):
        return
    name = element.text("medium")
    if name not in media:
        raise element.error(
            f"there is no {name!r} in <media>; there are: {listed(media)}", "medium"
        )
    says = media[name].peek(OCCLUSIONS)
    if element.name == argos.HEARING and says is not None and element.peek(OCCLUSIONS) is None:
        element.set(OCCLUSIONS, says)
