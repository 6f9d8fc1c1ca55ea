"""A run that plays in a notebook: `FinishedRun.play`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import anywidget
import numpy as np
import traitlets
from numpy.typing import NDArray

from vsense.config.specs import Experiment


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


def make_player(
    poses: NDArray[np.float64], leds: NDArray[np.uint16], experiment: Experiment, picture: bytes
) -> RunPlayer:
    """Makes the widget of a run of an experiment.

    Args:
        poses: (t, n, 3) x, y [m] and yaw [rad], arena frame; NaN: not seen.
        leds: (t, n) as `FinishedRun.leds`.
        picture: of the arena without robots, a PNG.
    """
    (width_m, depth_m, _), (x_m, y_m, _) = experiment.arena.size_m, experiment.arena.centre_m
    given: dict[str, Any] = {
        "poses": poses.astype("<f4").tobytes(),
        "leds": leds.astype("<u2").tobytes(),
        "picture": picture,
        "robots": poses.shape[1],
        "timestep_s": experiment.timestep_s,
        "arena": [x_m - width_m / 2, y_m - depth_m / 2, width_m, depth_m],
        "radii_m": [robot.model.radius_m for robot in experiment.robots],
    }
    return RunPlayer(**given)
