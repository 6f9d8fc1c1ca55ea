"""A run in one picture: two moments of the arena, and its measures over time.

`vsense run`, `lab` and `sim` draw it alike; only the lab has pictures of its cameras to lay
beneath. For the pollution experiment it combines figures 5.1 and 5.2 of the thesis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Frame, Image
from vsense.base.canvas import INK, MUTED, SCALE, Canvas, Colour
from vsense.base.errors import VsenseError
from vsense.base.terminal import spoken
from vsense.config.specs import Experiment
from vsense.monitor.pictures._chart import CHART_PX, Chart, ChartSeries, draw_chart
from vsense.monitor.pictures._scene import CONE, DARK, ArenaMoment
from vsense.monitor.pictures._stitch import Shade, TopView
from vsense.monitor.pictures._views import VIEW_PX, CameraPanels, draw_from_above
from vsense.monitor.pictures.run_samples import RunSamples, WorldSnapshot, take_snapshot
from vsense.vision.cameras.camera import Camera
from vsense.world.entities import Arena
from vsense.world.world import World

TRAIL_S = 6.0
"""Time of the trail behind each robot."""

MOST_CHARTS = 3

MARGIN, TITLE_PX, CAPTION, FOOT = 40, 116, 96, 64
"""Widths and heights around the pictures [px]."""

_COLOURS: tuple[Colour, ...] = (DARK, (60, 140, 60), (150, 60, 140))


@dataclass(frozen=True, slots=True)
class RunFigure:
    """What happened at the timesteps of the run.

    Attributes:
        run_timesteps: (n,) rising.
        poses: (n, robots, 3) x, y in m and yaw in rad, arena frame.
        lit: (n, robots) whether the red LEDs were on.
        inside: (n, robots) whether each was in the pollutant's cone; None without one.
        turn: Timestep of the run at which the wind turned; None: it did not.
        part: of the arena that is drawn; None: all of it.
        cameras: what they saw; None: there were none.
    """

    experiment: Experiment
    run_timesteps: NDArray[np.int64]
    poses: Floats
    lit: NDArray[np.bool_]
    inside: NDArray[np.bool_] | None
    turn: int | None
    samples: RunSamples
    part: Arena | None = None
    cameras: RunCameras | None = None

    @property
    def timesteps_per_second(self) -> int:
        """As many as there are in a second of the run, at least one."""
        return max(round(self.experiment.ticks_per_second), 1)


class RunPictureError(VsenseError):
    """A picture cannot be written."""


def save(run: RunFigure, path: Path, blind: bool, subtitle: str) -> None:
    """Writes the picture of a run into an existing folder; raises RunPictureError.

    If `blind`, the virtual sensors were held at 0; `subtitle` is how it was run.
    """
    heading = f"{run.experiment.name}{', without virtual sensors' if blind else ''}"
    if not cv2.imwrite(str(path), draw(run, heading, subtitle)):
        raise RunPictureError(f"{path}: cannot be written")


def draw(run: RunFigure, heading: str, subtitle: str) -> Image:
    """Draws the arena at chosen moments, what the cameras saw then, and the measures over time.

    Returns an (h, w, 3) BGR image.
    """
    moments, curves = _moments(run), charts(run)
    panels = [draw_from_above(scene) for scene, _ in moments]
    height = panels[0].shape[0] // SCALE
    width = MARGIN + (VIEW_PX + MARGIN) * len(panels)
    rows = [grid for _, grid in moments if grid is not None]
    grids_px = max((grid.shape[0] // SCALE + MARGIN for grid in rows), default=0)
    grids_top = TITLE_PX + height + CAPTION - (MARGIN // 2 if rows else 0)
    chart_top = TITLE_PX + height + CAPTION + grids_px
    total = chart_top + (CHART_PX + FOOT if curves else 0)
    canvas = Canvas(width, total)
    canvas.text(heading, MARGIN, 50, INK, 1.0)
    canvas.text(subtitle, MARGIN, 78, MUTED, 0.52)
    for index, ((scene, grid), panel) in enumerate(zip(moments, panels, strict=True)):
        left = MARGIN + (VIEW_PX + MARGIN) * index
        canvas.place(panel, left, TITLE_PX)
        canvas.text(scene.title, left, TITLE_PX + height + 28, INK, 0.6)
        canvas.text(scene.note, left, TITLE_PX + height + 52, MUTED, 0.52)
        if grid is not None:
            canvas.place(grid, left, grids_top)
    room = (width - MARGIN) / max(len(curves), 1)
    for index, curve in enumerate(curves):
        draw_chart(canvas, curve, MARGIN + room * index, chart_top, room - MARGIN)
    return canvas.finished()


def _moments(run: RunFigure) -> list[tuple[ArenaMoment, Image | None]]:
    """The last moment before the wind turns, or half-time; and the end.

    Each with what the cameras saw, or None.
    """
    snapshots, moment = run.samples.snapshots, run.samples.moment
    early = [t for t in snapshots if moment is not None and t < moment]
    shown = [max(early)] if early else []
    last = max(snapshots)
    titles = {}
    if shown and shown[0] != last:
        titles[shown[0]] = "before the wind turned" if run.turn is not None else "half-time"
    turned = run.turn is not None and last >= run.turn
    titles[last] = "after the wind turned" if turned else "at the end"
    return [_moment(run, t, words, snapshots[t]) for t, words in titles.items()]


def _moment(
    run: RunFigure, timestep: int, words: str, snapshot: WorldSnapshot
) -> tuple[ArenaMoment, Image | None]:
    """A moment of the arena, and what the cameras saw of it.

    It is that of the newest pictures where they are not a second older.
    """
    cameras = run.cameras
    seen = None if cameras is None else cameras.newest(timestep, run.timesteps_per_second)
    shown = timestep if seen is None else seen
    part = run.part or snapshot.arena
    scene = _scene(run, shown, words, snapshot.within(part))
    if cameras is None or seen is None:
        return scene, None
    grid = cameras.grid(seen, replace(scene, trails=np.empty(0)), VIEW_PX)
    return replace(scene, view=cameras.top_view(seen, part, VIEW_PX)), grid


def _scene(run: RunFigure, timestep: int, words: str, snapshot: WorldSnapshot) -> ArenaMoment:
    row = min(int(np.searchsorted(run.run_timesteps, timestep)), len(run.run_timesteps) - 1)
    experiment = run.experiment
    middle = np.array([*snapshot.arena.centre_m[:2], 0.0])
    trail = round(TRAIL_S * experiment.ticks_per_second)
    first = int(np.searchsorted(run.run_timesteps, timestep - trail))
    poses = run.poses[row] - middle
    return ArenaMoment(
        title=f"{words}, t = {timestep * experiment.timestep_s:.1f} s",
        note=_note(run, row),
        view=None,
        snapshot=snapshot,
        poses=poses,
        lit=run.lit[row],
        trails=run.poses[first : row + 1, :, :2] - middle[:2],
        heights_m=np.array([experiment.marker_height_m(r.model) for r in experiment.robots]),
        radii_m=np.array([robot.model.radius_m for robot in experiment.robots]),
    )


def draw_arena(
    experiment: Experiment, world: World, poses: Floats, lit: NDArray[np.bool_], width_px: int
) -> Image:
    """The arena from above, now: (h, w, 3) BGR.

    Args:
        poses: (n, 3) x, y [m] and yaw [rad] of the robots.
        lit: (n,) whether each robot's red LEDs are on.
    """
    snapshot = take_snapshot(world, experiment)
    middle = np.array([*snapshot.arena.centre_m[:2], 0.0])
    moment = ArenaMoment(
        title="",
        note="",
        view=None,
        snapshot=snapshot.within(experiment.arena),
        poses=poses - middle,
        lit=lit,
        trails=np.empty((0, len(poses), 2)),
        heights_m=np.array([experiment.marker_height_m(r.model) for r in experiment.robots]),
        radii_m=np.array([robot.model.radius_m for robot in experiment.robots]),
    )
    return draw_from_above(moment, width_px, scale=1)


def _note(run: RunFigure, row: int) -> str:
    if run.inside is not None:
        inside = run.inside[row]
        count, lit = int(inside.sum()), int((inside & run.lit[row]).sum())
        return f"{count} robot{'s' if count != 1 else ''} in the cone, {lit} of them with LEDs on"
    measures = run.samples.measures().items()
    return ", ".join(f"{spoken(name)} {values[row]:.3g}" for name, values in measures)


def charts(run: RunFigure) -> list[Chart]:
    """The robots in the cone over time, and every measure of the experiment."""
    last = int(run.run_timesteps[-1]) + 1
    time_s = np.append(run.run_timesteps, last) * run.experiment.timestep_s
    drawn = []
    if run.inside is not None:
        counts = run.inside.sum(axis=1), (run.inside & run.lit).sum(axis=1)
        series = [
            ChartSeries(name, values.astype(np.float64), colour)
            for name, values, colour in zip(("in cone", "LEDs on in cone"), counts, (CONE, DARK))
        ]
        turn_s = (run.turn or 0) * run.experiment.timestep_s
        marks = [] if run.turn is None else [(turn_s, "the wind turns")]
        drawn.append(Chart("robots", time_s, series, float(run.poses.shape[1]), marks))
    for (name, values), colour in zip(run.samples.measures().items(), _COLOURS):
        drawn.append(Chart(spoken(name), time_s, [ChartSeries("", values, colour)], 0.0))
    return drawn[:MOST_CHARTS]


_PAPER: Colour = (255, 255, 255)


class RunCameras:
    """The pictures of a run's cameras for its two views, and how to show them.

    Args:
        cameras: may be none.
        top_m: height of the markers above the floor.
        moment: the run's timestep that ends the first view, see `RunSamples`; None: there is one.
        shade: see `TopView`.

    Attributes:
        pictures: by the run's timestep and the camera's id; of each view the newest.
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        top_m: float,
        moment: int | None,
        shade: Shade | None = None,
    ) -> None:
        self.pictures: dict[int, dict[str, Image]] = {}
        self._cameras, self._top_m, self._shade = cameras, top_m, shade
        self._ids, self._moment = {camera.id for camera in cameras}, moment or 0

    def keep(self, timestep: int, frames: Sequence[Frame]) -> None:
        """Copies pictures over the view's former ones.

        So their memory returns to the cameras, and a long run takes no more.
        """
        if not (seen := [frame for frame in frames if frame.camera in self._ids]):
            return
        is_late = timestep >= self._moment
        view = (other for other in self.pictures if (other >= self._moment) == is_late)
        former = self.pictures.pop(next(view, timestep), {})
        self.pictures[timestep] = {}
        for frame in seen:
            copy = former.get(frame.camera)
            if copy is None or copy.shape != frame.image.shape:
                copy = np.empty_like(frame.image)
            np.copyto(copy, frame.image)
            self.pictures[timestep][frame.camera] = copy

    def newest(self, timestep: int, reach: int) -> int | None:
        """The newest timestep with pictures up to this one, at most `reach` before it."""
        timesteps = [t for t in self.pictures if timestep - reach <= t <= timestep]
        return max(timesteps, default=None)

    def top_view(self, timestep: int, part: Arena, width_px: int) -> Image | None:
        """The cameras' view of a part of the arena from above; None: there is none."""
        pictures = self.pictures.get(timestep)
        if not pictures:
            return None
        zoom = width_px / part.size_m[0]
        return TopView(self._cameras, part, zoom, self._top_m, self._shade).draw(pictures)

    def grid(self, timestep: int, moment: ArenaMoment, width_px: int) -> Image | None:
        """All pictures with the moment drawn in, `SCALE` times as large; None: there are none."""
        pictures = self.pictures.get(timestep)
        if not pictures:
            return None
        middle = np.array(moment.snapshot.arena.centre_m[:2])
        shown = CameraPanels(self._cameras, width_px, middle, SCALE)
        return shown.draw({c.id: moment for c in self._cameras}, pictures, _PAPER)
