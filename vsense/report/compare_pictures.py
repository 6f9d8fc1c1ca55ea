"""The pictures of several runs: each measure over time, and where it ended."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from vsense.pictures.canvas import INK, Canvas, Colour, width_of
from vsense.report.compare import Group, curve, measure_names, statistics
from vsense.report.picture import MOST_MEASURES, RUN_TIME, Figure, plain
from vsense.report.plot import BLUE, COLOURS, HALF_PX, ORANGE, SMALL, Plot, Range, spanning

_HEIGHT_PX = 320
_PALE = 0.35
_CONDITIONS = {"sighted": BLUE, "blind": ORANGE}


def draw(members: Sequence[Group]) -> Iterator[Figure]:
    """Draws the groups of one experiment: two pictures for each measure."""
    for place, name in enumerate(measure_names(members)[:MOST_MEASURES], start=1):
        file = f"{place:02d}-{_file(name)}"
        yield _over_time(members, name, file)
        yield _ends(members, name, f"{file}-end")


def _colour(group: Group) -> Colour:
    return _CONDITIONS.get(group.condition, COLOURS[2])


def _pale(colour: Colour) -> Colour:
    blue, green, red = (round(255 - _PALE * (255 - part)) for part in colour)
    return blue, green, red


def _file(name: str) -> str:
    """A name as files may have it."""
    return re.sub(r"[^A-Za-z0-9_]+", "-", name)[:40].strip("-")


def _over_time(members: Sequence[Group], name: str, file: str) -> Figure:
    series = {
        id(run): run.found.measures.of[name]
        for group in members
        for run in group.runs
        if name in run.found.measures.of
    }
    curves = [(group, curve(group, name)) for group in members]
    tops = [value for _, values in series.values() for value in (min(values), max(values))]
    tops += [v for _, c in curves if c is not None for v in (c.mean + c.spread).tolist()]
    end_s = max(times[-1] for times, _ in series.values())
    canvas = Canvas(HALF_PX, _HEIGHT_PX)
    plot = Plot(canvas, Range(0.0, max(end_s, 1e-3), RUN_TIME), spanning(tops, plain(name)))
    for group, found in curves:
        if found is not None and len(group.runs) > 1:
            low, high = found.mean - found.spread, found.mean + found.spread
            plot.band(found.time_s, low, high, _colour(group))
    for group in members:
        for run in group.runs:
            if id(run) in series:
                times, values = series[id(run)]
                plot.line(times, values, _pale(_colour(group)), 1.0, steps=True)
    for group, found in curves:
        if found is not None:
            plot.line(found.time_s, found.mean, _colour(group), 2.5, steps=True)
    plot.legend([(f"{g.condition} (n = {len(g.runs)})", _colour(g)) for g in members])
    caption = (
        f"{len(series)} runs of {members[0].experiment}. Thin: single runs; thick: their mean;"
        " band: mean ± one standard deviation of the runs. Both end with the shortest run of a"
        " condition."
    )
    title = f"{plain(name)} over time"
    return Figure(file, canvas.image, title.capitalize(), caption, False)


def _ends(members: Sequence[Group], name: str, file: str) -> Figure:
    columns = [
        (group, [run.measures[name]["end"] for run in group.runs if name in run.measures])
        for group in members
    ]
    columns = [(group, values) for group, values in columns if values]
    canvas = Canvas(HALF_PX, _HEIGHT_PX)
    spans = [statistics(values) for _, values in columns]
    every = [value for _, values in columns for value in values]
    every += [s.mean + sign * (s.spread or 0.0) for s in spans for sign in (-1.0, 1.0)]
    x = Range(0.5, len(columns) + 0.5, "", bare=True)
    plot = Plot(canvas, x, spanning(every, f"{plain(name)}, at the end"))
    for place, ((group, values), found) in enumerate(zip(columns, spans), start=1):
        colour, spread = _colour(group), found.spread or 0.0
        offsets = 0.16 * (np.arange(len(values)) / max(len(values) - 1, 1) - 0.5)
        for at in plot.at(place - 0.12 + offsets, values):
            canvas.dot(at, 4.0, colour)
        upright = plot.at([place + 0.12] * 2, [found.mean - spread, found.mean + spread])
        canvas.lines(upright, INK, 1.5)
        canvas.lines(plot.at([place + 0.07, place + 0.17], [found.mean] * 2), INK, 3.0)
        words = f"{group.condition} (n = {len(values)})"
        middle = float(plot.at(place, 0.0)[0])
        canvas.text(words, middle - width_of(words, SMALL) / 2, plot.bottom + 20, INK, SMALL)
    caption = (
        f"A dot for each run of {members[0].experiment}: the last value. Lines: mean ± one standard"
        " deviation of the runs."
    )
    title = f"{plain(name)} at the end"
    return Figure(file, canvas.image, title.capitalize(), caption, False)
