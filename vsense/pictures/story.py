"""Tells a run in one picture: two moments of the arena, and its measures over time.

`vsense run`, `lab` and `sim` tell it alike; only the lab has pictures of its cameras to lay
beneath. For the pollution experiment these are figures 5.1 and 5.2 of the thesis in one picture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.errors import VsenseError
from vsense.pictures import arena_view, chart
from vsense.pictures.arena_view import CONE, DARK, LIT, WIDTH_PX, ArenaMoment
from vsense.pictures.canvas import INK, MUTED, SCALE, Canvas, Colour, Floats, Image
from vsense.pictures.chart import Chart, ChartSeries
from vsense.pictures.painting import Album, WorldSnapshot

TRAIL_S = 6.0
"""So much of the way behind each robot is drawn."""

MOST_CHARTS = 3

MARGIN, HEAD, CAPTION, FOOT = 40, 116, 96, 64
"""Widths and heights around the pictures [px]."""

_COLOURS: tuple[Colour, ...] = (DARK, (60, 140, 60), (150, 60, 140))

_UNITS = ("m", "s", "rad", "deg")

View = Callable[[int], Image | None]


@dataclass(frozen=True, slots=True)
class RunFigure:
    """What happened, at the timesteps of the run that were lived.

    Attributes:
        experiment: what was run.
        run_timesteps: (n,) rising.
        poses: (n, robots, 3) x, y in m and yaw in rad, arena frame.
        lit: (n, robots) whether the red LEDs were on.
        inside: (n, robots) whether each was in the pollutant's cone; None without one.
        turn: timestep of the run at which the wind turned; None: it did not.
        album: what was taken down.
    """

    experiment: Experiment
    run_timesteps: NDArray[np.int64]
    poses: Floats
    lit: NDArray[np.bool_]
    inside: NDArray[np.bool_] | None
    turn: int | None
    album: Album


class RunPictureError(VsenseError):
    """A picture cannot be written."""


def save(
    story: RunFigure, path: Path, blind: bool, subtitle: str, view: View = lambda timestep: None
) -> None:
    """Writes the picture of a run.

    Args:
        story: the run.
        path: where to; its folder exists.
        blind: the virtual sensors were held at 0.
        subtitle: how it was run.
        view: gives the cameras' top view at a timestep of the run, None where there is none.

    Raises:
        RunPictureError: the file cannot be written.
    """
    heading = f"{story.experiment.name}{', blind' if blind else ''}"
    if not cv2.imwrite(str(path), draw(story, heading, subtitle, view)):
        raise RunPictureError(f"{path}: cannot be written")


def draw(story: RunFigure, heading: str, subtitle: str, view: View) -> Image:
    """Draws the arena at chosen moments, and below it the measures over time, side by side.

    Args:
        story: the run.
        heading: what experiment this is.
        subtitle: how it was run.
        view: see `save`.

    Returns:
        (h, w, 3) BGR image.
    """
    scenes, curves = _scenes(story, view), charts(story)
    panels = [arena_view.draw(scene) for scene in scenes]
    height = panels[0].shape[0] // SCALE
    width = MARGIN + (WIDTH_PX + MARGIN) * len(panels)
    chart_top = HEAD + height + CAPTION
    total = chart_top + (chart.HEIGHT_PX + FOOT if curves else 0)
    canvas = Canvas(width, total)
    canvas.text(heading, MARGIN, 50, INK, 1.0)
    canvas.text(subtitle, MARGIN, 78, MUTED, 0.52)
    for index, (scene, panel) in enumerate(zip(scenes, panels, strict=True)):
        left = MARGIN + (WIDTH_PX + MARGIN) * index
        canvas.place(panel, left, HEAD)
        canvas.text(scene.title, left, HEAD + height + 28, INK, 0.6)
        canvas.text(scene.note, left, HEAD + height + 52, LIT, 0.52)
    room = (width - MARGIN) / max(len(curves), 1)
    for index, curve in enumerate(curves):
        chart.draw(canvas, curve, MARGIN + room * index, chart_top, room - MARGIN)
    return canvas.finished()


def _scenes(story: RunFigure, view: View) -> list[ArenaMoment]:
    """The last moment before the wind turns, or half-time; and the end."""
    paintings, moment = story.album.paintings, story.album.moment
    early = [t for t in paintings if moment is not None and t < moment]
    shown = [max(early)] if early else []
    last = max(paintings)
    titles = {}
    if shown and shown[0] != last:
        titles[shown[0]] = "before the wind turned" if story.turn is not None else "half-time"
    turned = story.turn is not None and last >= story.turn
    titles[last] = "after the wind turned" if turned else "at the end"
    return [_scene(story, t, words, paintings[t], view(t)) for t, words in titles.items()]


def _scene(
    story: RunFigure, timestep: int, words: str, painting: WorldSnapshot, view: Image | None
) -> ArenaMoment:
    row = int(np.searchsorted(story.run_timesteps, timestep))
    experiment = story.experiment
    middle = np.array([*experiment.arena.centre_m[:2], 0.0])
    first = max(row - round(TRAIL_S * experiment.ticks_per_second), 0)
    return ArenaMoment(
        title=f"{words}, t = {timestep * experiment.timestep_s:.1f} s",
        note=_note(story, row),
        view=view,
        painting=painting,
        poses=story.poses[row] - middle,
        lit=story.lit[row],
        trails=story.poses[first : row + 1, :, :2] - middle[:2],
    )


def _note(story: RunFigure, row: int) -> str:
    """What there is to say about a moment."""
    if story.inside is not None:
        inside = story.inside[row]
        count, lit = int(inside.sum()), int((inside & story.lit[row]).sum())
        return f"{count} robot{'s' if count != 1 else ''} in the cone, {lit} of them lit"
    measures = story.album.measures().items()
    return ", ".join(f"{spoken(name)} {values[row]:.3g}" for name, values in measures)


def spoken(name: str) -> str:
    """A measure's name as a person reads it; names end in their unit, as everywhere here."""
    words, _, unit = name.rpartition("_")
    if words and unit in _UNITS:
        return f"{words.replace('_', ' ')} [{unit}]"
    return name.replace("_", " ")


def charts(story: RunFigure) -> list[Chart]:
    """The swarm in the cone over time, and every measure of the experiment's own."""
    last = int(story.run_timesteps[-1]) + 1
    time_s = np.append(story.run_timesteps, last) * story.experiment.timestep_s
    found = []
    if story.inside is not None:
        counts = story.inside.sum(axis=1), (story.inside & story.lit).sum(axis=1)
        series = [
            ChartSeries(name, values.astype(np.float64), colour)
            for name, values, colour in zip(("in the cone", "lit"), counts, (CONE, LIT))
        ]
        turn_s = [] if story.turn is None else [story.turn * story.experiment.timestep_s]
        marks = [(time, "the wind turns") for time in turn_s]
        found.append(Chart("robots", time_s, series, float(story.poses.shape[1]), marks))
    for (name, values), colour in zip(story.album.measures().items(), _COLOURS):
        found.append(Chart(spoken(name), time_s, [ChartSeries("", values, colour)], 0.0))
    return found[:MOST_CHARTS]
