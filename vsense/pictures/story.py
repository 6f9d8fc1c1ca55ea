"""Tells a run in one picture: two moments of the arena, and its measures over time.

The lab and the simulator tell it alike; only the lab has pictures of its cameras to lay beneath.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.pictures import run_picture
from vsense.pictures.album import RunSamples
from vsense.pictures.arena_view import CONE, DARK, LIT, ArenaMoment
from vsense.pictures.canvas import Colour, Floats, Image
from vsense.pictures.chart import Chart, ChartSeries
from vsense.pictures.painting import WorldSnapshot

TRAIL_S = 6.0
"""So much of the way behind each robot is drawn."""

MOST_CHARTS = 3

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
    album: RunSamples


def draw(story: RunFigure, heading: str, subtitle: str, view: View) -> Image:
    """Draws the picture of a run.

    Args:
        story: the run.
        heading: what experiment this is.
        subtitle: how it was run.
        view: gives the cameras' top view at a timestep of the run, None where there is none.

    Returns:
        (h, w, 3) BGR image.
    """
    return run_picture.draw(heading, subtitle, _scenes(story, view), charts(story))


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
