"""A run that plays in a notebook: `FinishedRun.play`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import anywidget
import cv2
import numpy as np
import traitlets
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.monitor.pictures.run_figure import draw_arena
from vsense.run.environment import Environment
from vsense.world.robot_models import EPUCK

WIDTH_PX = 640


class RunPlayer(anywidget.AnyWidget):
    """The page's end is `player.js`, which describes what it is given."""

    _esm = Path(__file__).with_name("player.js")
    poses = traitlets.Bytes().tag(sync=True)
    leds = traitlets.Bytes().tag(sync=True)
    picture = traitlets.Bytes().tag(sync=True)
    robots = traitlets.Int().tag(sync=True)
    timestep_s = traitlets.Float().tag(sync=True)
    arena = traitlets.List(traitlets.Float()).tag(sync=True)
    radius_m = traitlets.Float().tag(sync=True)


def make_player(
    poses: NDArray[np.float64], leds: NDArray[np.uint16], experiment: Experiment, seed: int
) -> RunPlayer:
    """Makes the widget of a run of an experiment; what loop functions put there is not drawn.

    Args:
        poses: (t, n, 3) x, y [m] and yaw [rad], arena frame; NaN: not seen.
        leds: (t, n) as `FinishedRun.leds`.
    """
    (width_m, depth_m, _), (x_m, y_m, _) = experiment.arena.size_m, experiment.arena.centre_m
    given: dict[str, Any] = {
        "poses": poses.astype("<f4").tobytes(),
        "leds": leds.astype("<u2").tobytes(),
        "picture": _background(experiment, seed),
        "robots": poses.shape[1],
        "timestep_s": experiment.timestep_s,
        "arena": [x_m - width_m / 2, y_m - depth_m / 2, width_m, depth_m],
        "radius_m": EPUCK.radius_m,
    }
    return RunPlayer(**given)


def _background(experiment: Experiment, seed: int) -> bytes:
    """The arena from above, without robots, as a PNG."""
    empty = replace(experiment, loop_functions=None)
    world = Environment(empty, seed).world
    nobody = np.empty((0, 3)), np.empty(0, np.bool_)
    _, png = cv2.imencode(".png", draw_arena(experiment, world, *nobody, WIDTH_PX))
    return png.tobytes()
