"""`vsense robot`: the daemon for the robots' boards, built and brought there."""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

from vsense.base.errors import UsageError
from vsense.base.terminal import Console, print_data
from vsense.commands import (
    _arguments,
    _deployments,
    _experiments,
    _rosters,
    robot_emulate,
    robot_init,
    robot_keys,
    robot_link,
    robot_list,
    robot_measure,
)
from vsense.config.casting import Casting
from vsense.config.experiment import first_robots, load, of_folder
from vsense.config.roster import Roster
from vsense.config.specs import Experiment
from vsense.robots import boards, deploying, finding, key_holders
from vsense.robots.boards import Built
from vsense.robots.build import cache_directory, source_tree
from vsense.robots.deploying import Part, Plan, RobotHost
from vsense.robots.sources import ProgramSources, folders, stem_of

DESCRIPTION = (
    "What a lab does with its robots' boards. 'build' makes the daemon vsensed with a controller"
    " in it, one static file for a kind of board. 'init' writes the roster robots.toml: the lab's"
    " robots, their markers, and how they are reached; 'list' shows it. 'deploy' copies the daemon"
    " to all of them with ssh, each its own where an experiment has several, writes each robot's"
    " settings, gives each a"
    " key of its own, so that nobody else moves it, and has it start with the board. 'keys' makes"
    " the swarm's key that theirs are made of, and says which robots have which. 'status' shows"
    " which are connected to the `vsense run` or `vsense lab` on this machine: software and"
    " controller, link, pose, battery, base errors, and what is wrong. 'emulate' stands in for"
    " robots and tracker: a `vsense run` rehearsed at a desk. 'calibrate' drives robots below the"
    " cameras, hands off, and finds their wheels, where their markers sit, and what their own"
    " sensors read. 'check' says which robots are there and, with --wiggle, turns one robot after"
    " the other: the marker that turns must be its own. 'link'"
    " loads all robots with an experiment's traffic, standing still, and names the worst link."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True, dest="action")
    add = partial(_arguments.add_action, actions)
    _add_build(add("build", "build vsensed with a controller for a board"))
    _add_deploy(add("deploy", "copy vsensed to the robots of the roster"))
    robot_keys.add_arguments(add("keys", "make the swarm's key, and see which robots have which"))
    robot_emulate.add_arguments(
        add("emulate", "emulate robots with their bases, and a tracker, for a vsense run")
    )
    robot_measure.add_calibrate(
        add("calibrate", "measure robots' wheels, markers and sensors with the overhead cameras")
    )
    robot_measure.add_check(
        add("check", "say which robots are there, and whether each robot wears its own marker")
    )
    robot_link.add_arguments(
        add("link", "measure the robots' links under an experiment's own traffic, standing still")
    )
    robot_init.add_arguments(add("init", "write the roster, or add robots to it"))
    robot_list.add_arguments(add("list", "show the lab's robots: the roster"))
    status = add("status", "show the robots of the running experiment, or all of the roster")
    robot_list.add_status(status)


def _add_build(parser: argparse.ArgumentParser) -> None:
    kinds = "; ".join(f"{target.name}: {target.help}" for target in boards.TARGETS.values())
    what = parser.add_mutually_exclusive_group(required=True)
    text = (
        "the controller's .c, .cpp or .onnx file, a shipped controller's name, or for ARGoS a"
        " library whose files --sources names, or a folder of sources"
    )
    _arguments.option(what, "--controller", str, "FILE", text)
    text = (
        "a daemon for each controller that robots of this experiment run: a shipped one's"
        " name, or the path of a .argos file, or of its folder; of several, -o is followed by the"
        " controller's id"
    )
    _arguments.option(what, "--experiment", of_folder, "NAME", text)
    text = f"kind of board. {kinds}"
    _arguments.choice(parser, "--target", list(boards.TARGETS), text, required=True)
    _arguments.option(
        parser, "-o --output", Path, "FILE", "where it goes (default: vsensed)", Path("vsensed")
    )
    _arguments.flag(parser, "--json", "print what was built as JSON")
    _add_code(parser)


def _add_code(parser: argparse.ArgumentParser) -> None:
    _arguments.add_code(parser)
    text = (
        "with --controller: which of the controllers that its sources register for ARGoS"
        " (default: the only one)"
    )
    _arguments.option(parser, "--label", str, "LABEL", text, "")


def _add_deploy(parser: argparse.ArgumentParser) -> None:
    _rosters.add_roster(
        parser,
        "the lab's robots, a table [[robot]] each with tag = 23 and host = what ssh connects to;"
        " what was measured of one becomes its settings",
    )
    _rosters.add_tags(parser)
    _rosters.add_replace(parser, "with --experiment: bring 37 the controller that 23 runs")
    _add_what(parser)
    _add_code(parser)
    text = "numeric IPv4 address of the machine that `vsense run` will run on"
    _arguments.option(parser, "--host", str, "ADDRESS", text)
    _arguments.option(parser, "--port", _arguments.port, "P", "its port (default: 4050)", 4050)
    text = (
        "what turns the robots' wheels: argos:/dev/ttyS0, or a board's name, such as pipuck;"
        " see vsensed --help"
    )
    _arguments.option(parser, "--base", str, "BASE", text)
    _experiments.add_key(parser)
    _experiments.add_insecure(
        parser, "bring no keys: the robots obey anyone on the network", page=False
    )
    _add_ways(parser)
    text = "send nothing: say what each robot would be sent, and what would be done there"
    _arguments.flag(parser, "--dry", text)


def _add_what(parser: argparse.ArgumentParser) -> None:
    _arguments.option(
        parser, "--binary", Path, "FILE", "the daemon, from `vsense robot build` (default: vsensed)"
    )
    text = (
        "replace the controller alone: build a daemon with this .c, .cpp or .onnx file, or"
        " shipped controller, for --target, and send that; settings and service stay as they are"
    )
    _arguments.option(parser, "--controller", str, "FILE", text)
    text = (
        "bring each robot, by its tag, the controller that it runs in this experiment: a"
        " shipped one's name, or the path of a .argos file; they are built for --target. With"
        " --host settings and service go with it, without it they stay as they are"
    )
    _arguments.option(parser, "--experiment", of_folder, "NAME", text)
    text = f"with --experiment: {_experiments.ROBOTS}"
    _arguments.option(parser, "--robots", _arguments.positive, "N", text)
    text = (
        "with --controller or --experiment: kind of board, as in `vsense robot build`"
        " (default: epuck)"
    )
    _arguments.choice(parser, "--target", list(boards.TARGETS), text, "epuck")
    text = (
        "send nothing: each robot goes back to the daemon before this one and its settings;"
        " a second time, forth again"
    )
    _arguments.flag(parser, "--rollback", text)


def _add_ways(parser: argparse.ArgumentParser) -> None:
    text = (
        "what starts it on the robots: a systemd unit, an init script, or nothing (default:"
        " auto, by what the board has)"
    )
    _arguments.choice(parser, "--service", ["auto", "systemd", "init", "none"], text, "auto")
    text = "have each robot look whether its base, network and clock are well (vsensed --check)"
    _arguments.flag(parser, "--check", text)
    robot_keys.add_reach(parser)


def run(options: argparse.Namespace) -> int:
    """Runs an action; 0, or 1 where a robot was not served."""
    actions = {
        "build": build,
        "deploy": deploy,
        "keys": robot_keys.run,
        "emulate": robot_emulate.run,
        "calibrate": robot_measure.calibrate,
        "check": robot_measure.check,
        "link": robot_link.run,
        "init": robot_init.run,
        "list": robot_list.run,
        "status": robot_list.status,
    }
    return actions[options.action](options)


def build(options: argparse.Namespace) -> int:
    """Builds `vsensed` for a board and says what it is."""
    if options.experiment is None:
        built = [_compiled(_program(options), options.target, options.output)]
    else:
        experiment = load(options.experiment, code=_arguments.code_of(options))
        driving = {robot.controller for robot in experiment.robots}
        built = list(build_programs(experiment, driving, options.target, options.output).values())
    facts = [asdict(b) | {"path": str(b.path), "controller": str(b.controller)} for b in built]
    if options.json:
        print_data(json.dumps(facts[0] if options.experiment is None else facts, indent=2))
        return 0
    for program in built:
        print_data(
            f"{program.path}: {program.size} bytes for {program.target},"
            f" controller {program.controller.name} {program.hash}"
        )
    return 0


def _compiled(program: ProgramSources, target: str, output: Path) -> Built:
    """Builds a daemon; says so where that takes long, as the first one for a target does."""
    with Console().patience(f"compiling {program.name} for {target} (minutes the first time)"):
        return boards.build(program, target, output)


def _program(options: argparse.Namespace) -> ProgramSources:
    """The program that `--controller` names, with `--sources` and `--include`."""
    code, name = _arguments.code_of(options), options.controller
    extra = folders(code.includes, Path.cwd(), cache_directory()) if code.includes else []
    patterns = code.patterns(stem_of(name))
    if not patterns and os.path.isdir(name):
        patterns = [name]
    named = finding.named(patterns, Path.cwd(), name, options.label, extra)
    program = named or source_tree().program(name)
    if named is None and program.is_argos:
        program = finding.complete(program.sources, options.label, None, extra)
    return program


def build_programs(
    experiment: Experiment, driving: Collection[str], target: str, output: Path
) -> dict[str, Built]:
    """Builds the daemons of the controllers that are `driving`, by their ids."""
    specs = [spec for spec in experiment.controllers if spec.id in driving]
    several = len(specs) > 1
    built = {}
    for spec in specs:
        path = output.with_name(f"{output.name}-{spec.id}") if several else output
        built[spec.id] = _compiled(spec.program, target, path)
    return built


def deploy(options: argparse.Namespace) -> int:
    """Brings `vsensed` to the robots of a roster; prints a table of the outcomes."""
    roster = _rosters.wanted_roster(options)
    robots = _rosters.boards(roster, options.tags, Console().say)
    with tempfile.TemporaryDirectory(prefix="vsense-") as folder:
        plan, robots = _plan(options, roster, robots, Path(folder))
    robots = deploying.with_drivers(plan, robots, roster.path.parent)
    if plan.part is Part.ALL:
        deploying.check(plan, robots, str(roster.path))
        if not options.insecure:
            keys = _experiments.trust_of(options).keys
            holders = key_holders.read(robot_keys.holders_of(options))
            plan = replace(plan, keys=keys, uids=key_holders.uids(holders, robots))
    elif plan.part is Part.DAEMON:
        plan = robot_keys.renewing(plan, options, robots)
    if options.dry:
        _deployments.say_planned(plan, robots, options.json)
        return 0
    outcomes = robot_keys.bring(plan, options, robots)
    _deployments.say(outcomes, options.json)
    return 0 if all(outcome.ok for outcome in outcomes) else 1


_WHAT = ("binary", "controller", "experiment", "rollback")


def _plan(
    options: argparse.Namespace, roster: Roster, robots: list[RobotHost], folder: Path
) -> tuple[Plan, list[RobotHost]]:
    """What the options say, and for whom; a daemon that is built first is built in the folder."""
    chosen = [f"--{name}" for name in _WHAT if vars(options)[name]]
    if len(chosen) > 1:
        raise UsageError(f"{' and '.join(chosen)}: expected one of them")
    settings = {"host": options.host, "port": str(options.port), "base": options.base}
    plan = Plan(
        settings={name: value for name, value in settings.items() if value is not None},
        kind=options.service,
        sudo=options.sudo,
        check=options.check,
        force=options.force,
        ssh_options=tuple(options.ssh_option),
    )
    if options.rollback:
        return replace(plan, part=Part.BACK), robots
    if options.experiment is not None:
        part = Part.DAEMON if options.host is None else Part.ALL
        binaries = _binaries(options, roster, robots, folder / "vsensed")
        played = [robot for robot in robots if robot.destination in binaries]
        return replace(plan, binaries=binaries, part=part), played
    if options.controller is None:
        binary, part = boards.load(options.binary or Path("vsensed")), Part.ALL
    else:
        built = _compiled(_program(options), options.target, folder / "vsensed")
        binary, part = boards.load(built.path), Part.DAEMON
    return replace(plan, binaries={r.destination: binary for r in robots}, part=part), robots


def _binaries(
    options: argparse.Namespace, roster: Roster, robots: Sequence[RobotHost], output: Path
) -> dict[str, bytes]:
    """Builds what each robot runs in an experiment, by its destination.

    Where all of them run the same, whoever has no part in it, as a spare, is brought that, too.
    """
    casting = Casting.of(roster, options.replace, options.robots)
    code = _arguments.code_of(options)
    loaded = load(options.experiment, code=code, casting=casting)
    experiment = first_robots(loaded, options.robots)
    parts = {robot.tag: robot.controller for robot in experiment.robots}
    for robot in roster.robots if options.tags is None else ():
        if robot.tag in parts:  # a run would lack it
            _rosters.check_host(roster, robot)
    alike = set(parts.values())
    driven, idle = {}, []
    for board in robots:
        tag = int(board.settings["tag"])
        controller = parts.get(tag, *alike) if len(alike) == 1 else parts.get(tag)
        if controller is None:
            idle.append(tag)
        else:
            driven[board.destination] = controller
    if idle:
        _say_idle(experiment, idle, driven)
    return built_for(experiment, driven, options.target, output)


def built_for(
    experiment: Experiment, driven: Mapping[str, str], target: str, output: Path
) -> dict[str, bytes]:
    """Builds what robots run: daemons of their controllers' ids, both by robots' destinations."""
    built = build_programs(experiment, set(driven.values()), target, output)
    contents = {name: boards.load(program.path) for name, program in built.items()}
    return {destination: contents[name] for destination, name in driven.items()}


def _say_idle(experiment: Experiment, idle: Sequence[int], driven: Collection[str]) -> None:
    """Says who is brought nothing, and how a spare is brought a part's controller."""
    tags = " ".join(map(str, idle))
    text = f"{experiment.file} has no part for {tags}: --replace TAG={idle[0]} brings one's"
    if not driven:
        expected = ", ".join(str(robot.tag) for robot in experiment.robots)
        raise UsageError(f"{text}; its robots are {expected}")
    Console().say(text)
