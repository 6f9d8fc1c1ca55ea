"""The picture of the robots' ways over the arena."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import cv2
import numpy as np

from vsense.pictures.canvas import INK, SCALE, Colour, Floats
from vsense.report.facts import entities
from vsense.report.findings import Findings
from vsense.report.floor import Map, arena_of, draw_map, framed, map_width
from vsense.report.gather import Gatherer
from vsense.report.picture import Figure, part
from vsense.report.plot import COLOURS, GREY, WIDE_PX, pieces, write

NEWEST_WIDTHS = 25.0
"""Ways that together are longer than so many widths of the arena cannot be told apart: what is
older is grey then."""
MOST_TIMES = 12.0
"""Ways so many times as long would make everything grey: what is older is left out then."""
MOST_NAMES = 30
"""More robots than these are not named."""
_NAME_PX = 50


def ways(findings: Findings) -> Figure | None:
    """The robots' ways over the arena."""
    found = findings.found
    if not found.tracks.of:
        return None
    arena = arena_of(found)
    map_ = draw_map(found, map_width(arena, WIDE_PX))
    all_ = {tag: track.points_m for tag, track in sorted(found.tracks.of.items())}
    newest_m = NEWEST_WIDTHS * arena.size_m[0] / len(all_)
    times = sum(_length_m(way) for way in all_.values()) / (newest_m * len(all_))
    long = times > 1.0
    newest = {tag: _tail(way, newest_m) if long else way for tag, way in all_.items()}
    colours = {tag: COLOURS[place % len(COLOURS)] for place, tag in enumerate(all_)}
    before = map_.canvas.image.copy()
    for way in all_.values() if 1.0 < times < MOST_TIMES else ():
        _line(map_, way, GREY, 0.5)
    for tag, way in newest.items():
        _line(map_, way, colours[tag], 1.5)
    cv2.addWeighted(map_.canvas.image, 0.8, before, 0.2, 0.0, dst=map_.canvas.image)
    for at in found.tracks.objects_m.values():
        _diamond(map_, np.array(at))
    for tag, way in all_.items():
        _ends(map_, pieces(way), colours[tag], found.facts.body_radius_m, not long)
    if len(all_) <= MOST_NAMES:
        _names(map_, all_)
    caption = _caption(findings, len(all_), times, newest_m)
    return Figure("ways", framed(map_, arena).image, "Trajectories", caption, True)


def _caption(findings: Findings, count: int, times: float, newest_m: float) -> str:
    ends = "ring of a robot's size: where it was last seen"
    ends += ", with its tag" if count <= MOST_NAMES else ""
    if times <= 1.0:
        ways = f"Hollow circle: where a robot was first seen; {ends}."
    else:
        before = "grey: all before" if times < MOST_TIMES else "see the occupancy for all before"
        ways = f"Only the last {newest_m:.3g} m of each ({before}); {ends}."
    shapes = "; ".join(_shapes(findings.found))
    return (
        f"Ways of {count} robots in {part(findings)}, as tracked from above. {ways}"
        " Ways are broken where a robot was not seen for more than 1 s or the run paused."
        " Beneath: the arena as at the end" + (f"; {shapes}." if shapes else ".")
    )


def _shapes(found: Gatherer) -> Iterator[str]:
    """What the shapes are that stand in this arena."""
    things = entities(found.world)
    solids = [bool(e.get("physical")) for e in things if e.get("kind") in ("box", "cylinder")]
    kinds = [e.get("kind") for e in things]
    words = {
        "grey: real obstacles": True in solids,
        "purple: virtual obstacles": False in solids,
        "yellow glow: lights": "light" in kinds,
        "filled areas: zones of the floor": "zone" in kinds,
        "teal rings: virtual robots": "robot" in kinds,
        "orange triangle: the polluted cone (broken line: at the beginning)": bool(found.cones),
        "black diamond: tagged object": bool(found.tracks.objects_m),
    }
    return (text for text, there in words.items() if there)


def _length_m(way: Floats) -> float:
    return float(np.nansum(np.hypot(*np.diff(way, axis=0).T)))


def _tail(way: Floats, length_m: float) -> Floats:
    """The last so many metres of a way."""
    steps = np.nan_to_num(np.hypot(*np.diff(way, axis=0).T))
    left_m = np.concatenate([np.cumsum(steps[::-1])[::-1], [0.0]])
    return np.asarray(way[left_m <= length_m])


def _line(map_: Map, way: Floats, colour: Colour, width: float) -> None:
    for piece in pieces(way):
        map_.canvas.lines(map_.place(piece), colour, width)


def _diamond(map_: Map, at_m: Floats) -> None:
    corners = np.array([[7.0, 0.0], [0.0, 7.0], [-7.0, 0.0], [0.0, -7.0]])
    place = map_.place(at_m[None])[0]
    map_.canvas.fill(place + corners * 1.3, (255, 255, 255))
    map_.canvas.fill(place + corners, INK)


def _ends(map_: Map, parts: Sequence[Floats], colour: Colour, radius_m: float, first: bool) -> None:
    """Marks where a way ends, and where it begins if that is wanted."""
    if not parts:
        return
    if first:
        begin = map_.place(parts[0][:1])[0]
        map_.canvas.dot(begin, 5.0, (255, 255, 255))
        map_.canvas.ring(begin, 4.5, colour, 1.5)
    end = map_.place(parts[-1][-1:])[0]
    radius = max(radius_m * map_.zoom, 3.0)
    map_.canvas.ring(end, radius, (255, 255, 255), 4.5)
    map_.canvas.ring(end, radius, colour, 2.5)
    map_.canvas.dot(end, 2.5, colour)


def _names(map_: Map, ways_: Mapping[int, Floats]) -> None:
    """Writes each robot's tag beside its last place."""
    width = map_.canvas.image.shape[1] / SCALE
    for tag, way in ways_.items():
        parts = pieces(way)
        if parts:
            x, y = map_.place(parts[-1][-1:])[0] + [7.0 + 0.035 * map_.zoom, -4.0]
            write(map_.canvas, str(tag), min(float(x), width - _NAME_PX), float(y), INK)
