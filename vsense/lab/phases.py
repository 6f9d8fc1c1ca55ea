"""The swarm before and after the wind's turn: the figures that lab and simulation share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class SwarmTruth:
    """Where everything really was, per timestep that the host lived.

    Attributes:
        poses: (timesteps, robots, 3) x, y in m and yaw in rad at the capture time.
        depth_m: (timesteps, robots) how deep in the cone, positive inside, negative outside;
            None for an experiment without a cone.
        lit: (timesteps, robots) whether the robot's red LEDs were on at the capture time.
    """

    poses: NDArray[np.float64]
    depth_m: NDArray[np.float64] | None
    lit: NDArray[np.bool_]


class Phases(Protocol):
    """A run that may have two phases."""

    @property
    def timesteps(self) -> NDArray[Any]:
        """(n,) with a field `run_timestep`, rising."""

    @property
    def truth(self) -> SwarmTruth:
        """What truly was at these timesteps."""

    @property
    def turn(self) -> int | None:
        """The run's timestep at which the wind turns, or None."""


def swarm(run: Phases) -> dict[str, int | None]:
    """Robots in the cone, and lit there, at the last timestep of each phase."""
    inside, lit = counts(run.truth) or (None, None)
    before, after = phase_ends(run)

    def at(series: NDArray[np.int64] | None, row: int | None) -> int | None:
        return None if series is None or row is None else int(series[row])

    return {
        "in_cone_before_turn": at(inside, before),
        "lit_before_turn": at(lit, before),
        "in_cone_after_turn": at(inside, after),
        "lit_after_turn": at(lit, after),
    }


def rows(swarm: dict[str, int | None], robots: int) -> list[tuple[str, str]]:
    """The figures of `swarm` as lines of a table; none without a cone."""
    found = []
    turned = swarm["in_cone_after_turn"] is not None
    for when in ("before", "after"):
        inside, lit = swarm[f"in_cone_{when}_turn"], swarm[f"lit_{when}_turn"]
        if inside is not None:
            moment = f"{when} the wind turned" if turned else "at the end"
            text = f"{inside} of {robots} robots in the cone {moment}, {lit} of them lit"
            found.append(("swarm", text))
    return found


def phase_ends(run: Phases) -> tuple[int | None, int | None]:
    """Rows of the last timesteps before the wind turned and after it; None: no such phase."""
    timesteps = run.timesteps["run_timestep"]
    if run.turn is None:
        return len(timesteps) - 1, None
    before = int(np.searchsorted(timesteps, run.turn)) - 1
    after = len(timesteps) - 1
    return (before if before >= 0 else None), (after if after > before else None)


def counts(truth: SwarmTruth) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """Robots in the cone, and robots lit in the cone, per timestep; None without a cone."""
    if truth.depth_m is None:
        return None
    inside = truth.depth_m >= 0
    return inside.sum(axis=1), (inside & truth.lit).sum(axis=1)
