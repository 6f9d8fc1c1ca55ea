"""What a picture of a report is."""

from __future__ import annotations

from dataclasses import dataclass

from vsense.pictures.canvas import Image
from vsense.pictures.story import spoken
from vsense.report.findings import Findings

RUN_TIME = "time since the run began [s]"
MOST_MEASURES = 12
"""Measures of one experiment that are drawn."""
_MOST_LETTERS = 44


@dataclass(frozen=True, slots=True)
class Figure:
    """A picture of a report.

    Attributes:
        name: of its file, without ".png".
        image: (h, w, 3) BGR, `SCALE` px for each px of the page.
        title: what it is.
        caption: what it shows, for somebody who sees nothing else.
        wide: it takes the page's whole width.
    """

    name: str
    image: Image
    title: str
    caption: str
    wide: bool


def part(findings: Findings) -> str:
    """Which part of a recording is shown, in words."""
    if not findings.found.ran:
        return "the whole recording (it holds no run)"
    return f"the run ({findings.run_s:.1f} s)"


def plain(name: str) -> str:
    """A measure's name for a picture, whose letters are ASCII."""
    return spoken(name)[:_MOST_LETTERS].encode("ascii", "replace").decode()
