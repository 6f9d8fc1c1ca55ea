"""`vsense sim`: an experiment without cameras, network or robots, faster than real time."""

from __future__ import annotations

import argparse
import math
import re
from pathlib import Path

from vsense.base.errors import UsageError
from vsense.commands import _arguments, _experiments, report
from vsense.config.specs import Stage
from vsense.modes.sim.job import SimOptions, Sweep

DESCRIPTION = (
    "Runs an experiment in this machine alone: the same controller, compiled once and run in one"
    " process for every robot, with the lab's wheels and proximity sensors, the same virtual world,"
    " and neither cameras nor network. A seed gives the same run every time. With --runs, --seeds"
    " or several values of a setting it is a campaign: one row of a CSV file for every run, and a"
    " picture that compares the settings. --on has a cluster do its runs. --web shows a run in the"
    " page: play, pause, one step, any speed; the results are the same."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    _experiments.add_experiment(parser, Stage.SIM)
    text = (
        "folder of a run (default: runs/...), or a campaign's CSV file (default: results.csv)"
        " or its picture (.png, .svg, .pdf); the other one lies beside it"
    )
    _arguments.option(parser, "-o --output", Path, "PATH", text)
    _add_page(parser)
    _add_campaign(parser)
    report.add_charts(parser)


def _add_page(parser: argparse.ArgumentParser) -> None:
    _arguments.add_web(parser)
    _experiments.add_foxglove(parser)
    group = parser.add_argument_group("watching and recording")
    _arguments.option(
        group,
        "--speed",
        _speed,
        "X",
        "with --web, begin at X times real time, 0.1 or more; max: as fast as it goes (default: 1)",
    )
    _arguments.flag(group, "--hold", "with --web, begin paused")
    _experiments.add_locked(group)
    _arguments.flag(
        group,
        "--record",
        "record every run to an MCAP file, for vsense replay, report and export: about 0.5 MB a"
        " minute for 15 robots; of a campaign, a file for each run in a folder beside its CSV file",
    )


def _add_campaign(parser: argparse.ArgumentParser) -> None:
    campaign = parser.add_argument_group("campaign")
    text = "runs of every setting, with the seeds 1 to N unless --seeds says which"
    _arguments.option(campaign, "--runs", _arguments.positive, "N", text)
    _arguments.option(
        campaign, "--seeds", _arguments.numbers, "LIST", "their seeds, such as 1-100 or 1,2,10-12"
    )
    text = (
        "values instead of the file's, each in turn; values with commas of their own are"
        " separated by semicolons. ELEMENT is an element's name or id, a controller's library (for"
        " its parameters), 'sensor' or 'actuator' (for all virtual ones). Several --set: all"
        " combinations"
    )
    _arguments.repeated(
        campaign, "--set", _arguments.setting, "ELEMENT.ATTRIBUTE=VALUE[,VALUE...]", text
    )
    text = "runs at the same time (default: one per processor)"
    _arguments.option(campaign, "-j --jobs", _arguments.positive, "N", text)
    add_on(campaign)


def add_on(parser: argparse._ActionsContainer) -> None:
    """Declares the cluster that simulates."""
    text = (
        "do the runs on the workers of this Dask scheduler, with the same results; they need"
        " this vsense, a compiler, and the experiment's files in the same place"
    )
    _arguments.option(parser, "--on", scheduler, "tcp://HOST:PORT", text)


def _speed(text: str) -> float:
    """How fast a simulation goes: times real time, infinite for "max"."""
    value = math.inf if text == "max" else _arguments.read_number(text, float, "a number, or max")
    if not value >= 0.1:
        raise argparse.ArgumentTypeError(f"{text}: expected 0.1 or more, or max")
    return value


_SCHEDULER = r"(?:tcp|tls)://(?:[^\s/:@\[\]]+|\[[0-9A-Fa-f:.]+(?:%[^\s\[\]]+)?\]):([0-9]{1,5})"


def scheduler(text: str) -> str:
    """The address of a Dask scheduler, tcp://HOST:PORT or tls://HOST:PORT."""
    match = re.fullmatch(_SCHEDULER, text)
    if match is None or not 1 <= int(match[1]) <= 65_535:
        raise argparse.ArgumentTypeError(
            f"'{text}': expected the address of a Dask scheduler, such as tcp://192.168.1.5:8786"
        )
    return text


def run(options: argparse.Namespace) -> int:
    """Runs an experiment or a campaign; 0, or 130 after Ctrl-C, 143 after SIGTERM."""
    sweep = Sweep.of(options.set, options.runs, options.seeds)
    _check(options, sweep.seeds is not None)
    asked = _experiments.options_of(options, Stage.SIM, sweep.first)
    if sweep.seeds is None:
        doors = _experiments.doors_of(options)
        single = _arguments.fill(SimOptions, options, experiment=asked, **doors)
        single.check()
        if _experiments.is_dry(options, asked):
            return 0
        from vsense.modes.sim import experiment  # what is only described waits for no simulation

        return experiment.run(single)
    from vsense.studies.series import campaign  # a single run begins sooner without it

    many = _arguments.fill(campaign.CampaignOptions, options)
    many.check()
    return 0 if _experiments.is_dry(options, asked) else campaign.simulate(asked, sweep, many)


def _check(options: argparse.Namespace, many: bool) -> None:
    """Refuses what does not go with one run, or with many."""
    if not many:
        if options.on is not None:
            raise UsageError("--on: a campaign only, see --runs")
        if options.format or options.style:
            raise UsageError("--format, --style: a campaign's chart only, see --runs")
        paged = {"--hold": options.hold, "--speed": options.speed, "--foxglove": options.foxglove}
        if options.web is None and (given := [name for name, value in paged.items() if value]):
            raise UsageError(f"{', '.join(given)}: only with --web, which shows the run")
        return
    report.check_charts(options)
    if options.seed is not None:
        raise UsageError("--seed: a campaign has --seeds")
    if options.web or options.hold or options.speed or options.foxglove:
        raise UsageError(
            "--web, --foxglove, --hold, --speed: one run only, no campaign (--runs, --seeds)"
        )
