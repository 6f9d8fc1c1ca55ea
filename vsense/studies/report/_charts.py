"""The charts of reports: a run's measures, robots and latencies over time, and runs compared."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vsense.base.arena import Floats
from vsense.base.terminal import spoken
from vsense.monitor import recording
from vsense.studies.report import _plot
from vsense.studies.report._compare import Group, curve, measure_names
from vsense.studies.report._findings import Findings
from vsense.studies.report._flow import FINE, LOST, STOPPED, UNSEEN
from vsense.studies.report._plot import Drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RUN_TIME = "time since the run began [s]"
MOST_MEASURES = 12
"""Measures of one experiment that are drawn."""
_STATES: dict[int, tuple[str, str]] = {
    FINE: ("seen and connected", "#BFD9EC"),
    STOPPED: ("stopped", "#CC79A7"),
    UNSEEN: ("not seen for 1 s", "#E69F00"),
    LOST: ("no link", "#D55E00"),
}
_GAP = "0.85"
_BINS = 60
_ABOVE: dict[str, Any] = {
    "loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2, "ncols": 4,
    "borderpad": 0.2,
}  # fmt: skip
"""Place of a legend: above its axes."""
_CONDITIONS = {"sighted": ("C0", "-"), "blind": ("C1", "--")}


def measures(findings: Findings) -> Drawing | None:
    """All measures of the experiment, one chart below the other."""
    series = dict(list(findings.gathered.measures.items())[:MOST_MEASURES])
    if not series:
        return None
    usual = _plot.setting("figure.figsize")[1]
    figure = _plot.new_figure(height_in=max(usual, 0.65 * usual * len(series)))
    rows = figure.subplots(len(series), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, (times, values)) in zip(rows, series.items()):
        _gaps(axes, findings)
        _plot.steps(axes, times, values, "C0", clip_on=False, zorder=3)
        _plot.from_zero(axes, values)
        axes.set_ylabel(textwrap.fill(_plot.measure_label(name), 18))
    first = min(0.0, *(times[0] for times, _ in series.values()))
    last = max(findings.run_s, *(times[-1] for times, _ in series.values()))
    rows[-1].set_xlim(first, max(last, first + 1e-3))
    rows[-1].set_xlabel(RUN_TIME)
    figure.align_ylabels()
    caption = f"What the experiment measured in {findings.part}, a value for each timestep"
    if findings.gathered.cones and recording.IN_CONE in series:
        caption += (
            ". The report itself counted the robots in the cone, and those of them whose red LEDs"
            " were on, from tracked poses, the cone, and telemetry, where the experiment did not"
        )
    return Drawing("measures", "Measures", caption + ".", figure)


def _gaps(axes: Axes, findings: Findings) -> None:
    """Tints the times in which nothing is known; neighbours together."""
    spans: list[tuple[float, float]] = []
    near_s = findings.run_s / _plot.MOST_PLACES
    for gap in findings.incidents:
        if gap.kind in ("not recorded", "silence"):
            begin_s, end_s = (gap.from_s, findings.run_s if gap.to_s is None else gap.to_s)
            if spans and begin_s - sum(spans[-1]) < near_s:
                begin_s, end_s = spans[-1][0], max(end_s, sum(spans.pop()))
            spans.append((begin_s, max(end_s - begin_s, 0.0)))
    upright = axes.get_xaxis_transform()
    axes.broken_barh(spans, (0.0, 1.0), transform=upright, color=_GAP, linewidth=0.8, zorder=0.5)


def robots(findings: Findings) -> Drawing | None:
    """How many robots were seen and connected, and below each robot's state."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    strips = findings.gathered.strips
    tags, table = strips.table()
    if not table.size or not findings.gathered.flow.lived or findings.gathered.facts.simulated:
        return None
    height = min(max(0.14 * len(tags), 0.5), 5.5)
    figure = _plot.new_figure(_plot.width_of(wide=True), height + 2.4)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.3, height))
    _counts(findings, above, len(findings.gathered.facts.robots) or len(tags))
    strip_s = strips.bin_ns / 1e9
    begin_s = ((strips.begin_ns or 0) - findings.zero_ns) / 1e9
    extent = (begin_s, begin_s + strip_s * table.shape[1], len(tags) - 0.5, -0.5)
    colours = ListedColormap(["none", *(colour for _, colour in _STATES.values())])
    # In colours already: Matplotlib would scale numbers in floats, at 20 times the memory.
    below.imshow(colours(table, bytes=True), aspect="auto", interpolation="nearest", extent=extent)
    paper = _plot.setting("axes.facecolor")
    below.hlines(np.arange(len(tags)) + 0.5, *extent[:2], paper, linewidth=0.8)
    below.grid(False)
    every = -(-len(tags) // max(round(height / 0.13), 1))
    below.set_yticks(range(0, len(tags), every), [str(tag) for tag in tags[::every]])
    below.tick_params("y", length=0)
    below.set_ylabel("robot (tag)")
    below.set_xlim(0.0, max(findings.run_s, 1e-3))
    below.set_xlabel(RUN_TIME)
    there = [state for code, state in _STATES.items() if code == FINE or (table == code).any()]
    below.legend(handles=[Patch(color=colour, label=words) for words, colour in there], **_ABOVE)
    figure.align_ylabels()
    caption = (
        f"Above: how many robots were seen by the cameras and connected in {findings.part};"
        " grey: nothing was recorded, or no arena state came. Below: how each robot was, by tag,"
        f" the worst in each {strip_s:g} s. Not seen: for more than 1 s. Stopped: its wheels were"
        " held without an order."
    )
    return Drawing("robots", "Robots seen and connected", caption, figure, wide=True)


def _counts(findings: Findings, axes: Axes, count: int) -> None:
    from matplotlib.ticker import MaxNLocator

    flow = findings.gathered.flow
    _gaps(axes, findings)
    times = findings.times_s(flow.time_ns)
    seen, connected = np.array(flow.seen), np.array(flow.connected)
    valid = connected >= 0
    axes.axhline(count, color="0.5", linestyle=":", linewidth=0.8, label=f"all {count}")
    if valid.any():
        _plot.steps(axes, times[valid], connected[valid], "C2", linewidth=3, label="connected")
    _plot.steps(axes, times, seen, "C0", linewidth=1, label="seen")
    _plot.from_zero(axes, [count, *seen.tolist()])
    axes.set_ylabel("robots")
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    axes.legend(**_ABOVE)


def latencies(findings: Findings) -> Drawing | None:
    """The distribution of the latencies."""
    values = np.array(findings.gathered.latency_ms)
    values = values[values > 0.0]
    if not len(values):
        return None
    low, high = float(values.min()) / 1.05, float(values.max()) * 1.05
    edges = np.geomspace(low, max(high, low * 1.5), _BINS + 1)
    shares = np.histogram(values, edges)[0] / len(values) * 100.0
    figure = _plot.new_figure()
    axes = figure.subplots()
    axes.stairs(shares, edges, fill=True, color="C0")
    ink = _plot.setting("text.color")
    percentiles = (("p50", "median", "-"), ("p95", "95 %", "--"), ("p99", "99 %", ":"))
    for name, words, dashes in percentiles:
        ms = findings.latency[f"{name}_ms"]
        words = _plot.label(f"{words}: {ms:.3g}")
        axes.axvline(ms, color=ink, linestyle=dashes, linewidth=1, label=words)
    _logarithmic(axes, float(edges[0]), float(edges[-1]))
    axes.set_xlabel("latency, capture to sent [ms]")
    axes.set_ylabel(_plot.label("share of timesteps [%]"))
    axes.legend(**_ABOVE)
    caption = (
        f"Distribution of the latency over {len(values)} timesteps: from the middle of the"
        " cameras' exposure to the moment when the readings made from it were sent to the robots."
        " Logarithmic axis; lines: median, 95th and 99th percentile."
    )
    return Drawing("latency", "Latency", caption, figure)


def _logarithmic(axes: Axes, low: float, high: float) -> None:
    """Makes the axis below logarithmic, with few and plain numbers."""
    from matplotlib import ticker

    axes.set_xscale("log")
    axes.set_xlim(low, high)
    decades = np.log10(high / low)
    factors = (1.0, 2.0, 5.0) if decades < 3.0 else (1.0,)
    locator = ticker.MaxNLocator(5) if decades < 0.7 else ticker.LogLocator(subs=factors)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ticker.FormatStrFormatter("%g"))
    axes.xaxis.set_minor_formatter(ticker.NullFormatter())


def latency_over_time(findings: Findings) -> Drawing | None:
    """The latency over time: its median and its range in equal pieces of the run."""
    gathered = findings.gathered
    values = np.array(gathered.latency_ms)
    times = findings.times_s(gathered.latency_ns)
    if not len(values):
        return None
    timestep_ms = gathered.facts.timestep_s * 1e3
    end_s = max(findings.run_s, float(times.max()), 1e-3)
    piece_s = max(end_s / 150.0, 2.0 * gathered.facts.timestep_s)
    middles, low, middle, high = _grouped(times, values, piece_s)
    figure = _plot.new_figure()
    axes = figure.subplots()
    _gaps(axes, findings)
    axes.axhline(timestep_ms, color="0.5", linestyle=":", linewidth=0.8, label="one timestep")
    axes.fill_between(middles, low, high, color="C0", alpha=0.25, linewidth=0, label="range")
    axes.plot(middles, middle, "C0", label="median")
    _plot.from_zero(axes, [timestep_ms, *low, *high])
    axes.set_xlim(0.0, end_s)
    axes.set_xlabel(RUN_TIME)
    axes.set_ylabel("latency [ms]")
    axes.legend(**_ABOVE)
    caption = (
        f"Latency over time: median (line) and range (band) in pieces of {piece_s:.3g} s."
        " Readings above one timestep left after the next picture was taken."
    )
    return Drawing("latency-over-time", "Latency over time", caption, figure)


def _grouped(times: Floats, values: Floats, piece_s: float) -> tuple[Floats, ...]:
    """Middles, least, median and greatest of the values in each piece of time that has some."""
    order = np.argsort(times, kind="stable")
    times, values = times[order], values[order]
    places = np.floor(times / piece_s)
    starts = np.flatnonzero(np.diff(places, prepend=np.nan) != 0.0)
    parts: Sequence[Floats] = np.split(values, starts[1:])
    middles = (places[starts] + 0.5) * piece_s
    columns = np.array([(part.min(), np.median(part), part.max()) for part in parts])
    return middles, *columns.T


def compared(members: Sequence[Group]) -> Iterator[Drawing]:
    """Draws the groups of one experiment: two charts for each measure, one where no run was
    recorded."""
    for place, name in enumerate(measure_names(members)[:MOST_MEASURES], start=1):
        file = f"{place:02d}-{_plot.file_words(name)}"
        if any(name in run.gathered.measures for group in members for run in group.runs):
            yield _over_time(members, name, file)
        yield _ends(members, name, f"{file}-end")


def _styles(members: Sequence[Group]) -> Iterator[tuple[Group, str, str]]:
    for place, group in enumerate(members):
        usual = f"C{place % 6}", "--" if group.blind else "-"
        yield group, *_CONDITIONS.get(group.condition, usual)


def _over_time(members: Sequence[Group], name: str, file: str) -> Drawing:
    figure = _plot.new_figure()
    axes = figure.subplots()
    count, end_s, limits = 0, 1e-3, [0.0]
    for group, colour, dashes in _styles(members):
        for run in (run for run in group.runs if name in run.gathered.measures):
            times, values = run.gathered.measures[name]
            _plot.steps(axes, times, values, colour, linewidth=0.5, alpha=0.4)
            count, end_s = count + 1, max(end_s, times[-1])
            limits += [min(values), max(values)]
        mean = curve(group, name)
        if mean is None:
            continue
        low, high = mean.mean - mean.spread, mean.mean + mean.spread
        if len(group.runs) > 1:
            axes.fill_between(mean.time_s, low, high, step="post", color=colour, alpha=0.2, lw=0)
            limits += [float(low.min()), float(high.max())]
        words = _plot.label(f"{group.condition} (n = {len(group.runs)})")
        _plot.steps(
            axes, mean.time_s, mean.mean, colour, linewidth=1.6, linestyle=dashes, label=words
        )
    _plot.from_zero(axes, limits)
    axes.set_xlim(0.0, end_s)
    axes.set_xlabel(RUN_TIME)
    axes.set_ylabel(textwrap.fill(_plot.measure_label(name), 26))
    axes.legend(**{**_ABOVE, "ncols": 4 if len(members) < 3 else 1})
    caption = (
        f"{count} runs of {members[0].experiment}. Thin: single runs; thick: their mean;"
        " band: mean ± one standard deviation of the runs. Both end with the shortest run of a"
        f" condition.{few(members)}"
    )
    return Drawing(file, f"{spoken(name)} over time".capitalize(), caption, figure)


def few(members: Sequence[Group]) -> str:
    """What is to be said of groups that have one run only; "" where there are none."""
    single = [group.condition for group in members if group.count == 1]
    if not single:
        return ""
    return f" Of one run there is no spread, and none is drawn: {', '.join(single)}."


def _ends(members: Sequence[Group], name: str, file: str) -> Drawing:
    shown = [(group, colour) for group, colour, _ in _styles(members) if group.ends(name)]
    groups = [(group.condition, group.ends(name)) for group, _ in shown]
    figure = _plot.runs_figure(name, groups, 26, [colour for _, colour in shown])
    caption = f"The last value of the runs of {members[0].experiment}; {_plot.RUNS_LEGEND}."
    return Drawing(file, f"{spoken(name)} at the end".capitalize(), caption, figure)
