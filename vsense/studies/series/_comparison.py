"""The picture of a campaign: one panel per measure, one row per setting, drawn as reports do."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from vsense.studies.report._plot import (
    RUNS_LEGEND,
    draw_runs,
    label,
    new_figure,
    runs_height,
    setting,
    width_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANELS_IN_ROW = 2
_FRAME_IN, _HEAD_IN = 0.45, 0.6
"""Room for the numbers of a panel, and for title and legend [inch]."""
_LETTERS, _MOST_LINES = 26, 3
"""Of a setting's name and value: letters in a line, and lines."""


def draw(
    title: str,
    settings: Sequence[Mapping[str, str]],
    measures: Mapping[str, Sequence[Sequence[float]]],
) -> Figure:
    """Draws the comparison, in a style of `vsense.studies.report._plot`.

    `measures` are, by name, the values of the runs for every combination of `settings`; one measure
    at least.
    """
    names = [_name(values) for values in settings]
    if len(set(names)) < len(names):  # shortened, they may say the same
        names = [f"{number}. {name}" for number, name in enumerate(names, 1)]
    labels = [label(name) for name in names]
    bands = -(-len(measures) // PANELS_IN_ROW)
    columns = min(len(measures), PANELS_IN_ROW)
    height_in = _HEAD_IN + bands * (runs_height(labels) + _FRAME_IN)
    figure = new_figure(width_of(wide=columns > 1), height_in)
    panels = figure.subplots(bands, columns, sharey=True, squeeze=False)
    runs = [len(results) for results in next(iter(measures.values()))]
    figure.suptitle(label(f"{title}: {_count(runs)} of each setting"))
    figure.supxlabel(RUNS_LEGEND, fontsize=setting("xtick.labelsize"), color="0.4")
    for axes, (name, groups) in zip(panels.flat, measures.items()):
        draw_runs(axes, name, groups)
    for axes in panels.flat[len(measures) :]:
        axes.remove()
    for axes in panels[:, 0]:
        axes.set_yticks(range(len(labels)), labels)
    return figure


def _name(values: Mapping[str, str]) -> str:
    """What tells a setting from others; long values, such as of a state machine, are shortened."""
    lines: list[str] = []
    for key, value in values.items():
        words = f"{key} = {value}"
        lines += textwrap.wrap(words, _LETTERS, max_lines=_MOST_LINES, placeholder=" ...")
    return "\n".join(lines) or "as in the file"


def _count(runs: Sequence[int]) -> str:
    least, most = min(runs), max(runs)
    count = f"{least}" if least == most else f"{least} to {most}"
    return f"{count} {'run' if most == 1 else 'runs'}"
