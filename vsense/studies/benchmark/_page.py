"""The report of a benchmark, and of two labs beside each other: one page with its figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from vsense.base.terminal import spoken
from vsense.studies.benchmark._comparing import ComparedLabs
from vsense.studies.report import Questions, _plot, lacking, lacking_tests
from vsense.studies.report._markup import DASH, Counter, document, figure_of, share_of, tiles, warn
from vsense.studies.report._plot import Drawing
from vsense.studies.report.report import REPORT_PAGE, Charts, charts_in, require_empty
from vsense.studies.report.study import _section
from vsense.studies.report.study._results import StudyResult

_ROW_IN, _FRAME_IN = 0.22, 0.6


def _latency_chart(stations: Mapping[str, Mapping[str, float]]) -> Drawing:
    names = list(stations)
    figure = _plot.new_figure(height_in=_FRAME_IN + _ROW_IN * max(len(names), 1))
    axes = figure.subplots()
    for place, name in enumerate(names):
        spread = stations[name]
        axes.plot([spread["p50"], spread["p99"]], [place] * 2, color="C0", linewidth=1.6)
        axes.plot([spread["p50"]], [place], color="C0", marker="o", markersize=4)
        axes.plot([spread["p99"]], [place], color="C0", marker="|", markersize=7)
    labels = [_plot.label(spoken(name.removesuffix("_ms"))) for name in names]
    axes.set_yticks(range(len(names)), labels)
    axes.set(ylim=(len(names) - 0.5, -0.5), xlabel="ms")
    plot_max = max((spread["p99"] for spread in stations.values()), default=1.0)
    axes.set_xlim(0.0, 1.05 * max(plot_max, 1e-3))
    axes.grid(False, axis="y")
    caption = "Dot: median of the runs' medians; bar: 99th percentile of the worst run."
    return Drawing("latency", "Latency", caption, figure)


def _wheels_chart(robots: Sequence[Mapping[str, Any]]) -> Drawing:
    figure = _plot.new_figure(_plot.width_of(True))
    panels = (
        ("way_over_told", "way over reported [%]", 100.0),
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
            _plot.from_zero(axes, values)
    caption = (
        "Each robot by its tag. Way over reported: 100 % is a nominal e-puck. Noise: standard"
        " deviation of what a timestep's motion differs from that of its wheels."
    )
    return Drawing("wheels", "Wheels, as the runs show them", caption, figure, wide=True)


REPORT_FOLDER = "report"
"""In the folder of the runs."""


def write(result: Mapping[str, Any], studies: Sequence[StudyResult], folder: Path) -> list[Path]:
    """Writes the report of a result and its figures, over those of before; gives the files.

    RecordingError where something cannot be written.
    """
    with charts_in(folder) as charts:
        counter, asked = Counter(), Questions(tests=not lacking_tests())
        told = [*result["deviations"], lacking(), lacking_tests()]
        parts = [warn(words) for words in told if words]
        parts += [_head(result), _latency(result, charts, counter)]
        parts += [_poses(result, counter), _wheels(result, charts, counter)]
        parts += [_missions(result, counter), *_studies(studies, charts, counter, asked)]
        title = f"{result['benchmark']}: {result['site']} ({result['mode']})"
        lead = (
            "What three fixed missions say of a lab. Medians of runs are of runs, percentiles of"
            f" latencies are of the worst run. Definition {result['definition_sha256']}."
        )
        return _finish(folder, document(title, lead, "".join(parts), "benchmark"), charts)


def write_comparison(comparison: ComparedLabs, folder: Path) -> list[Path]:
    """Writes the page of two labs into an empty folder; raises as `write`."""
    require_empty(folder)
    with charts_in(folder) as charts:
        counter = Counter()
        parts = _studies(comparison.studies, charts, counter, comparison.asked)
        caption = f"{DASH}: not known. What these are, the page of the benchmark says."
        rows = [list(row) for row in comparison.rows()]
        table = counter.table("Both labs", caption, ("", *comparison.names), rows)
        title = (
            f"{comparison.results[0]['benchmark']}: {comparison.names[0]} and {comparison.names[1]}"
        )
        lead = "Runs of two labs with the same missions, starts and seeds, and the labs themselves."
        return _finish(folder, document(title, lead, "".join([table, *parts]), "benchmark"), charts)


def _finish(folder: Path, text: str, charts: Charts) -> list[Path]:
    path = folder / REPORT_PAGE
    path.write_text(text, encoding="utf-8", errors="replace")
    return [path, *charts.files]


def _head(result: Mapping[str, Any]) -> str:
    counts, truth = result["counts"], result["accuracy"]["truth"] or {}
    stations = (result["latency"] or {}).get("stations", {})
    values = [
        ("runs", f"{counts['valid']} valid, {counts['void']} invalid"),
        ("robots", str(result["robots"])),
        ("late timesteps", _share((result["latency"] or {}).get("late_share_mean"))),
        ("exposure to sent", _with(stations.get("capture_to_sent_ms", {}).get("p50"), "ms")),
        ("poses, rms", _with(truth.get("position_rms_mm"), "mm")),
        ("made", str(result["made"])[:10]),
    ]
    setup = ", ".join(f"{name} {value}" for name, value in result["setup"].items())
    words = f"{setup}. " if setup else ""
    return tiles(values) + (
        f'<p class="soft">{escape(words)}Software: {escape(", ".join(result["versions"]))}.</p>\n'
    )


def _latency(result: Mapping[str, Any], charts: Charts, counter: Counter) -> str:
    title = "<h2 class=first>Latency</h2>\n"
    latency = result["latency"]
    if latency is None:
        return f"{title}<p>A simulation has its own time: nothing is late.</p>\n"
    rows = [
        [spoken(name.removesuffix("_ms")), *(figure_of(spread[key]) for key in _SPREAD)]
        for name, spread in latency["stations"].items()
    ]
    caption = (
        "From the middle of the exposure, or from where the name says. Median: of the runs'"
        " medians; 99 % and greatest: of the worst run."
    )
    heads = ("", "median [ms]", "99 % [ms]", "greatest [ms]")
    late = _share(latency["late_share_mean"]), _share(latency["late_share_worst"])
    figures = counter.figures(charts.keep("", [_latency_chart(latency["stations"])]))
    return (
        f"{title}{figures if charts.form else ''}"
        f"{counter.table('Latency', caption, heads, rows)}"
        f"<p>Timesteps late or left out: {late[0]} of all, {late[1]} in the worst run.</p>\n"
    )


_SPREAD = ("p50", "p99", "max")
_SHARES = ("way_over_told", "right_over_left", "axle_over_nominal")


def _poses(result: Mapping[str, Any], counter: Counter) -> str:
    accuracy = result["accuracy"]
    truth, calibration = accuracy["truth"], accuracy["calibration"]
    words = [f"Robots seen in a timestep: {_share(accuracy['seen_share'])}."]
    if truth is not None:
        words.append(
            f"Against the truth of the lab: {_with(truth['position_rms_mm'], 'mm')} and"
            f" {_with(truth['heading_rms_deg'], 'degrees')} rms, {truth['wrong_ids']} wrong names."
        )
    checks = (calibration or {}).get("checks") or []
    if checks:
        last = checks[-1]
        words.append(
            f"Calibration checked ({last['when']}) at {last['points']} points:"
            f" {_with(last['rms_mm'], 'mm')} rms, {_with(last['worst_mm'], 'mm')} at worst."
        )
    elif result["mode"] == "run":
        words.append("The calibration was never checked: how true poses are is not known.")
    standing = [
        [row["what"], figure_of(row["sigma"]), row["unit"] or DASH, str(row["samples"])]
        for row in result["noise"]["standing"]
    ]
    caption = (
        "Standard deviation from one timestep to the next, of poses and of virtual sensors'"
        " readings of robots that stand alone."
    )
    table = counter.table(
        "Noise", caption, ("of", "sigma", "unit", "numbers"), standing, texts=(0, 2)
    )
    return f"<h2>Poses and readings</h2>\n<p>{escape(' '.join(words))}</p>\n{table}"


def _wheels(result: Mapping[str, Any], charts: Charts, counter: Counter) -> str:
    robots, roster = result["noise"]["robots"], result["noise"]["roster"]
    rows = [
        [
            str(robot["tag"]),
            *(DASH if robot[name] is None else f"{robot[name]:.4f}" for name in _SHARES),
            *(figure_of(robot[name]) for name in ("forward_noise_mm", "turn_noise_deg")),
            str(robot["steps"]),
            ", ".join(f"{n} {v}" for n, v in roster.get(str(robot["tag"]), {}).items()) or DASH,
        ]
        for robot in robots
    ]
    if not rows:
        return "<h2>Wheels</h2>\n<p>Too little is known of how robots drove.</p>\n"
    heads = (
        "robot", "way over reported", "right over left", "axle over nominal", "noise of way [mm]",
        "noise of turn [deg]", "timesteps", "measured before",
    )  # fmt: skip
    caption = (
        "By least squares on what robots reported of their wheels and where cameras saw them, from"
        " one timestep to the next; noise: what is left over in a timestep. Measured before: by"
        " vsense robot calibrate, in the roster; robots correct their wheels by it."
    )
    figures = counter.figures(charts.keep("", [_wheels_chart(robots)])) if charts.form else ""
    return f"<h2>Wheels</h2>\n{figures}{counter.table('Wheels', caption, heads, rows, texts=(7,))}"


def _missions(result: Mapping[str, Any], counter: Counter) -> str:
    rows = [
        [
            *(mission["mission"], spoken(mission["measure"]), mission["unit"], mission["better"]),
            *(figure_of(mission[arm]["median"]) for arm in ("sighted", "blind")),
            share_of(mission["sighted_better"]),
            figure_of(mission["shift"]),
            figure_of(mission["margin"]),
        ]
        for mission in result["missions"]
    ]
    heads = (
        "mission", "score", "unit", "better is", "with sensors, median", "without, median",
        "with sensors is better [%]", "shift", "margin",
    )  # fmt: skip
    caption = (
        "A run gives one score. With sensors is better: in how many of all pairs of a run with"
        " and one without, ties counted half. Margin: two labs whose means differ by less are the"
        " same."
    )
    return f"<h2>Missions</h2>\n{counter.table('Scores', caption, heads, rows, texts=(0, 1, 2, 3))}"


def _studies(
    studies: Sequence[StudyResult], charts: Charts, counter: Counter, asked: Questions
) -> list[str]:
    parts = []
    for place, result in enumerate(studies):
        pictures = charts.keep("", _section.boxes(result, f"{place + 1}-"))
        parts.append(_section.section(result, pictures, counter, place + 1, asked.tests))
    return [*parts, _section.methods(studies, asked)]


def _with(value: float | None, unit: str) -> str:
    return DASH if value is None else f"{figure_of(value)} {unit}"


def _share(value: float | None) -> str:
    return DASH if value is None else f"{share_of(value)} %"
