"""How much is searched against what is found: the thesis's Table 2.1 and figures 2.14 and 2.15.

20 robots drive below one camera through pictures that are hard to read: dim, noisy, in a light that
flickers, and three poles sweep over the arena and hide who is below. Who was hidden has driven on:
a small window is no longer where the robot is, and the next key frame is a while off. What is
detected is the same in every run and on every machine; times are this machine's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import UsageError, VsenseError, failing_as
from vsense.base.terminal import aligned
from vsense.studies.report import FORMATS, can_draw, lacking, plot
from vsense.tools.bench.contestants import FoundTags, Tracked
from vsense.tools.bench.frames import FrameSet, Image, Painter, cameras
from vsense.vision.markers.families import MarkerFamily, choose_tags, load_family
from vsense.vision.tracking.prediction import SearchPlan

ROBOTS = 20
TIMESTEPS = 100
STRIDES = 2
"""Pictures are taken at half the rate of `frames`: 133 ms apart, the thesis's are 100 ms."""
PERIODS = (5, 9, 15)
WINDOWS_M = (0.08, 0.11, 0.20, 0.30)
THESIS = {
    (1, None): 19.25725, (5, 0.30): 19.05596, (5, 0.11): 19.06481, (5, 0.10): 19.02939,
    (9, 0.11): 19.01369,
}  # fmt: skip
"""Table 2.1: robots of 20 that were detected, by key frame period and window's side [m]."""

_FAMILY = "arrow4x4"
_BLUR_MM = 2.2
_MATCH_PX = 5.0
_SEED = 21
_GAIN, _FLICKER, _FLICKER_PICTURES = 0.36, 0.25, 7.3
"""Of full light; the light's swing as a share of it, and its period."""
_NOISE = 4.0
_POLE_PX, _POLE_STEP_PX, _POLE_GREY = 60.0, 20.0, 24
"""Width of a pole, how far it gets from picture to picture, and its grey value."""


@dataclass(frozen=True, slots=True)
class PlanRow:
    """What a search plan costs and finds.

    Attributes:
        key_frame_period: in timesteps.
        window_m: side of the squares that are searched between key frames; None: there is nothing
            between.
        mean, median: robots of 20 that were named where they are, over all timesteps.
        detected_share: of all robots in all timesteps, 0..1.
        wrong_ids: names that were not there.
        ms: time of a timestep: mean, median, quartiles, 5th and 95th percentile. Each timestep's is
            the least of all rounds: the work is the same, only others on the machine lengthen it.
        thesis_mean: that of Table 2.1, None: the thesis has no such row.
    """

    key_frame_period: int
    window_m: float | None
    mean: float
    median: float
    detected_share: float
    wrong_ids: int
    ms: dict[str, float]
    thesis_mean: float | None

    @property
    def label(self) -> str:
        """As on the axis of figure 2.14: period and window's side [cm]."""
        window = "" if self.window_m is None else f"_{100.0 * self.window_m:.0f}"
        return f"{self.key_frame_period}{window}"


def run(rounds: int, timesteps: int, say: Callable[[str], None]) -> list[dict[str, Any]]:
    """Tracks the hard pictures with every plan, in turns; gives a `PlanRow` of each as a dict."""
    say("rendering hard pictures")
    frames = hard_frames(timesteps)
    plans: list[tuple[int, float | None]] = [(1, None)]
    plans += sorted({*THESIS, *((p, w) for p in PERIODS for w in WINDOWS_M)} - {plans[0]})
    contestants = [
        Tracked(f"key frame {period}", frames, SearchPlan(period, window_m or 0.3), STRIDES)
        for period, window_m in plans
    ]
    times: list[list[list[float]]] = [[] for _ in plans]
    found: list[list[FoundTags]] = [[] for _ in plans]
    for turn in range(rounds):
        say(f"search plans: round {turn + 1} of {rounds}")
        for place, contestant in enumerate(contestants):
            spent, found[place] = contestant.run()
            times[place].append(spent)
    return [
        asdict(_row(plan, frames, np.min(spent, axis=0), seen))
        for plan, spent, seen in zip(plans, times, found, strict=True)
    ]


def hard_frames(timesteps: int) -> FrameSet:
    """Renders the pictures; the same for the same number of them."""
    family = load_family(_FAMILY)
    assert isinstance(family, MarkerFamily), "the shipped family is of arrows"
    tags = tuple(choose_tags(family, ROBOTS, _BLUR_MM, seed=14))
    painter = Painter(f"{_FAMILY}, hard", _FAMILY, tags, cameras(1, 1))
    drawn = painter.walk(timesteps, STRIDES)
    spoil = Spoiler(drawn.images[0].shape)
    images = tuple(spoil(number, image) for number, image in enumerate(drawn.images))
    return FrameSet(drawn.name, drawn.family, tags, drawn.cameras, images, drawn.truth)


class Spoiler:
    """Makes pictures of one size (height, width) hard."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        rng = np.random.default_rng(_SEED)
        # As large again, so that every picture has other noise of it.
        self._noise = rng.normal(0.0, _NOISE, (2 * shape[0], shape[1])).astype(np.float32)
        self._offsets = rng.integers(0, shape[0], 4096)
        height, width = shape
        self._y, self._x = np.ogrid[:height, :width]

    def __call__(self, number: int, image: Image) -> Image:
        """Gives a spoiled copy of the picture with this number."""
        swing = np.sin(2.0 * np.pi * number / _FLICKER_PICTURES)
        grey = image.astype(np.float32) * np.float32(_GAIN * (1.0 + _FLICKER * swing))
        grey[self._poles(number)] = _POLE_GREY
        top = self._offsets[number % len(self._offsets)]
        grey += self._noise[top : top + len(image)]
        spoilt: Image = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
        return spoilt

    def _poles(self, number: int) -> NDArray[np.bool_]:
        """Which pixels the poles cover: two upright ones and a slanting one."""
        width = self._x.shape[1] + _POLE_PX
        way = number * _POLE_STEP_PX
        hidden = np.zeros((self._y.shape[0], self._x.shape[1]), dtype=np.bool_)
        for start, slope, side in ((0.1, 0.0, 1.0), (0.6, 0.0, -1.0), (0.35, 0.6, 1.0)):
            middle = (start * width + side * way) % (2.0 * width) - _POLE_PX / 2.0
            hidden |= np.abs(self._x + slope * self._y - middle) < _POLE_PX / 2.0
        return hidden


def _row(
    plan: tuple[int, float | None], frames: FrameSet, ms: Any, found: list[FoundTags]
) -> PlanRow:
    counts, present, wrong = [], 0, 0
    for truth, seen in zip(frames.truth, found, strict=True):
        places = dict(zip(truth.tags.tolist(), truth.centres_px, strict=True))
        named = [
            tag in places and np.hypot(*(centre - places[tag])) < _MATCH_PX
            for tag, centre in zip(seen.tags.tolist(), seen.centres_px, strict=True)
        ]
        counts.append(int(np.count_nonzero(named)))
        wrong += len(named) - counts[-1]
        present += len(places)
    low, first, median, third, high = np.percentile(ms, (5, 25, 50, 75, 95)).tolist()
    spread = {"p5": low, "q1": first, "median": median, "q3": third, "p95": high}
    return PlanRow(
        *plan,
        mean=float(np.mean(counts)),
        median=float(np.median(counts)),
        detected_share=sum(counts) / present,
        wrong_ids=wrong,
        ms={"mean": float(np.mean(ms)), **spread},
        thesis_mean=THESIS.get(plan),
    )


def table(rows: list[dict[str, Any]]) -> str:
    """The rows for a person."""
    titles = ("key frame", "window", "detected", "mean of 20", "median", "wrong", "ms mean",
              "median", "95 %", "thesis: of 20")  # fmt: skip
    lines = [titles]
    for row in (PlanRow(**row) for row in rows):
        window = "all" if row.window_m is None else f"{100.0 * row.window_m:.0f} cm"
        lines.append((
            str(row.key_frame_period), window, f"{100.0 * row.detected_share:.2f} %",
            f"{row.mean:.2f}", f"{row.median:g}", str(row.wrong_ids), f"{row.ms['mean']:.2f}",
            f"{row.ms['median']:.2f}", f"{row.ms['p95']:.2f}",
            "" if row.thesis_mean is None else f"{row.thesis_mean:.2f}",
        ))  # fmt: skip
    head = "Table 2.1 on hard pictures: what is searched, what is found, and what that takes"
    return "\n".join([head, *aligned(lines)])


def require_drawing(path: Path) -> None:
    """Checks before anything is measured whether a chart can be drawn into this file.

    Raises:
        UsageError: Matplotlib is missing, or charts are no such files.
        VsenseError: the folder is not there.
    """
    if path.suffix.lower()[1:] not in FORMATS:
        raise UsageError(f"-o {path}: expected a name that ends in .{', .'.join(FORMATS)}")
    if not can_draw():
        raise UsageError(lacking())
    if not path.parent.is_dir():
        raise VsenseError(f"{path}: cannot be written: there is no folder {path.parent}")


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Draws figures 2.14 and 2.15 of these rows, one above the other.

    VsenseError if the file cannot be written.
    """
    shown = [PlanRow(**row) for row in rows]
    with plot.styled():
        width_in = plot.width_of(wide=True)
        figure = plot.new_figure(width_in, 0.58 * width_in)
        times, found = figure.subplots(2, 1, sharex=True)
        places = range(len(shown))
        _boxes(times, shown)
        found.plot(places, [row.mean for row in shown], "o", color="C0", label="here")
        found.plot(
            [n for n in places if shown[n].thesis_mean is not None],
            [row.thesis_mean for row in shown if row.thesis_mean is not None],
            *("D",), color="C4", markerfacecolor="none", label="thesis, in its own arena",
        )  # fmt: skip
        found.set_ylabel(f"robots found, of {ROBOTS}")
        found.set_xlabel("key frame period [timesteps] _ side of the windows [cm]; 1: all of it")
        found.set_xticks(list(places), [row.label for row in shown])
        found.set_xlim(-0.6, len(shown) - 0.4)
        found.legend(loc="lower left")
        data = plot.encode(figure, path.suffix.lower()[1:])
    with failing_as(VsenseError, f"{path}: cannot be written"):
        path.write_bytes(data)


def _boxes(axes: Any, shown: list[PlanRow]) -> None:
    """Quartiles in a box, 5th and 95th percentile as whiskers, the mean as a red point."""
    boxes = [
        {"med": row.ms["median"], "q1": row.ms["q1"], "q3": row.ms["q3"],
         "whislo": row.ms["p5"], "whishi": row.ms["p95"], "fliers": []}
        for row in shown
    ]  # fmt: skip
    axes.bxp(boxes, positions=range(len(shown)), widths=0.5, showfliers=False)
    means = [row.ms["mean"] for row in shown]
    axes.plot(range(len(shown)), means, "o", color="#d62728", markersize=4, label="mean")
    axes.set_ylim(0.0)
    axes.set_ylabel("time of a timestep [ms]")
    axes.legend(loc="upper right")
