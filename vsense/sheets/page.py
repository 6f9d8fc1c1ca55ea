"""A page of paper: filled polygons, strokes and text in millimetres, whatever it is written to.

The origin is the lower left corner of the paper, x to the right, y up. Grey is 0 black to 1 white.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Fill:
    """Polygons that are filled together, so that neighbours show no seam.

    Attributes:
        polygons: (n, 2) corners [mm] each; convex.
        grey: the colour.
    """

    polygons: Sequence[Floats]
    grey: float


@dataclass(frozen=True, slots=True)
class Stroke:
    """A line through points.

    Attributes:
        points: (n, 2) [mm].
        width_mm: how thick it is.
        grey: the colour.
    """

    points: Floats
    width_mm: float
    grey: float = 0.0


@dataclass(frozen=True, slots=True)
class Text:
    """One line of text.

    Attributes:
        x_mm: where it begins.
        y_mm: its base line.
        size_mm: size of the font.
        text: what it says, in Latin-1.
    """

    x_mm: float
    y_mm: float
    size_mm: float
    text: str


@dataclass(frozen=True, slots=True)
class Page:
    """What is on one sheet of paper; later items cover earlier ones.

    Attributes:
        width_mm: width of the paper.
        height_mm: height of the paper.
        items: what is drawn.
    """

    width_mm: float
    height_mm: float
    items: list[Fill | Stroke | Text] = field(default_factory=list)


def line(x0_mm: float, y0_mm: float, x1_mm: float, y1_mm: float, width_mm: float) -> Stroke:
    """Returns a black line."""
    return Stroke(np.array(((x0_mm, y0_mm), (x1_mm, y1_mm))), width_mm)


def dashed_circle(x_mm: float, y_mm: float, radius_mm: float, width_mm: float) -> list[Stroke]:
    """Returns a thin grey circle of dashes about 2 mm long."""
    dashes = max(8, round(np.pi * radius_mm / 2.0))
    strokes = []
    for first in np.arange(dashes) * (2.0 * np.pi / dashes):
        turn = first + np.linspace(0.0, np.pi / dashes, 5)
        points = np.stack((x_mm + radius_mm * np.cos(turn), y_mm + radius_mm * np.sin(turn)), -1)
        strokes.append(Stroke(points, width_mm, 0.55))
    return strokes
