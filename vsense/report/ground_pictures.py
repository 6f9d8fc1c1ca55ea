"""The pictures of where robots were: their ways, and how long each spot was occupied."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from vsense.pictures.canvas import INK, MUTED, SCALE, Canvas, Colour, Floats, round_number
from vsense.report.findings import Findings
from vsense.report.floor import Map, arena_of, draw_map, framed, map_origin, map_width
from vsense.report.picture import Picture, part
from vsense.report.plot import COLOURS, HALF_PX, SMALL, WIDE_PX, pieces, write
from vsense.report.tracks import CELL_M

MOST_NAMES = 30
"""More robots than these are not named in a picture."""
_BAR_PX = 84


def ways(findings: Findings) -> Picture | None:
    """The robots' ways over the arena."""
    found = findings.found
    if not found.tracks.of:
        return None
    arena = arena_of(found)
    map_ = draw_map(found, map_width(arena, WIDE_PX))
    colours = dict(zip(sorted(found.tracks.of), _cycle(len(found.tracks.of))))
    before = map_.canvas.image.copy()
    for tag, track in found.tracks.of.items():
        for piece in pieces(track.points_m):
            map_.canvas.lines(map_.place(piece), colours[tag], 1.5)
    cv2.addWeighted(map_.canvas.image, 0.8, before, 0.2, 0.0, dst=map_.canvas.image)
    for at in found.tracks.objects_m.values():
        _diamond(map_, np.array(at))
    for tag, track in found.tracks.of.items():
        _ends(map_, pieces(track.points_m), colours[tag], found.facts.body_radius_m)
    if len(colours) <= MOST_NAMES:
        for tag, track in found.tracks.of.items():
            parts = pieces(track.points_m)
            if parts:
                x, y = map_.place(parts[-1][-1:])[0] + [7 + 0.035 * map_.zoom, -4]
                write(map_.canvas, str(tag), min(float(x), _width(map_) - 50), float(y), INK)
    extras = [
        words
        for words, there in (
            ("black diamonds: tagged objects", found.tracks.objects_m),
            (
                "orange triangle: the polluted cone at the end (broken line: at the beginning)",
                found.cones,
            ),
        )
        if there
    ]
    caption = (
        f"Ways of {len(found.tracks.of)} robots in {part(findings)}, as tracked from above."
        " Hollow circle: where a robot was first seen; ring of its size: where it was last seen,"
        " with its tag. Ways are broken where a robot was not seen for more than 1 s or the run"
        " paused. Beneath: the arena with everything real and virtual in it as at the end"
    )
    return Picture(
        "ways", framed(map_, arena).image, "Trajectories", "; ".join([caption, *extras]) + ".", True
    )


def _width(map_: Map) -> float:
    return float(map_.canvas.image.shape[1] / SCALE)


def _cycle(count: int) -> list[Colour]:
    return [COLOURS[place % len(COLOURS)] for place in range(count)]


def _diamond(map_: Map, at_m: Floats) -> None:
    corners = np.array([[7.0, 0.0], [0.0, 7.0], [-7.0, 0.0], [0.0, -7.0]])
    place = map_.place(at_m[None])[0]
    map_.canvas.fill(place + corners * 1.3, (255, 255, 255))
    map_.canvas.fill(place + corners, INK)


def _ends(map_: Map, parts: Sequence[Floats], colour: Colour, radius_m: float) -> None:
    if not parts:
        return
    first, last = map_.place(parts[0][:1])[0], map_.place(parts[-1][-1:])[0]
    map_.canvas.dot(first, 5.0, (255, 255, 255))
    map_.canvas.ring(first, 4.5, colour, 1.5)
    radius = max(radius_m * map_.zoom, 3.0)
    map_.canvas.ring(last, radius, (255, 255, 255), 4.5)
    map_.canvas.ring(last, radius, colour, 2.5)
    map_.canvas.dot(last, 2.5, colour)


def occupancy(findings: Findings) -> Picture | None:
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
    return Picture("occupancy", whole.image, "Occupancy", caption, False)


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
