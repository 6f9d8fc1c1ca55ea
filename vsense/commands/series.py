"""`vsense series`: many runs by a plan, without hands."""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.terminal import print_data
from vsense.commands import _arguments, _experiments, _hardware, _rosters, lab, series_robots, sim
from vsense.config.roster import FILE_NAME
from vsense.modes.lab.hardware import BASES
from vsense.modes.live.opening import LinkOptions
from vsense.monitor.ui.room import RoomOptions
from vsense.run.runs_csv import MODES
from vsense.studies.series.run import PlannedSeries, SeriesOptions
from vsense.tools.shipped import documents

DESCRIPTION = (
    "Makes many runs by a plan, without hands: conditions at the same starts, in an order that is"
    " shuffled block by block, simulated, in the lab or with real robots. Between runs robots drive"
    " to their starts. A run is valid by criteria that the plan has; invalid ones are kept, named"
    " and repeated. Every run is a row of runs.csv. Ctrl-C costs the run that goes on; the"
    " same command goes on from there, also on another day."
)

EXAMPLE = "plan.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument(
        "plan", nargs="?", type=Path, metavar="PLAN", help="a file such as plan.toml"
    )
    _arguments.flag(parser, "--example", "print a plan whose lines are explained, and end")
    _arguments.flag(
        parser, "--dry", "only say which runs follow, in which order, and how long they take"
    )
    _arguments.choice(parser, "--mode", MODES, "make the runs there (default: the plan's)")
    text = "folder of the series (default: NAME-MODE beside the plan)"
    _arguments.option(parser, "-o --output", Path, "DIR", text)
    _arguments.flag(parser, "--json", "print how the series stands in the end as one JSON object")
    text = (
        "go on where a controller asks for a sensor or actuator that is not there, or is given"
        " a parameter that it does not read"
    )
    _arguments.flag(parser, "--lenient", text)
    _arguments.add_code(parser)
    sim.add_on(parser)
    add_making(parser)
    group = parser.add_argument_group("control room")
    _experiments.add_locked(group)
    _experiments.add_recording(group)


def add_making(parser: argparse.ArgumentParser) -> None:
    """Declares who plays, and how runs are made in each mode."""
    text = "go on with another vsense, or other files, than the series began with: rows note it"
    _arguments.flag(parser, "--allow-upgrade", text)
    text = "simulated runs at the same time (default: one per processor)"
    _arguments.option(parser, "-j --jobs", _arguments.positive, "N", text)
    default = f"(default: with real robots {FILE_NAME} in the current folder, otherwise none)"
    _rosters.add_casting(parser, default)
    series_robots.add_arguments(parser)
    group = parser.add_argument_group("lab")
    _arguments.add_bases(group, BASES)
    lab.add_cameras(group)
    lab.add_pace(group)
    _hardware.add_errors(group)
    _experiments.add_doors(parser, insecure=False)


def run(options: argparse.Namespace) -> int:
    """Carries a series out; 0, or 130 after Ctrl-C, 143 after SIGTERM."""
    if options.example:
        print_data(documents.find(EXAMPLE).text().rstrip())
        return 0
    if options.plan is None:
        raise UsageError("expected a plan: vsense series --example > plan.toml makes one")
    series = PlannedSeries(options.plan, options_of(options, options.mode, options.output))
    if options.dry:
        forecast = series.forecast()
        print_data(json.dumps(forecast.facts(), indent=2) if options.json else forecast.table())
        return 0
    return series.carry_out()


def options_of(
    options: argparse.Namespace, mode: str | None, output: Path | None, **given: Any
) -> SeriesOptions:
    """Returns what `add_making` declares, and the others of `vsense series`.

    Raises as `RoomOptions.check`, before anything is built.
    """
    # Every run is a series' and begins by itself.
    doors = _experiments.doors_of(options)
    once = {"hold": False, "runs": 1, "series": None, "tokens": None}
    room = _arguments.fill(RoomOptions, options, **doors, **once)
    if not options.dry:
        room.check()
    return _arguments.fill(
        SeriesOptions,
        options,
        mode=mode,
        output=output,
        code=_arguments.code_of(options),
        replace=tuple(options.replace),
        room=room,
        lab=lab.lab_of(options),
        link=_arguments.fill(LinkOptions, options),
        bringer=None if options.no_deploy else partial(series_robots.bringer, options),
        **given,
    )
