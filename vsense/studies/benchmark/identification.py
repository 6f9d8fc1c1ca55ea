"""Wheels and noise of a lab, identified from its own runs: nobody drives for that alone.

Between two pictures a robot goes forward by f and turns by w; nominal wheels, told what it tells
that its wheels were told, would have gone L and R. With a the nominal axle,

    f = (l L + r R) / 2         w = (r R - l L) / (b a)

l, r (a wheel's way over the told one) and b (the axle over the nominal one) are found by least
squares, without the worst outliers: r / l from turns, which show it best. The spread of what is
left over is the robot's: of its wheels, its motors' obedience in time, and the cameras' noise.
Source: Borenstein and Feng, Measurement and correction of systematic odometry errors in mobile
robots, 1996.

A robot's word of its wheels is some time old, and its wheels obey some time later: by how much told
speeds have to be shifted to explain the motion best is found first, for all robots together.

Of a robot that stands the second differences of what is measured are noise alone: those of white
noise have 6 times its variance. Spreads are medians of absolute deviations (times 1.4826), so that
a robot that was pushed, or a reading that somebody's shadow has cut, counts little.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from vsense.base.arena import wrap_angle
from vsense.studies.benchmark.motion import Flags, Floats, RunMotion
from vsense.world.physics.motion import AXLE_M

SHIFTS_S = np.arange(-100, 301, 10) / 1e3
"""Shifts that are tried."""
FEWEST = 50
"""Numbers that a spread or a fit needs."""
_TURNED = 0.1
"""Who turns less than by this share of its way shows nothing of its axle."""
_OUTLIER = 4.0
_ROUNDS = 4
_MAD = 1.4826


@dataclass(frozen=True, slots=True)
class IdentifiedRobot:
    """What was found of a robot's wheels.

    Attributes:
        steps: timesteps that it was found from.
        way_over_told: how far both wheels go, over what nominal ones would have, told the same.
        right_over_left: the ratio of both.
        axle_over_nominal: the distance of the wheels; both None: it hardly turned.
        forward_noise_mm, turn_noise_deg: standard deviations of what is left over in a timestep.
    """

    tag: int
    steps: int
    way_over_told: float
    right_over_left: float | None
    axle_over_nominal: float | None
    forward_noise_mm: float
    turn_noise_deg: float


@dataclass(frozen=True, slots=True)
class StandingNoise:
    """Noise of what is measured of robots that stand: `sigma` in a unit, from `samples` numbers."""

    what: str
    unit: str
    sigma: float
    samples: int


def shift_of(runs: Iterable[RunMotion]) -> float | None:
    """By how much told speeds are shifted [s]; the median of the runs, None: unknown."""
    found = [shift for run in runs if (shift := _shift(run)) is not None]
    return float(np.median(found)) if found else None


def _shift(run: RunMotion) -> float | None:
    """The shift with which told speeds explain best how fast robots went."""
    forward, _, good = run.steps()
    costs = []
    for shift_s in SHIFTS_S:
        told = np.stack([_told(run, row, shift_s).mean(axis=1) for row in range(len(run.tags))], -1)
        here = good & np.isfinite(told)
        if here.sum() < FEWEST or not np.any(told[here]):
            return None
        factor = np.sum(told[here] * forward[here]) / np.sum(told[here] ** 2)
        costs.append(float(np.abs(forward[here] - factor * told[here]).mean()))
    return float(SHIFTS_S[int(np.argmin(costs))])


def _told(run: RunMotion, row: int, shift_s: float) -> Floats:
    """What a robot's nominal wheels would have gone from state to state, (n - 1, 2) [m]."""
    orders = run.orders[row]
    if orders is None:
        return np.full((len(run.times_s) - 1, 2), np.nan)
    return np.asarray(np.diff(orders.ways_m(run.times_s - shift_s), axis=0))


def robots_of(runs: Sequence[RunMotion], shift_s: float) -> list[IdentifiedRobot]:
    """What was found of each robot of some runs, those of which enough is known, by tag."""
    rows: dict[int, list[Floats]] = {}
    for run in runs:
        forward, turn, good = run.steps()
        for row, tag in enumerate(run.tags):
            told = _told(run, row, shift_s)
            here = good[:, row] & np.isfinite(told).all(axis=1) & (told != 0.0).any(axis=1)
            table = np.column_stack((told, forward[:, row], turn[:, row]))
            rows.setdefault(tag, []).append(table[here])
    found = ((tag, np.concatenate(tables)) for tag, tables in sorted(rows.items()))
    return [one for tag, table in found if (one := _robot(tag, table)) is not None]


def _robot(tag: int, table: Floats) -> IdentifiedRobot | None:
    """Fits one robot: (k, 4) told left and right [m], forward [m], turn [rad]."""
    if len(table) < FEWEST:
        return None
    told, forward, turn = table[:, :2], table[:, 2], table[:, 3]
    (left_turn, right_turn), turn_left = _fit(told * (-1.0, 1.0), turn)
    turned = float(np.abs(told[:, 1] - told[:, 0]).mean())
    known = turned > _TURNED * float(np.abs(told).mean()) and left_turn > 0.0
    ratio = right_turn / left_turn if known else 1.0
    (left,), forward_left = _fit((told @ (0.5, 0.5 * ratio))[:, None], forward)
    return IdentifiedRobot(
        *(tag, len(table), left * (1.0 + ratio) / 2.0, ratio if known else None),
        left / (left_turn * AXLE_M) if known else None,
        *(1e3 * spread(forward_left), math.degrees(spread(turn_left))),
    )


def _fit(given: Floats, wanted: Floats) -> tuple[list[float], Floats]:
    """Least squares of (k, c) columns, again without outliers; and all that is left over, (k,)."""
    kept = np.ones(len(given), bool)
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(given[kept], wanted[kept], rcond=None)[0]
        left = wanted - given @ found
        limit = _OUTLIER * spread(left[kept])
        kept = np.abs(left) <= max(limit, 1e-12)
    return [float(value) for value in found], left


def standing_noise(runs: Iterable[RunMotion]) -> list[StandingNoise]:
    """The noise of poses of robots that stand, and of their virtual sensors' readings."""
    found: dict[tuple[str, str], list[Floats]] = {}
    for run in runs:
        still = _three(run.still(), run)
        for axis, name in enumerate(("x", "y")):
            values = _second(run.poses[..., axis])[still]
            found.setdefault((name, "mm"), []).append(1e3 * values)
        turns = np.diff(wrap_angle(np.diff(run.poses[..., 2], axis=0)), axis=0)
        found.setdefault(("heading", "deg"), []).append(np.degrees(turns[still]))
        for key, values in run.readings.items():
            found.setdefault(key, []).append(_second(values)[still].ravel())
    noise = []
    for (name, unit), parts in found.items():
        values = np.concatenate(parts)
        values = values[np.isfinite(values)]
        if len(values) >= FEWEST:
            sigma = spread(values) / math.sqrt(6.0)
            noise.append(StandingNoise(name, unit, sigma, len(values)))
    return noise


def _three(still: Flags, run: RunMotion) -> Flags:
    """Where a robot stood in three timesteps that follow each other, (n - 2, r)."""
    near = np.diff(run.times_s) < 1.5 * run.timestep_s
    return np.asarray(still[:-2] & still[1:-1] & still[2:] & (near[:-1] & near[1:])[:, None])


def _second(values: Floats) -> Floats:
    return np.asarray(np.diff(values, 2, axis=0))


def spread(values: Floats) -> float:
    """The standard deviation of most of (n,) values around 0, by their median size."""
    return _MAD * float(np.median(np.abs(values))) if len(values) else 0.0
