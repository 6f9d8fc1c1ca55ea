"""What `vsense series` with real robots needs beside its plan: robots, tracker, controllers."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path

from vsense.base.errors import UsageError
from vsense.base.terminal import Console
from vsense.commands import _arguments, _rosters, robot_keys
from vsense.commands import run as run_command
from vsense.config.roster import Roster
from vsense.config.specs import Experiment
from vsense.robots import boards
from vsense.robots.build import cache_directory
from vsense.robots.deploying import Part, Plan


def add_arguments(parser: argparse.ArgumentParser) -> None:
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
    from vsense.commands.robot import build_programs

    if roster is None:
        raise UsageError(
            "conditions have different controllers, which are brought to robots: expected --roster"
            " FILE that says how they are reached, or --no-deploy"
        )
    boards.toolchain(boards.TARGETS[options.target], cache_directory())
    how = Plan(sudo=options.sudo, ssh_options=tuple(options.ssh_option), part=Part.DAEMON)

    def bring(experiment: Experiment, tags: Collection[int]) -> Mapping[int, str]:
        robots = {int(r.settings["tag"]): r for r in _rosters.boards(roster, tags, console.say)}
        drives = {r.tag: r.controller for r in experiment.robots if r.tag in robots}
        with tempfile.TemporaryDirectory(prefix="vsense-") as folder:
            output = Path(folder) / "vsensed"
            built = build_programs(experiment, set(drives.values()), options.target, output)
            contents = {name: boards.load(program.path) for name, program in built.items()}
        binaries = {robots[tag].destination: contents[name] for tag, name in drives.items()}
        targets = [robots[tag] for tag in drives]
        plan = robot_keys.renewing(replace(how, binaries=binaries), options, targets)
        outcomes = robot_keys.deploy_all(plan, targets)
        if plan.keys is not None:
            robot_keys.note(options, plan.keys, outcomes)
        failed = [outcome for outcome in outcomes if not outcome.ok]
        console.say(
            f"{len(outcomes) - len(failed)} of {len(outcomes)} robots have their controller"
        )
        return {int(o.robot.settings["tag"]): f"was not reached: {o.text}" for o in failed}

    return bring
