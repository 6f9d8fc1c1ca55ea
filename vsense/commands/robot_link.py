"""`vsense robot link`: how good the robots' links are under an experiment's own traffic."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence

from vsense.base.errors import UsageError
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, print_data
from vsense.commands import _arguments, _experiments, _rosters
from vsense.config.experiment import load, of_folder
from vsense.config.specs import Experiment, Stage
from vsense.robots.link.table import ExpectedRobot, Table
from vsense.run import link_check
from vsense.run.link_check import LinkLoad, LinkVerdict, judge, traffic_of

FOR_S, WAIT_S = 60.0, 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    parser.add_argument(
        "robots",
        nargs="?",
        type=_arguments.numbers,
        metavar="TAGS",
        help="these robots, such as 23,30-34 (default: the experiment's; without --experiment"
        " those of the roster that work and are no spares)",
    )
    text = f"measure for so long (default: {FOR_S:g})"
    _arguments.option(parser, "--for", _arguments.seconds, "S", text, FOR_S)
    text = (
        "whose packets and timestep: a shipped experiment's name, or the path of a .argos"
        f" file (default: {_experiments.DEFAULT})"
    )
    _arguments.option(parser, "--experiment", of_folder, "NAME", text)
    _arguments.add_code(parser)
    _rosters.add_casting(parser)
    _add_link(parser)
    _arguments.flag(parser, "--json", "print the figures as JSON")


def _add_link(parser: argparse.ArgumentParser) -> None:
    text = f"begin after S s at the latest, without robots that are missing (default: {WAIT_S:g})"
    _arguments.option(parser, "--wait", _arguments.seconds, "S", text, WAIT_S)
    _arguments.add_link(parser)
    _experiments.add_key(parser)
    _experiments.add_insecure(
        parser, "take robots that have no key, too: anyone on the network can be one", page=False
    )


def run(options: argparse.Namespace) -> int:
    """Loads the links and judges them.

    Returns:
        0; 1 where a robot would not hold the experiment's timestep; 130 after Ctrl-C, 143 after
        SIGTERM, with what was measured by then.
    """
    from vsense.modes.live import opening

    experiment = _experiment(options)
    robots = _robots(options, experiment)
    address = opening.LinkOptions(options.host, options.port).address(experiment)
    trust = opening.trust_of(options.key, options.insecure)
    console = Console()
    opening.say_trust(trust, console.say)
    with (
        interruption() as interrupted,
        opening.lease_robots(robots, options.command, experiment.name, address[0]),
        LinkLoad(robots, experiment.timestep_ns, address, trust, console.say) as link,
    ):
        _announce(experiment, len(robots), (address[0], link.port), console)
        there = link.wait(options.wait, interrupted, console.progress)
        lasted_s = 0.0
        if not interrupted.is_set():
            span_s = vars(options)["for"] if there else 0.0
            lasted_s = link.load(span_s, interrupted, console.progress)
        figures, robots_now = link.measured(), link.robots()
    console.end_progress()
    if not figures:
        console.say("vsense: interrupted before anything was measured")
        return interrupted.code
    if interrupted.is_set():
        console.say(f"vsense: interrupted after {lasted_s:.1f} s: what was measured until then")
    verdicts = [judge(robots_now[tag], figures[tag], experiment.timestep_s) for tag in robots]
    facts = {"experiment": experiment.name, "timestep_s": experiment.timestep_s}
    report = link_check.as_json(verdicts, facts | {"duration_s": round(lasted_s, 3)})
    print_data(json.dumps(report, indent=2) if options.json else link_check.table(verdicts))
    _say_weak(verdicts if options.json else (), console)  # the table has it
    return interrupted.code if interrupted.is_set() else int(not report["holds"])


def _say_weak(verdicts: Sequence[LinkVerdict], console: Console) -> None:
    weak = [verdict for verdict in verdicts if not verdict.holds]
    poorest = link_check.worst(weak)
    if poorest is not None:
        console.say(
            f"vsense: {len(weak)} of {len(verdicts)} links do not hold; robot {poorest.tag}"
            f" ({poorest.name}): {poorest.verdict}"
        )


def _announce(
    experiment: Experiment, count: int, address: tuple[str, int], console: Console
) -> None:
    host, port = address
    period = f"{1e3 * experiment.timestep_s:g} ms"
    console.say(
        f"{count} robot{'s' * (count > 1)}, {experiment.name}'s packets every {period}, on {host},"
        f" port {port}; wheels stand still"
    )
    if host.startswith("127.") or host == "localhost":
        console.say("only robots on this machine reach that address; for others: --host 0.0.0.0")


def _experiment(options: argparse.Namespace) -> Experiment:
    """Whose traffic it is; only where it is named do the roster's robots play its parts."""
    code = _arguments.code_of(options)
    if options.experiment is None:
        if options.replace:
            raise UsageError("--replace: expected --experiment, whose parts they play")
        return load(_experiments.DEFAULT, stage=Stage.RUN, code=code)
    chosen, options.robots = options.robots, None  # it is no number of robots
    casting = _rosters.casting_of(options, here=True)
    options.robots = chosen
    return load(options.experiment, stage=Stage.RUN, code=code, casting=casting)


def _robots(options: argparse.Namespace, experiment: Experiment) -> dict[int, ExpectedRobot]:
    """The robots that are loaded, by tag, with their names and tables.

    Raises:
        UsageError: nobody says which, or the experiment has no such robot.
    """
    tables = {c.id: traffic_of(c) for c in experiment.controllers}
    if options.experiment is not None:
        own = {r.tag: (r.id, tables[experiment.controller_of(r).id]) for r in experiment.robots}
        wanted = list(own) if options.robots is None else options.robots
        for tag in wanted:
            if tag not in own:
                there = ", ".join(map(str, own))
                raise UsageError(f"robot {tag}: {experiment.file} has {there}")
        return {tag: ExpectedRobot(*own[tag]) for tag in wanted}
    roster = _rosters.roster_of(options)
    names = {} if roster is None else {robot.tag: robot.name for robot in roster.robots}
    wanted = options.robots
    if wanted is None and roster is not None:
        wanted = [robot.tag for robot in roster.robots if robot.is_ready]
    if not wanted:
        raise UsageError(
            "which robots? expected TAGS such as 23,30-34, --experiment NAME, or a roster:"
            " --roster FILE"
        )
    table: Table = next(iter(tables.values()))
    return {tag: ExpectedRobot(names.get(tag) or "robot", table) for tag in wanted}
