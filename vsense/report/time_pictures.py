"""The pictures of what happened over time: measures, the robots' health, latency."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.pictures.canvas import INK, SCALE, Canvas, Colour, Floats, width_of
from vsense.report.findings import Findings
from vsense.report.gather import IN_CONE
from vsense.report.health import FINE, LOST, STOPPED, UNKNOWN, UNSEEN
from vsense.report.picture import MOST_MEASURES, RUN_TIME, Figure, part, plain
from vsense.report.plot import (  # fmt: skip
    AMBER,
    BLUE,
    GREEN,
    GREY,
    HALF_PX,
    ORANGE,
    PINK,
    SMALL,
    TEXT,
    WIDE_PX,
    Plot,
    Range,
    spanning,
)

_CHART_PX = 150
_STATES: dict[int, tuple[str, Colour]] = {
    FINE: ("seen and connected", (236, 212, 178)),
    STOPPED: ("stopped", PINK),
    UNSEEN: ("not seen for 1 s", AMBER),
    LOST: ("no link", ORANGE),
}
_BINS = 60


def measures(findings: Findings) -> Figure | None:
    """Everything that the experiment measured, one chart below the other."""
    series = dict(list(findings.found.measures.of.items())[:MOST_MEASURES])
    if not series:
        return None
    each = max(190, 370 // len(series))
    canvas = Canvas(HALF_PX, each * len(series))
    for place, (name, (times, values)) in enumerate(series.items()):
        x = Range(min(0.0, times[0]), max(findings.run_s, times[-1], 1e-3), RUN_TIME)
        frame = (54, each * place + 34, HALF_PX - 16, each * (place + 1) - 50)
        plot = Plot(canvas, x, spanning(values, plain(name)), frame)
        shade_gaps(plot, findings)
        plot.line(times, values, BLUE, 2.0, steps=True)
    caption = f"What the experiment measured in {part(findings)}, a value for each timestep"
    if findings.found.cones and IN_CONE in series:
        caption += (
            ". The report itself counted the robots in the cone, and those of them whose red LEDs"
            " were lit, from tracked poses, the cone, and telemetry, where the experiment did not"
        )
    return Figure("measures", canvas.image, "Measures", caption + ".", False)


def shade_gaps(plot: Plot, findings: Findings) -> None:
    """Tints the times in which nothing is known."""
    for one in findings.amiss:
        if one.kind in ("not recorded", "silence"):
            plot.shade(one.from_s, plot.x.high if one.to_s is None else one.to_s, GREY)


def robots(findings: Findings) -> Figure | None:
    """How many robots were seen and connected, and below how each of them was."""
    found = findings.found
    tags, table = found.strips.table()
    if not table.size or not found.flow.lived:
        return None
    row = min(18.0, max(700.0 / len(tags), 5.0))
    below = 34 + _CHART_PX + 72
    canvas = Canvas(WIDE_PX, round(below + row * len(tags) + 50))
    end_s = max(findings.run_s, 1e-3)
    _counts(findings, canvas, end_s, len(found.facts.robots) or len(tags))
    strip_s = found.strips.bin_ns / 1e9
    begin_s = ((found.strips.begin_ns or 0) - findings.zero_ns) / 1e9
    frame = (110.0, float(below), WIDE_PX - 16.0, below + row * len(tags))
    plot = Plot(canvas, Range(0.0, end_s, RUN_TIME), Range(0.0, 1.0, "", bare=True), frame)
    _strips(plot, table, begin_s, strip_s)
    step = -(-14 // round(row))
    for place in range(0, len(tags), step):
        words = str(tags[place])
        y = below + row * (place + 0.5) + 5
        canvas.text(words, 100 - width_of(words, SMALL), y, INK, SMALL)
    canvas.text(f"{len(tags)} robots, a row each", 110, below - 12, INK, TEXT)
    plot.legend([state for code, state in _STATES.items() if code == FINE or (table == code).any()])
    caption = (
        f"Above: how many robots were seen by the cameras and connected in {part(findings)};"
        " grey: nothing was recorded, or no arena state came. Below: how each robot was, by tag,"
        f" the worst in each {strip_s:g} s. Not seen: for more than 1 s. Stopped: its wheels were"
        " held and nobody wanted that."
    )
    return Figure("robots", canvas.image, "Robots seen and connected", caption, True)


def _counts(findings: Findings, canvas: Canvas, end_s: float, count: int) -> None:
    flow = findings.found.flow
    frame = (110.0, 34.0, WIDE_PX - 16.0, 34.0 + _CHART_PX)
    plot = Plot(canvas, Range(0.0, end_s, ""), Range(0.0, 1.12 * count, "robots"), frame)
    shade_gaps(plot, findings)
    plot.level(count, f"all {count}")
    times = findings.times_s(flow.time_ns)
    seen, connected = np.array(flow.seen), np.array(flow.connected)
    told = connected >= 0
    names = [("seen", BLUE)]
    if told.any():
        names.append(("connected", GREEN))
        plot.line(times[told], connected[told], GREEN, 4.0, steps=True)
    plot.line(times, seen, BLUE, 1.5, steps=True)
    plot.legend(names)


def _strips(plot: Plot, table: NDArray[np.uint8], begin_s: float, strip_s: float) -> None:
    """Draws a row for each robot, a column for each time."""
    edges = plot.at(begin_s + strip_s * np.arange(table.shape[1] + 1), 0.0)[:, 0]
    edges = np.clip(edges, plot.left, plot.right)
    colours = np.full((LOST + 1, 3), 255, np.uint8)
    for code, (_, colour) in _STATES.items():
        colours[code] = colour
    image = plot.canvas.image
    row = (plot.bottom - plot.top) / len(table)
    for place, states in enumerate(table):
        top = round((plot.top + row * place + 1.0) * SCALE)
        bottom = round((plot.top + row * (place + 1) - 1.0) * SCALE)
        for left, right, state in zip(edges[:-1], edges[1:], states):
            if state != UNKNOWN:
                columns = slice(round(left * SCALE), round(right * SCALE))
                image[top:bottom, columns] = colours[state]


def latencies(findings: Findings) -> Figure | None:
    """How the latencies are distributed."""
    values = np.array(findings.found.latencies.latency_ms)
    values = values[values > 0.0]
    stats = findings.latency
    if not len(values):
        return None
    low, high = float(values.min()) / 1.05, float(values.max()) * 1.05
    edges = np.geomspace(low, max(high, low * 1.5), _BINS + 1)
    shares = np.histogram(values, edges)[0] / len(values) * 100.0
    canvas = Canvas(HALF_PX, 300)
    x = Range(float(edges[0]), float(edges[-1]), "latency, capture to sent [ms]", log=True)
    y = Range(0.0, 1.25 * float(shares.max()), "share of timesteps [%]")
    plot = Plot(canvas, x, y)
    plot.bars(edges, shares, BLUE)
    marks = [(stats[f"{name}_ms"], words) for name, words in _PLAIN.items()]
    plot.marks([(ms, f"{words}: {ms:.3g} ms") for ms, words in marks], INK)
    caption = (
        f"Distribution of the latency over {len(values)} timesteps: from the middle of the"
        " cameras' exposure to the moment when the readings made from it were sent to the robots."
        " Logarithmic axis; lines: median, 95th and 99th percentile."
    )
    return Figure("latency", canvas.image, "Latency", caption, False)


_PLAIN = {"p50": "median", "p95": "95 %", "p99": "99 %"}


def latency_over_time(findings: Findings) -> Figure | None:
    """How the latency went: its median and its range in equal pieces of the run."""
    found = findings.found
    values = np.array(found.latencies.latency_ms)
    times = findings.times_s(found.latencies.time_ns)
    if not len(values):
        return None
    end_s = max(findings.run_s, float(times.max()), 1e-3)
    piece_s = max(end_s / 150.0, 2.0 * found.facts.timestep_s)
    groups = _grouped(times, values, piece_s)
    canvas = Canvas(HALF_PX, 300)
    middles, low, middle, high = groups
    y = spanning([*high, found.facts.timestep_s * 1e3], "latency [ms]")
    plot = Plot(canvas, Range(0.0, end_s, RUN_TIME), y)
    shade_gaps(plot, findings)
    plot.band(middles, low, high, BLUE)
    plot.line(middles, middle, BLUE, 1.5)
    plot.level(found.facts.timestep_s * 1e3, "one timestep")
    caption = (
        f"Latency over time: median (line) and range (band) in pieces of {piece_s:.3g} s."
        " Readings above one timestep left after the next picture was taken."
    )
    return Figure("latency-over-time", canvas.image, "Latency over time", caption, False)


def _grouped(times: Floats, values: Floats, piece_s: float) -> tuple[Floats, ...]:
    """Middles, least, median and greatest of the values in each piece of time that has some."""
    order = np.argsort(times, kind="stable")
    times, values = times[order], values[order]
    places = np.floor(times / piece_s)
    starts = np.flatnonzero(np.diff(places, prepend=np.nan) != 0.0)
    parts: Sequence[Floats] = np.split(values, starts[1:])
    middles = (places[starts] + 0.5) * piece_s
    columns = ([part.min() for part in parts], [np.median(part) for part in parts])
    return middles, np.array(columns[0]), np.array(columns[1]), np.array([p.max() for p in parts])
