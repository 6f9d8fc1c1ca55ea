"""`vsense sim`: an experiment without cameras, network or robots, faster than real time."""

from __future__ import annotations

import argparse
import os
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vsense.commands import arguments, experiments
from vsense.config.specs import Experiment, Stage
from vsense.errors import UsageError, VsenseError
from vsense.lab.metrics import swarm_rows
from vsense.run import directory as run_directory
from vsense.run.programs import shared_objects
from vsense.sim import campaign
from vsense.sim.campaign import Campaign
from vsense.sim.dask_cluster import require_dask
from vsense.sim.job import Job, Setup, Sweep
from vsense.sim.outcome import Interrupted, Task
from vsense.sim.record import LOGGED, TRAJECTORY
from vsense.sim.watch import WorkerProcess, simulate_all
from vsense.terminal import Console, interruption

DESCRIPTION = (
    "Runs an experiment in this machine alone: the same controller, compiled once and run in one"
    " process for every robot, with the lab's wheels and proximity sensors, the same virtual world,"
    " and neither cameras nor network. A seed gives the same run every time. With --runs, --seeds"
    " or several values of a setting it is a campaign: one row of a CSV file for every run, and a"
    " picture that compares the settings. --on has a cluster do its runs."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    experiments.add_experiment(parser)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="PATH",
        help="folder of a run (default: runs/...), or a campaign's CSV file (default: results.csv)"
        " or its picture (.png, .svg, .pdf); the other one lies beside it",
    )
    _add_campaign(parser)
    arguments.add_charts(parser)


def _add_campaign(parser: argparse.ArgumentParser) -> None:
    """Declares what makes a campaign."""
    campaign = parser.add_argument_group("campaign")
    campaign.add_argument(
        "--runs",
        type=arguments.positive,
        metavar="N",
        help="runs of every setting, with the seeds 1 to N unless --seeds says which",
    )
    arguments.option(
        campaign, "--seeds", arguments.numbers, "LIST", "their seeds, such as 1-100 or 1,2,10-12"
    )
    campaign.add_argument(
        "--set",
        type=arguments.setting,
        action="append",
        default=[],
        metavar="ELEMENT.ATTRIBUTE=VALUE[,VALUE...]",
        help="values instead of the file's, each in turn; values with commas of their own are"
        " separated by semicolons. ELEMENT is an element's name or id, a controller's library (for"
        " its parameters), 'sensor' or 'actuator' (for all virtual ones). Several --set: all"
        " combinations",
    )
    campaign.add_argument(
        "-j",
        "--jobs",
        type=arguments.positive,
        metavar="N",
        help="runs at the same time (default: one per processor)",
    )
    campaign.add_argument(
        "--on",
        type=arguments.scheduler,
        metavar="tcp://HOST:PORT",
        help="do the runs on the workers of this Dask scheduler, with the same results; they need"
        " this vsense, a compiler, and the experiment's files in the same place",
    )


def run(options: argparse.Namespace) -> int:
    """Runs an experiment or a campaign; 0, or 130 after Ctrl-C, 143 after SIGTERM."""
    sweep = Sweep.of(options.set, options.runs, options.seeds)
    if options.on is not None:
        _check_on(options, sweep)
    settings = sweep.first
    experiment = experiments.open_experiment(options, settings, Stage.SIM)
    if experiment is None:
        return 0
    setup = Setup(
        *(options.experiment, options.duration, options.robots, options.blind, settings),
        arguments.code_of(options),
    )
    experiment = setup.fit(experiment)
    console = Console()
    experiments.say_warnings(console, experiment)
    with interruption() as interrupted:
        try:
            if sweep.seeds is None:
                if options.format or options.style:
                    raise UsageError("--format, --style: a campaign's chart only, see --runs")
                return _one(options, setup, experiment, console, interrupted)
            if options.seed is not None:
                raise UsageError("--seed: a campaign has --seeds")
            output, drawing = campaign.outputs(options.output, options.format)
            files = {"output": output, "drawing": drawing}
            jobs = options.jobs or len(os.sched_getaffinity(0))
            asked = arguments.fill(Campaign, options, sweep=sweep, setup=setup, jobs=jobs, **files)
            campaign.run(asked, console, interrupted)
            return 0
        except Interrupted:
            console.end_progress()
            return interrupted.code


def _check_on(options: argparse.Namespace, sweep: Sweep) -> None:
    """Refuses what does not go with --on."""
    if sweep.seeds is None:
        raise UsageError("--on: a campaign only, see --runs")
    if options.jobs is not None:
        raise UsageError("-j: with --on the cluster has as many at a time as its workers take")
    require_dask()


def _one(
    options: argparse.Namespace,
    setup: Setup,
    experiment: Experiment,
    console: Console,
    interrupted: threading.Event,
) -> int:
    """One run: figures, trajectories, and a table for people."""
    seed = experiments.choose_seed(options, experiment)
    libraries = {name: str(path) for name, path in shared_objects(experiment).items()}
    directory = run_directory.make(options.output, experiment.name, seed)
    console.say(
        f"{experiment.name}: {len(experiment.robots)} robots, seed {seed},"
        f" {experiment.length_s:g} s; results in {directory}"
    )
    job = Job(setup, seed, libraries, str(directory))

    def show(workers: Sequence[WorkerProcess[Task]]) -> None:
        done = max(worker.timesteps for worker in workers)
        time_s = done * experiment.timestep_s
        console.progress(f"{time_s:6.1f}/{experiment.length_s:g} s  timestep {done}")

    try:
        for _, result in simulate_all([Task(job, experiment)], 1, interrupted, show):
            console.end_progress()
            summary = summarise(job, result)
            _tell(console, result, directory)
            run_directory.write_summary(directory, summary, options.json)
            console.say(table(summary))
    except VsenseError:
        console.end_progress()
        console.say(f"the run has failed; what there is of it: {directory}")
        raise
    console.say(f"trajectories: {directory / TRAJECTORY}")
    console.say(f"picture: {directory / experiment.name}.png")
    return 0


def _tell(console: Console, result: dict[str, Any], directory: Path) -> None:
    """Says what controllers complained of, and the first of what they logged."""
    for complaint in result["complaints"]:
        console.say(f"vsense: {complaint}")
    for time_s, text in result["events"]:
        console.say(f"{time_s:8.1f} s  {text}")
    more = result["events_in_all"] - len(result["events"])
    if more:
        console.say(f"{more} more events: {directory / LOGGED}")


def summarise(job: Job, result: dict[str, Any]) -> dict[str, Any]:
    """Gives a run's figures under the names that scripts rely on."""
    duration_s = result["timesteps"] * result["timestep_s"]
    return {
        "experiment": result["name"],
        "seed": job.seed,
        "blind": job.setup.blind,
        "settings": dict(job.setup.settings),
        "robots": result["robots"],
        "timesteps": result["timesteps"],
        "duration_s": round(duration_s, 3),
        "speedup": round(duration_s / result["wall_s"], 1),
        "swarm": result["swarm"],
        "measures": result["measures"],
    }


def table(summary: dict[str, Any]) -> str:
    """The summary as a person reads it."""
    text = (
        f"{summary['duration_s']:g} s of {summary['robots']} robots,"
        f" {summary['speedup']:g} times as fast as real time"
    )
    rows = [("run", text)]
    rows += swarm_rows(summary["swarm"], summary["robots"])
    rows += [("measure", f"{name} = {value:g}") for name, value in summary["measures"].items()]
    return "\n".join(f"{name:<10}{text}" for name, text in rows)
