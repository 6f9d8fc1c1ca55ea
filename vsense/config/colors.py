"""Colours as experiment files name them. Source: ARGoS, color.h; there orange is 255,140,0."""

from __future__ import annotations

from vsense.config.element import Element
from vsense.config.wording import listed, shown
from vsense.world.entities import Color

NAMED: dict[str, Color] = {
    "black": (0, 0, 0),
    "white": (255, 255, 255),
    "red": (255, 0, 0),
    "green": (0, 255, 0),
    "blue": (0, 0, 255),
    "magenta": (255, 0, 255),
    "cyan": (0, 255, 255),
    "yellow": (255, 255, 0),
    "orange": (255, 140, 0),
    "brown": (165, 42, 42),
    "purple": (128, 0, 128),
    "gray10": (26, 26, 26),
    "gray20": (51, 51, 51),
    "gray30": (77, 77, 77),
    "gray40": (102, 102, 102),
    "gray50": (127, 127, 127),
    "gray60": (153, 153, 153),
    "gray70": (179, 179, 179),
    "gray80": (204, 204, 204),
    "gray90": (229, 229, 229),
}


def read_color(element: Element, key: str, default: str | None = None) -> Color:
    """Reads a colour's name, or its red, green and blue from 0 to 255 with commas between them.

    Raises:
        ConfigError: absent and required, or no colour.
    """
    text = element.text(key, default, "a colour such as 'yellow' or '255,255,0'")
    if text in NAMED:
        return NAMED[text]
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 3 or not all(p.isascii() and p.isdigit() and int(p) <= 255 for p in parts):
        known = listed(NAMED)
        raise element.error(
            f"{shown(text)} is no colour, expected three whole numbers from 0 to 255 with commas"
            f" between them, or one of: {known}",
            key,
        )
    red, green, blue = (int(part) for part in parts)
    return red, green, blue
