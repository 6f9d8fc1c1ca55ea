"""Figures of a benchmark's report: how late a lab is, and what each robot's wheels do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vsense.monitor.pictures.run_figure import spoken
from vsense.studies.report import plot
from vsense.studies.report.plot import Drawing

_ROW_IN, _FRAME_IN = 0.22, 0.6


def latencies(stations: Mapping[str, Mapping[str, float]]) -> Drawing:
    """Each station's median and 99th percentile."""
    names = list(stations)
    figure = plot.new_figure(height_in=_FRAME_IN + _ROW_IN * max(len(names), 1))
    axes = figure.subplots()
    for place, name in enumerate(names):
        spread = stations[name]
        axes.plot([spread["p50"], spread["p99"]], [place] * 2, color="C0", linewidth=1.6)
        axes.plot([spread["p50"]], [place], color="C0", marker="o", markersize=4)
        axes.plot([spread["p99"]], [place], color="C0", marker="|", markersize=7)
    labels = [plot.label(spoken(name.removesuffix("_ms"))) for name in names]
    axes.set_yticks(range(len(names)), labels)
    axes.set(ylim=(len(names) - 0.5, -0.5), xlabel="ms")
    plot_max = max((spread["p99"] for spread in stations.values()), default=1.0)
    axes.set_xlim(0.0, 1.05 * max(plot_max, 1e-3))
    axes.grid(False, axis="y")
    caption = "Dot: median of the runs' medians; bar: 99th percentile of the worst run."
    return Drawing("latency", "Latency", caption, figure)


def wheels(robots: Sequence[Mapping[str, Any]]) -> Drawing:
    """What each robot's wheels make of what they are told, and the noise of its way and turn."""
    figure = plot.new_figure(plot.width_of(True))
    panels = (
        ("way_over_told", "way over told [%]", 100.0),
        ("forward_noise_mm", "noise of way in a timestep [mm]", 1.0),
        ("turn_noise_deg", "noise of turn in a timestep [deg]", 1.0),
    )
    places = range(len(robots))
    for number, (axes, (name, words, factor)) in enumerate(zip(figure.subplots(1, 3), panels)):
        values = [factor * robot[name] for robot in robots]
        axes.plot(places, values, linestyle="none", marker="o", markersize=3.2, color=f"C{number}")
        axes.set(ylabel=words, xlim=(-0.6, len(robots) - 0.4))
        axes.set_xticks(places, [str(robot["tag"]) for robot in robots], rotation=90)
        axes.grid(False, axis="x")
        if number == 0:
            low, high = min(*values, 100.0), max(*values, 100.0)
            room = max(0.15 * (high - low), 0.5)
            axes.set_ylim(low - room, high + room)
            axes.axhline(100.0, color="0.6", linewidth=0.8)
        else:
            plot.from_zero(axes, values)
    caption = (
        "Each robot by its tag. Way over told: 100 % is a nominal e-puck. Noise: standard deviation"
        " of what a timestep's motion differs from that of its wheels."
    )
    return Drawing("wheels", "Wheels, as the runs show them", caption, figure, wide=True)
