"""The picture of how long each spot of the arena was occupied."""

from __future__ import annotations

import cv2
import numpy as np

from vsense.pictures.canvas import INK, MUTED, SCALE, Canvas, Colour, round_number
from vsense.report.findings import Findings
from vsense.report.floor import Map, arena_of, draw_map, framed, map_origin, map_width
from vsense.report.picture import Figure, part
from vsense.report.plot import HALF_PX, SMALL
from vsense.report.tracks import CELL_M

_BAR_PX = 84


def occupancy(findings: Findings) -> Figure | None:
    """How long robots were in each square of the arena."""
    found = findings.found
    cells = found.tracks.cells
    if not cells:
        return None
    arena = arena_of(found)
    map_ = draw_map(found, map_width(arena, HALF_PX, _BAR_PX), solid=False)
    seconds = {cell: count * found.facts.timestep_s for cell, count in cells.items()}
    most = max(seconds.values())
    for (column, row), time_s in seconds.items():
        corner = np.array(
            [[column * CELL_M, (row + 1) * CELL_M], [(column + 1) * CELL_M, row * CELL_M]]
        )
        (left, top), (right, bottom) = np.rint(map_.place(corner) * SCALE).astype(int).clip(0)
        map_.canvas.image[top:bottom, left:right] = _heat(time_s / most)
    picture = _outlined(findings, map_)
    whole = framed(picture, arena, _BAR_PX)
    _heat_bar(whole, picture, most)
    caption = (
        f"How long robots were in each square of {CELL_M * 100:.0f} cm in {part(findings)}:"
        f" the sum over all robots of the time in which they were seen there. White: never."
        f" Colours follow the square root of the time, so that short stays show, too."
    )
    return Figure("occupancy", whole.image, "Occupancy", caption, False)


def _outlined(findings: Findings, map_: Map) -> Map:
    """Draws what stands in the arena over the squares."""
    outlines = draw_map(findings.found, round(_width(map_)), solid=False).canvas.image
    np.minimum(map_.canvas.image, outlines, out=map_.canvas.image)
    return map_


def _heat(share: float) -> Colour:
    """The colour of a share of the greatest: viridis backwards, dark is much."""
    level = np.uint8(255 - round(255 * float(np.sqrt(min(max(share, 0.0), 1.0)))))
    table = cv2.applyColorMap(np.array([[level]], np.uint8), cv2.COLORMAP_VIRIDIS)
    blue, green, red = (int(part) for part in table[0, 0])
    return blue, green, red


def _heat_bar(whole: Canvas, map_: Map, most: float) -> None:
    left, top = map_origin()
    left += round(_width(map_)) + 20
    height = map_.canvas.image.shape[0] / SCALE
    for place in range(round(height)):
        box = np.array([[left, top + place], [left + 14, top + place]])
        whole.lines(box, _heat((1.0 - place / height) ** 2), 1.0)
    values = {0.0, most, *(round_number(most * share) for share in (0.04, 0.2, 0.5))}
    for value in values:
        y = top + height * (1.0 - np.sqrt(value / most))
        whole.lines(np.array([[left + 14, y], [left + 18, y]]), MUTED)
        whole.text(f"{value:.3g}", left + 22, y + 5, INK, SMALL)
    whole.text("time [s]", left - 6, top - 12, INK, SMALL)


def _width(map_: Map) -> float:
    return float(map_.canvas.image.shape[1] / SCALE)
