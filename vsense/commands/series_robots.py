"""What `vsense series` with real robots needs beside its plan: robots, tracker, controllers."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Collection, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from vsense.base.errors import UsageError
from vsense.base.terminal import Console, Interruption
from vsense.commands import arguments, experiments, hardware, robot_keys, rosters
from vsense.commands import run as run_command
from vsense.config.roster import Roster
from vsense.config.specs import Experiment
from vsense.robots import boards
from vsense.robots.deploying import Part, Plan
from vsense.studies.series.parts import PlanLoader, PlannedExperiment, SeriesCast

if TYPE_CHECKING:
    from vsense.monitor.ui.room import RoomOptions
    from vsense.studies.series.real import Bring, RealRuns


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares where robots and arena states come from, and how controllers get to robots."""
    run_command.add_ends(parser)
    parser.set_defaults(legacy_port=None)
    text = "with real robots, serve the devices of ARGoS's elements from the virtual world"
    arguments.flag(parser, "--virtual-devices", text)
    group = parser.add_argument_group("bringing controllers to robots")
    group.add_argument(
        "--target",
        choices=list(boards.TARGETS),
        default="epuck",
        help="kind of board, as in `vsense robot build` (default: epuck)",
    )
    text = (
        "bring nothing: robots have what they need (default: where conditions have different"
        " controllers, each robot of the roster is brought its own before a run)"
    )
    arguments.flag(group, "--no-deploy", text)
    robot_keys.add_ssh(group)


def complete(loader: PlanLoader, options: argparse.Namespace) -> PlanLoader:
    """Has experiments loaded with the tracker and the markers of the options."""

    def finish(experiment: Experiment) -> Experiment:
        known = replace(experiment, markers=hardware.markers_of(options))
        return run_command.with_tracker(known, options.tracker)

    return replace(loader, virtual_devices=options.virtual_devices, finish=finish)


def maker(
    options: argparse.Namespace,
    loader: PlanLoader,
    known: Mapping[str, PlannedExperiment],
    console: Console,
    interrupted: Interruption,
    room: RoomOptions,
    stack: ExitStack,
) -> RealRuns:
    """Who makes runs with real robots; `stack` gives the robots back.

    Raises:
        UsageError: something is missing, before anything is started.
        VsenseError: a port, a key or the page cannot be had.
    """
    from vsense.modes.live.sources import require_source
    from vsense.monitor.ui.access import is_loopback
    from vsense.run.leases import RobotLeases
    from vsense.studies.series.real import RealOptions, RealRuns

    for planned in known.values():
        require_source(planned.experiment, options.tracking)
    first = next(iter(known.values())).experiment
    host = first.host if options.host is None else options.host
    experiments.check_doors(options, host, first.port if options.port is None else options.port)
    roster = rosters.roster_of(options)
    trust = experiments.trust_of(options)
    real = RealOptions(trust, options.host, options.port, options.tracking, room)
    if not is_loopback(host):
        leases = RobotLeases(experiments.lease_folder(), options.command, loader.plan.name)
        real = replace(real, lease=stack.enter_context(leases).take)
    if _programs(known) > 1 and not options.no_deploy:
        real = replace(real, bring=bringer(options, roster, console))
    return RealRuns(loader, SeriesCast(known, console), console, interrupted, real)


def _programs(known: Mapping[str, PlannedExperiment]) -> int:
    """How many programs the conditions run for some part."""
    parts: dict[int, set[object]] = {}
    for planned in known.values():
        experiment = planned.experiment
        for number, robot in enumerate(experiment.robots):
            parts.setdefault(number, set()).add(experiment.controller_of(robot).program)
    return max(map(len, parts.values()), default=0)


def bringer(options: argparse.Namespace, roster: Roster | None, console: Console) -> Bring:
    """What brings robots their controllers; UsageError: nobody says how they are reached."""
    from vsense.commands.robot import build_programs

    if roster is None:
        raise UsageError(
            "conditions have different controllers, which are brought to robots: expected --roster"
            " FILE that says how they are reached, or --no-deploy"
        )
    how = Plan(sudo=options.sudo, ssh_options=tuple(options.ssh_option), part=Part.DAEMON)

    def bring(experiment: Experiment, tags: Collection[int]) -> Mapping[int, str]:
        robots = {int(r.settings["tag"]): r for r in rosters.boards(roster, tags, console.say)}
        drives = {r.tag: r.controller for r in experiment.robots if r.tag in robots}
        with tempfile.TemporaryDirectory(prefix="vsense-") as folder:
            output = Path(folder) / "vsensed"
            built = build_programs(experiment, set(drives.values()), options.target, output)
            contents = {name: boards.load(each.path) for name, each in built.items()}
        binaries = {robots[tag].destination: contents[name] for tag, name in drives.items()}
        targets = [robots[tag] for tag in drives]
        plan = robot_keys.renewing(replace(how, binaries=binaries), options, targets)
        outcomes = robot_keys.deploy_all(plan, targets)
        if plan.keys is not None:
            robot_keys.note(options, plan.keys, outcomes)
        failed = [one for one in outcomes if not one.ok]
        console.say(
            f"{len(outcomes) - len(failed)} of {len(outcomes)} robots have their controller"
        )
        return {int(o.robot.settings["tag"]): f"was not reached: {o.text}" for o in failed}

    return bring
