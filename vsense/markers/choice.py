"""Which tags to print: ranges, lists, or numbers that a camera can tell apart best."""

from __future__ import annotations

import re

import cv2
import numpy as np

from vsense.errors import UsageError
from vsense.markers.codes import choose_tags
from vsense.markers.families import FamilyError, MarkerFamily, SquareFamily
from vsense.markers.sheet import AnyFamily

AUTO_BLUR = 0.4
"""Blur that chosen tags stay apart under, in cells: a point spread of 1.2 px at 0.57 px/mm."""

MOST = 1000
"""Tags on a sheet."""

_RANGE = re.compile(r"(\d{1,6})(?:-(\d{1,6}))?")
_FINE = 4


def parse(text: str, family: AnyFamily) -> list[int]:
    """Returns the tags that a text such as `1-20`, `3,7,20-22` or `auto:20` names.

    Raises:
        UsageError: it is no such text, names a tag twice, or one that the family lacks.
    """
    if text.startswith("auto:"):
        return _auto(text, family)
    tags: list[int] = []
    for part in text.split(","):
        match = _RANGE.fullmatch(part.strip())
        if match is None:
            raise UsageError(
                f"--ids {text}: {part.strip()!r} is no number or range;"
                " expected for example 1-20, 3,7,20-22 or auto:20"
            )
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise UsageError(f"--ids {text}: the range {part.strip()} goes backwards")
        if last >= family.tags:
            raise UsageError(
                f"--ids {text}: there is no tag {last}: the family {family.name} has"
                f" 0 to {family.tags - 1}"
            )
        tags += range(first, last + 1)
        if len(tags) > MOST:
            raise UsageError(f"--ids {text}: more than {MOST} tags")
    twice = {tag for tag in tags if tags.count(tag) > 1}
    if twice:
        raise UsageError(f"--ids {text}: tag {min(twice)} is there twice")
    return tags


def _auto(text: str, family: AnyFamily) -> list[int]:
    number = text.removeprefix("auto:")
    if not number.isdecimal() or not 1 <= int(number) <= MOST:
        raise UsageError(f"--ids {text}: expected auto:N with N from 1 to {MOST}")
    try:
        if isinstance(family, MarkerFamily):
            return choose_tags(family, int(number), AUTO_BLUR * family.cell_mm)
        return choose_square_tags(family, int(number))
    except FamilyError as error:
        raise UsageError(f"--ids {text}: {error}") from None


def choose_square_tags(family: SquareFamily, count: int) -> list[int]:
    """Chooses tags of a dictionary that stay far apart under blur in all four positions.

    Raises:
        FamilyError: The dictionary has fewer tags.
    """
    if count > family.tags:
        raise FamilyError(f"{count} tags: the family {family.name} has {family.tags}")
    cells = family.codes.bits().astype(np.float32)
    fine = np.pad(
        cells.repeat(_FINE, axis=1).repeat(_FINE, axis=2), ((0, 0), (_FINE,) * 2, (_FINE,) * 2)
    )
    words = np.stack([cv2.GaussianBlur(tag, (0, 0), AUTO_BLUR * _FINE) for tag in fine])
    chosen = [0]
    nearest = np.full(family.tags, np.inf, dtype=np.float32)
    while len(chosen) < count:
        for turns in range(4):
            turned = np.rot90(words[chosen[-1]], turns)
            nearest = np.minimum(nearest, ((words - turned) ** 2).sum(axis=(1, 2)))
        nearest[chosen] = -1.0
        chosen.append(int(nearest.argmax()))
    return sorted(chosen)
