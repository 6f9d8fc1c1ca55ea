"""A run that is drawn or plays in a notebook: `FinishedRun.draw` and `FinishedRun.play`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.monitor.pictures.run_figure import draw_arena
from vsense.run.environment import Environment

PICTURE_PX = 640
"""Width of the arena where a run plays."""


def empty_arena(experiment: Experiment, seed: int, width_px: int = PICTURE_PX) -> NDArray[np.uint8]:
    """The arena from above, (h, w, 3) BGR, without robots and what loop functions put there."""
    empty = replace(experiment, loop_functions=None)
    world = Environment(empty, seed).world
    nobody = np.empty((0, 3)), np.empty(0, np.bool_)
    return np.asarray(draw_arena(empty, world, *nobody, width_px))


def draw_ways(axes: Any, poses: NDArray[np.float64], line: Mapping[str, Any]) -> None:
    """Draws the ways of robots with a dot at their ends; arguments as of the two that call it."""
    for robot in range(poses.shape[1]):
        (way,) = axes.plot(*poses[:, robot, :2].T, **{"linewidth": 1.0, **line})
        seen = poses[~np.isnan(poses[:, robot, 0]), robot, :2]
        axes.plot(*seen[-1:].T, "o", markersize=4.0, color=way.get_color())
    axes.set(xlabel="x [m]", ylabel="y [m]")


def corners(experiment: Experiment) -> NDArray[np.float64]:
    """(2, 2) least x and y, and greatest [m], of the arena."""
    middle, size = (np.array(c[:2]) for c in (experiment.arena.centre_m, experiment.arena.size_m))
    return np.stack((middle - size / 2.0, middle + size / 2.0))


def make_player(
    poses: NDArray[np.float64], leds: NDArray[np.uint16], experiment: Experiment, seed: int
) -> Any:
    """Makes the widget of a run of an experiment; what loop functions put there is not drawn.

    Args:
        poses: (t, n, 3) x, y [m] and yaw [rad], arena frame; NaN: not seen.
        leds: (t, n) as `FinishedRun.leds`.
    """
    import anywidget
    import traitlets

    class RunPlayer(anywidget.AnyWidget):
        """The page's end is `player.js`, which describes what it is given."""

        _esm = Path(__file__).with_name("player.js")
        poses = traitlets.Bytes().tag(sync=True)
        leds = traitlets.Bytes().tag(sync=True)
        picture = traitlets.Bytes().tag(sync=True)
        robots = traitlets.Int().tag(sync=True)
        timestep_s = traitlets.Float().tag(sync=True)
        arena = traitlets.List(traitlets.Float()).tag(sync=True)
        radii_m = traitlets.List(traitlets.Float()).tag(sync=True)

    low, high = corners(experiment)
    _, png = cv2.imencode(".png", empty_arena(experiment, seed))
    given: dict[str, Any] = {
        "poses": poses.astype("<f4").tobytes(),
        "leds": leds.astype("<u2").tobytes(),
        "picture": png.tobytes(),
        "robots": poses.shape[1],
        "timestep_s": experiment.timestep_s,
        "arena": [*low, *(high - low)],
        "radii_m": [robot.model.radius_m for robot in experiment.robots],
    }
    return RunPlayer(**given)
