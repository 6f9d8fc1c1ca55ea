"""Options that say where robots drive before a run, and who does not play in it."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from vsense.commands import _arguments
from vsense.config.experiment import first_robots
from vsense.config.specs import Experiment

if TYPE_CHECKING:
    from vsense.run.homing.starts import Starts

MOST_VOLTS = 10.0


def add_home(group: Any) -> None:
    """Declares them."""
    _arguments.flag(
        group,
        "--home",
        "before each run the robots drive to their starts by themselves: where the file places"
        " them, or the run's seed; robots of the same kind (controller, base) exchange places",
    )
    _arguments.flag(
        group,
        "--home-virtual-walls",
        "as --home, and on their ways they keep clear of virtual walls, too",
    )
    group.add_argument(
        "--battery",
        type=_volts,
        default=0.0,
        metavar="VOLTS",
        help="before each run: robots with less in their batteries, or whose bases say only that it"
        " is low, are named, drive to their starts and rest there while the others run, until they"
        " have another one, or a spare of the roster has their role from the next run on (default:"
        " 0, no robot rests)",
    )


def starts_of(options: argparse.Namespace, experiment: Experiment) -> Starts | None:
    """Where robots drive before each run of an experiment of which nothing is placed yet.

    None: they stay where they are. ConfigError: there is no place for all.
    """
    if not (options.home or options.home_virtual_walls):
        return None
    from vsense.run.homing.starts import Starts

    starts = Starts(first_robots(experiment, options.robots), options.home_virtual_walls)
    starts.of(1)
    return starts


def _volts(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= MOST_VOLTS:
        raise argparse.ArgumentTypeError(f"'{text}': expected 0 to {MOST_VOLTS:g} V, such as 3.5")
    return value
