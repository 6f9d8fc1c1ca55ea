"""`vsense series`: many runs by a plan, without hands."""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.terminal import Console, print_data
from vsense.commands import _arguments, _experiments, _hardware, _rosters, lab, robot_keys, sim
from vsense.commands import run as run_command
from vsense.config.roster import FILE_NAME, Roster
from vsense.config.specs import Experiment
from vsense.modes.lab.hardware import BASES
from vsense.modes.live.opening import LinkOptions
from vsense.monitor.ui.room import RoomOptions
from vsense.robots import boards
from vsense.robots.build import cache_directory
from vsense.robots.deploying import Part, Plan
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
    _add_real(parser)
    group = parser.add_argument_group("lab")
    _arguments.add_bases(group, BASES)
    lab.add_cameras(group)
    lab.add_pace(group)
    _hardware.add_errors(group)
    _experiments.add_doors(parser, insecure=False)


def _add_real(parser: argparse.ArgumentParser) -> None:
    """Declares where robots and arena states come from, and how controllers get to robots."""
    run_command.add_ends(parser, run_command.LINK_CHECK_S)
    parser.set_defaults(legacy_port=None)
    text = "with real robots, serve the devices of ARGoS's elements from the virtual world"
    _arguments.flag(parser, "--virtual-devices", text)
    group = parser.add_argument_group("bringing controllers to robots")
    text = "kind of board, as in `vsense robot build` (default: epuck)"
    _arguments.choice(group, "--target", list(boards.TARGETS), text, "epuck")
    text = (
        "bring nothing: robots have what they need (default: where conditions have different"
        " controllers, each robot of the roster is brought its own before a run)"
    )
    _arguments.flag(group, "--no-deploy", text)
    robot_keys.add_ssh(group)


def bringer(
    options: argparse.Namespace, roster: Roster | None, console: Console
) -> Callable[[Experiment, Collection[int]], Mapping[int, str]]:
    """What brings robots their controllers.

    Raises:
        UsageError: nobody says how they are reached, or there is no compiler for their boards.
    """
    from vsense.commands.robot import built_for

    if roster is None:
        raise UsageError(
            "conditions have different controllers, which are brought to robots: expected --roster"
            " FILE that says how they are reached, or --no-deploy"
        )
    boards.toolchain(boards.TARGETS[options.target], cache_directory())
    how = Plan(sudo=options.sudo, ssh_options=tuple(options.ssh_option), part=Part.DAEMON)

    def bring(experiment: Experiment, tags: Collection[int]) -> Mapping[int, str]:
        robots = {int(r.settings["tag"]): r for r in _rosters.boards(roster, tags, console.say)}
        players = [r for r in experiment.robots if r.tag in robots]
        drives = {robots[r.tag].destination: r.controller for r in players}
        with tempfile.TemporaryDirectory(prefix="vsense-") as folder:
            output = Path(folder) / "vsensed"
            binaries = built_for(experiment, drives, options.target, output)
        targets = [robots[r.tag] for r in players]
        plan = robot_keys.renewing(replace(how, binaries=binaries), options, targets)
        outcomes = robot_keys.bring(plan, options, targets)
        failed = [outcome for outcome in outcomes if not outcome.ok]
        console.say(
            f"{len(outcomes) - len(failed)} of {len(outcomes)} robots have their controller"
        )
        return {int(o.robot.settings["tag"]): f"was not reached: {o.text}" for o in failed}

    return bring


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
        bringer=None if options.no_deploy else partial(bringer, options),
        **given,
    )
