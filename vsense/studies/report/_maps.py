"""The charts of reports that show the arena from above: the robots' ways, and occupancy."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vsense.base.arena import Floats
from vsense.base.message_bus import DAMAGED
from vsense.config.arena import floor_picture
from vsense.studies.report._facts import entities, number, numbers
from vsense.studies.report._findings import Findings
from vsense.studies.report._gather import MAP_CELL_M, Gatherer
from vsense.studies.report._plot import Drawing, label, new_figure, setting, width_of
from vsense.world.entities import Arena

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FLOOR_SHARE = 0.5
"""The share of the floor's colour that is left, so that ways upon it can be seen."""
_FLOOR_PX = 1024
"""A side of its picture is drawn with at most so many pixels: Matplotlib has each many times."""
NEAR_SIZES = 20.0
"""What is so many sizes of the arena away is not drawn."""
NEWEST_WIDTHS = 25.0
"""If the ways are together longer than so many widths of the arena, older parts are grey."""
MOST_TIMES = 12.0
"""If they are so many times as long, older parts are left out."""
MOST_TAGS = 30
"""If there are more robots, they are not named."""
_CONE, _LAMP, _VIRTUAL, _GHOST = "#E69F00", "#F0E442", "#CC79A7", "#009E73"
_WHITE = 1.0, 1.0, 1.0
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 49)
_ROUND = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=-1)
_CORNERS = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_ROOM_IN = 0.6, 0.5
"""Room for the numbers beside and below a map [inch]."""
_LEGEND_ROW_IN, _LEGEND_COLUMNS = 0.16, 4
_MOST_SHAPES, _MOST_LETTERS = 12, 20
"""Shapes that a legend names, and letters of a zone's name there."""


def ways(findings: Findings) -> Drawing | None:
    """The robots' ways over the arena."""
    gathered = findings.gathered
    if not gathered.tracks.of:
        return None
    arena = gathered.arena
    figure, axes = _map(arena, width_of(wide=True))
    _world(axes, gathered, arena)
    all_ = {tag: track.points_m for tag, track in sorted(gathered.tracks.of.items())}
    newest_m = NEWEST_WIDTHS * arena.size_m[0] / len(all_)
    times = sum(_length_m(way) for way in all_.values()) / (newest_m * len(all_))
    for way in all_.values() if 1.0 < times < MOST_TIMES else ():
        axes.plot(*way.T, color="0.8", linewidth=0.4)
    for place, way in enumerate(all_.values()):
        newest = _tail(way, newest_m) if times > 1.0 else way
        axes.plot(*newest.T, color=f"C{place}", linewidth=0.9, alpha=0.85)
    _ends(axes, gathered, all_, first=times <= 1.0)
    for at in gathered.tracks.objects_m.values():
        if _near(np.array(at), arena):
            style: dict[str, Any] = {"markeredgecolor": "white", "markersize": 7, "zorder": 4}
            axes.plot(*at, "D", color="black", label="tagged object", **style)
    _legend(figure, axes)
    words = _caption(findings, len(all_), times, newest_m)
    return Drawing("ways", "Trajectories", words, figure, wide=True)


def _caption(findings: Findings, count: int, times: float, newest_m: float) -> str:
    ends = "ring of a robot's size: where it was last seen"
    ends += ", with its tag" if count <= MOST_TAGS else ""
    if times <= 1.0:
        shown = f"Hollow circle: where a robot was first seen; {ends}."
    else:
        before = "grey: all before" if times < MOST_TIMES else "see the occupancy for all before"
        shown = f"Only the last {newest_m:.3g} m of each ({before}); {ends}."
    return (
        f"Ways of {count} robots in {findings.part}, as tracked from above. {shown}"
        " Ways are broken where a robot was not seen for more than 1 s or the run paused."
        " Beneath: the arena as at the end."
    )


def _length_m(way: Floats) -> float:
    return float(np.nansum(np.hypot(*np.diff(way, axis=0).T)))


def _tail(way: Floats, length_m: float) -> Floats:
    """The last so many metres of a way."""
    steps = np.nan_to_num(np.hypot(*np.diff(way, axis=0).T))
    left_m = np.concatenate([np.cumsum(steps[::-1])[::-1], [0.0]])
    return np.asarray(way[left_m <= length_m])


def _ends(axes: Axes, gathered: Gatherer, ways_: Mapping[int, Floats], first: bool) -> None:
    """Marks the end of each way with the robot's tag, and its beginning if `first`."""
    paper, facts = setting("axes.facecolor"), gathered.facts
    begin: dict[str, Any] = {"markersize": 4, "markeredgewidth": 0.8, "zorder": 3}
    for place, (tag, way) in enumerate(ways_.items()):
        radius_m = facts.radius_m(tag)
        colour, seen = f"C{place}", way[np.isfinite(way).all(axis=1)]
        if first:
            axes.plot(*seen[0], "o", color=paper, markeredgecolor=colour, **begin)
        axes.plot(*(seen[-1] + radius_m * _ROUND).T, color=colour, linewidth=1.4, zorder=3)
        axes.plot(*seen[-1], ".", color=colour, markersize=3, zorder=3)
    if first:
        axes.plot([], [], "o", color=paper, markeredgecolor="0.4", label="first seen", **begin)
    axes.plot([], [], "o", color="0.4", fillstyle="none", markersize=7, label="last seen")
    for tag, way in ways_.items() if len(ways_) <= MOST_TAGS else ():
        last = way[np.isfinite(way).all(axis=1)][-1]
        # Towards the arena's middle near its right edge.
        side = -1 if last[0] - gathered.arena.centre_m[0] > 0.4 * gathered.arena.size_m[0] else 1
        axes.annotate(
            str(tag),
            tuple(last + 0.7 * facts.radius_m(tag) * np.array([side, 1])),
            xytext=(2 * side, 2),
            textcoords="offset points",
            horizontalalignment="left" if side > 0 else "right",
            fontsize=6,
            bbox={"facecolor": paper, "edgecolor": "none", "alpha": 0.7, "pad": 0.6},
            clip_on=True,
            zorder=4,
        )


def occupancy(findings: Findings) -> Drawing | None:
    """How long robots were in each square of the arena."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import PowerNorm
    from matplotlib.ticker import MaxNLocator

    gathered = findings.gathered
    if not gathered.tracks.cells:
        return None
    arena = gathered.arena
    figure, axes = _map(arena, width_of(wide=False), bar_in=0.45)
    squares = (np.array(list(gathered.tracks.cells))[:, None] + _CORNERS + 0.5) * MAP_CELL_M
    seconds = np.array(list(gathered.tracks.cells.values())) * gathered.facts.timestep_s
    there = [_near(square, arena) for square in squares]
    norm = PowerNorm(0.5, 0.0, float(seconds.max()))
    cells = PolyCollection(
        list(squares[there]), array=seconds[there], norm=norm, linewidths=0, antialiased=False
    )
    cells.set_rasterized(True)
    axes.add_collection(cells, autolim=False)
    _solids(axes, gathered, arena, fill=False)
    figure.colorbar(
        cells, ax=axes, label="time [s]", ticks=MaxNLocator(4), fraction=0.06, pad=0.02, aspect=25
    )
    caption = (
        f"How long robots were in each square of {MAP_CELL_M * 100:.0f} cm in {findings.part}:"
        f" the sum over all robots of the time in which they were seen there. White: never."
        f" Colours follow the square root of the time, so that short stays show, too."
    )
    return Drawing("occupancy", "Occupancy", caption, figure)


def _map(arena: Arena, width_in: float, bar_in: float = 0.0) -> tuple[Figure, Axes]:
    """Axes in m that show the arena and nothing else, of limited height."""
    beside, below = _ROOM_IN[0] + bar_in, _ROOM_IN[1]
    aspect = arena.size_m[1] / arena.size_m[0]
    inside_in = min(width_in - beside, max(1.6 * (width_in - beside) / aspect, 0.6))
    figure = new_figure(inside_in + beside, inside_in * aspect + below)
    figure.set_layout_engine("compressed")
    axes = figure.subplots()
    axes.set_aspect("equal")
    half = np.array(arena.size_m[:2]) / 2.0
    low, high = np.array(arena.centre_m[:2]) - half, np.array(arena.centre_m[:2]) + half
    axes.set_autoscale_on(False)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(False)
    axes.spines[:].set_visible(True)
    return figure, axes


def _legend(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    shapes = dict(list(dict(zip(labels, handles)).items())[:_MOST_SHAPES])
    rows = -(-len(shapes) // _LEGEND_COLUMNS)
    width_in, height_in = figure.get_size_inches()
    figure.set_size_inches(width_in, height_in + _LEGEND_ROW_IN * rows + 0.1)
    columns = min(len(shapes), _LEGEND_COLUMNS)
    figure.legend(shapes.values(), shapes.keys(), loc="outside lower center", ncols=columns)


def _near(points_m: Floats, arena: Arena) -> bool:
    """Whether all points, (..., 2), are near enough to be drawn."""
    return float(np.abs(points_m - arena.centre_m[:2]).max()) < NEAR_SIZES * max(arena.size_m)


def _world(axes: Axes, gathered: Gatherer, arena: Arena) -> None:
    from matplotlib.patches import Polygon

    _floor(axes, gathered.world)
    for entity in entities(gathered.world):
        outline, colour = _outline(entity, arena), _rgb(entity.get("color"))
        if entity.get("kind") == "zone" and outline is not None and colour is not None:
            words = label(str(entity.get("id") or "zone")[:_MOST_LETTERS])
            axes.add_patch(Polygon(outline, color=_pale(colour), linewidth=0, label=words))
    _solids(axes, gathered, arena, fill=True)
    for first, last in (pair for pair in gathered.cones.values() if _near(np.array(pair), arena)):
        words = "polluted cone"
        axes.add_patch(Polygon(last, facecolor=_CONE, alpha=0.25, linewidth=0))
        axes.add_patch(Polygon(last, fill=False, edgecolor=_CONE, label=words))
        axes.plot(*last[0], "o", color=_CONE, fillstyle="none")
        if np.abs(np.array(first) - np.array(last)).max() > 0.1:
            words += " at the beginning"
            axes.add_patch(Polygon(first, fill=False, edgecolor=_CONE, ls="--", label=words))
    for entity in entities(gathered.world):
        _light_or_robot(axes, entity, arena, gathered.facts.body_radius_m)


def _solids(axes: Axes, gathered: Gatherer, arena: Arena, fill: bool) -> None:
    from matplotlib.patches import Polygon

    for entity in entities(gathered.world):
        outline = _outline(entity, arena)
        if outline is None or entity.get("kind") not in ("box", "cylinder"):
            continue
        physical = bool(entity.get("physical"))
        colour, words = ("0.45", "real obstacle") if physical else (_VIRTUAL, "virtual obstacle")
        if fill:
            axes.add_patch(Polygon(outline, facecolor=colour, alpha=0.4, linewidth=0))
        axes.add_patch(Polygon(outline, fill=False, edgecolor=colour, lw=0.8, label=words))


def _light_or_robot(axes: Axes, entity: Mapping[str, Any], arena: Arena, radius_m: float) -> None:
    """Draws a light, at the edge if it is outside of the arena, or a virtual robot."""
    at, kind = numbers(entity.get("position_m"), 2), entity.get("kind")
    pose = numbers([entity.get(name) for name in ("x_m", "y_m", "yaw_rad")], 3)
    if kind == "light" and at is not None:
        half, centre = np.array(arena.size_m[:2]) / 2.0, np.array(arena.centre_m[:2])
        place = np.clip(at, centre - half, centre + half)
        rgb = _rgb(entity.get("color"))
        colour = _LAMP if rgb in (None, _WHITE) else rgb
        style: dict[str, Any] = {"markersize": 10, "markeredgewidth": 0.6, "clip_on": False}
        axes.plot(*place, "*", color=colour, markeredgecolor="0.3", label="light", **style)
    elif kind == "robot" and pose is not None and _near(np.array(pose[:2]), arena):
        ahead = 2.1 * np.array([[0.0, 0.0], [np.cos(pose[2]), np.sin(pose[2])]])
        for shape, words in ((_ROUND, "virtual robot"), (ahead, "")):
            axes.plot(*(pose[:2] + radius_m * shape).T, color=_GHOST, label=words)


def _outline(entity: Mapping[str, Any], arena: Arena) -> Floats | None:
    """The outline of a box, a cylinder or a zone, (k, 2) arena frame; None: not to be drawn."""
    at = numbers(entity.get("position_m"), 2) or numbers([entity.get("x_m"), entity.get("y_m")], 2)
    radius, size = number(entity.get("radius_m")), numbers(entity.get("size_m"), 2)
    yaw_rad = number(entity.get("yaw_rad")) or 0.0
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    shape: Floats | None = None
    if entity.get("kind") == "cylinder" or entity.get("shape") == "circle":
        shape = None if radius is None else _ROUND * radius
    elif size is not None:
        shape = _CORNERS * size @ np.array([[cosine, sine], [-sine, cosine]])
    if at is None or shape is None or not _near(shape + at, arena):
        return None
    return np.asarray(shape + at)


def _rgb(value: Any) -> Any:
    """A recorded colour, red, green, blue 0..1; None: it is none."""
    levels = numbers(value, 3)
    return None if levels is None else tuple(np.clip(levels, 0.0, 255.0) / 255.0)


def _pale(colours: Any) -> Any:
    return 1.0 - FLOOR_SHARE * (1.0 - np.asarray(colours))


def _floor(axes: Axes, world: Mapping[str, Any]) -> None:
    data = world.get("floor")
    data = data if isinstance(data, dict) else {}
    colour = _rgb(data.get("color"))
    if colour not in (None, _WHITE):
        axes.set_facecolor(_pale(colour))
    try:
        size, middle = numbers(data.get("size_m"), 2), numbers(data.get("centre_m"), 2)
        image = floor_picture(base64.b64decode(data["png"]))
    except DAMAGED:
        return
    if size is None or min(size) <= 0.0:
        return
    step = -(-max(image.shape[:2]) // _FLOOR_PX)
    (x, y), (width, height) = middle or (0.0, 0.0), size
    extent = (x - width / 2, x + width / 2, y - height / 2, y + height / 2)
    pale = (255.0 * _pale(image[::step, ::step, :3] / np.float32(255.0))).astype(np.uint8)
    axes.imshow(pale, extent=extent, aspect="equal", interpolation="nearest")
