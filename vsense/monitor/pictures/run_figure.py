"""A run in one picture: two moments of the arena, and its measures over time.

`vsense run`, `lab` and `sim` draw it alike; only the lab has pictures of its cameras to lay
beneath. For the pollution experiment it combines figures 5.1 and 5.2 of the thesis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Frame, Image
from vsense.base.canvas import GRID, INK, MUTED, SCALE, Canvas, Colour, width_of
from vsense.base.errors import VsenseError
from vsense.base.terminal import spoken
from vsense.config.specs import Experiment
from vsense.monitor.pictures import _arena_view
from vsense.monitor.pictures._arena_view import VIEW_PX
from vsense.monitor.pictures._camera_view import CameraPanels
from vsense.monitor.pictures._scene import CONE, DARK, ArenaMoment
from vsense.monitor.pictures._stitch import Shade, TopView
from vsense.monitor.pictures._world_snapshot import WorldSnapshot, take_snapshot
from vsense.monitor.pictures.run_samples import RunSamples
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
    panels = [_arena_view.draw(scene) for scene, _ in moments]
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
    return _arena_view.draw(moment, width_px, scale=1)


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


CHART_PX = 300
LABEL = 0.45
_LEFT = 48
"""Room for the numbers on the left."""


@dataclass(frozen=True, slots=True)
class ChartSeries:
    """One measure over time: its name, (n,) values and its colour."""

    name: str
    values: NDArray[np.float64]
    colour: Colour


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart of one measure or more.

    Attributes:
        unit: Label of the vertical axis.
        time_s: (n + 1,) when each timestep began, and when the last one ended.
        top: End of the vertical axis; it begins at 0 or at the smallest value below.
        marks: Events: time in s and words.
    """

    unit: str
    time_s: NDArray[np.float64]
    series: Sequence[ChartSeries]
    top: float
    marks: Sequence[tuple[float, str]] = ()


def draw_chart(canvas: Canvas, chart: Chart, left: float, top: float, width: float) -> None:
    """Draws a chart of `CHART_PX` px into a picture; left, top, width in px."""
    names = max(width_of(series.name, 0.5) for series in chart.series)
    axis = _Axis(chart, left + _LEFT, top, width - _LEFT - names - 20)
    axis.grid(canvas, chart.unit, left)
    for time_s, words in chart.marks:
        if 0.0 < time_s < chart.time_s[-1]:
            x = axis.at(time_s, 0.0)[0]
            canvas.lines(np.array([[x, top - 8], [x, axis.bottom]]), MUTED)
            canvas.text(words, x + 8, top - 2, MUTED, LABEL)
    ends = []
    for series in chart.series:
        times = np.repeat(chart.time_s, 2)[1:-1]
        stairs = zip(times, np.repeat(series.values, 2), strict=True)
        points = np.array([axis.at(time_s, value) for time_s, value in stairs])
        canvas.lines(points, series.colour, 2.0)
        ends.append((float(points[-1, 1]), series.name, series.colour))
    _line_names(canvas, ends, axis.right + 12)
    floor = np.array([[axis.left, axis.bottom], [axis.right, axis.bottom]])
    canvas.lines(floor, MUTED)


class _Axis:
    """Maps times and values to the picture."""

    def __init__(self, chart: Chart, left: float, top: float, width: float) -> None:
        lowest = min(float(series.values.min()) for series in chart.series)
        highest = max(float(series.values.max()) for series in chart.series)
        self.left, self.right = left, left + width
        self._top, self.bottom = top, top + CHART_PX
        self._low, self._high = min(lowest, 0.0), max(chart.top, highest, 1e-9)
        self._end_s = float(chart.time_s[-1])

    def at(self, time_s: float, value: float) -> tuple[float, float]:
        """The place of a value at a time."""
        x = self.left + (self.right - self.left) * time_s / self._end_s
        share = (value - self._low) / (self._high - self._low)
        return x, self.bottom - (self.bottom - self._top) * share

    def grid(self, canvas: Canvas, unit: str, left: float) -> None:
        """Draws numbers and lines along both axes."""
        for value in ticks(self._low, self._high, 5):
            y = self.at(0.0, value)[1]
            canvas.lines(np.array([[self.left, y], [self.right, y]]), GRID)
            label = f"{value:g}"
            canvas.text(label, self.left - 10 - width_of(label, LABEL), y + 5, MUTED, LABEL)
        for time_s in ticks(0.0, self._end_s, 4 + round((self.right - self.left) / 400)):
            x = self.at(time_s, 0.0)[0]
            canvas.lines(np.array([[x, self.bottom], [x, self.bottom + 6]]), MUTED)
            label = f"{time_s:g} s"
            canvas.text(label, x - width_of(label, LABEL) / 2, self.bottom + 24, MUTED, LABEL)
        canvas.text(unit, left, self._top - 14, MUTED, LABEL)


def _line_names(canvas: Canvas, ends: list[tuple[float, str, Colour]], x: float) -> None:
    """Names each line at its end, without overlaps."""
    lowest = -100.0
    for y, name, colour in sorted(ends, key=lambda end: end[0]):
        y = max(y, lowest + 20.0)
        canvas.text(name, x, y + 5.0, colour, 0.5)
        lowest = y


def ticks(low: float, high: float, most: int) -> Floats:
    """Round values between two ends, at most `most` steps of 1, 2 or 5 times a power of ten."""
    raw = (high - low) / most
    power = 10.0 ** np.floor(np.log10(raw))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= raw * (1.0 - 1e-9))
    first = np.ceil(low / step - 1e-9)
    count = np.floor(high / step + 1e-9) - first + 1
    return np.asarray((first + np.arange(count)) * step)


_PAPER: Colour = (255, 255, 255)
_QUALITY = (cv2.IMWRITE_JPEG_QUALITY, 90)


class RunCameras:
    """The pictures of a run's cameras at chosen timesteps, and how to show them.

    Args:
        cameras: may be none.
        top_m: height of the markers above the floor.
        shade: see `TopView`.

    Attributes:
        pictures: by the run's timestep and the camera's id.
    """

    def __init__(self, cameras: Sequence[Camera], top_m: float, shade: Shade | None = None) -> None:
        self.pictures: dict[int, Mapping[str, Image]] = {}
        self._packed: dict[int, dict[str, Image]] = {}
        self._cameras, self._top_m, self._shade = cameras, top_m, shade

    def keep(self, timestep: int, frames: Sequence[Frame]) -> None:
        """Copies pictures, so that their memory returns to the cameras."""
        ids = {camera.id for camera in self._cameras}
        copied = {f.camera: f.image.copy() for f in frames if f.camera in ids}
        if copied:
            self.pictures[timestep] = copied

    def drop(self, timestep: int) -> None:
        """Forgets the pictures of a timestep, if there are any."""
        self.pictures.pop(timestep, None)

    def pack(self) -> None:
        """Keeps all pictures as JPEG, of a run that others follow: runs may be many."""
        for timestep, images in self.pictures.items():
            self._packed[timestep] = {
                name: cv2.imencode(".jpg", image, _QUALITY)[1] for name, image in images.items()
            }
        self.pictures.clear()

    def unpack(self) -> None:
        """Makes pictures of what was packed."""
        for timestep, coded in self._packed.items():
            self.pictures[timestep] = {
                name: np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), np.uint8)
                for name, data in coded.items()
            }

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
