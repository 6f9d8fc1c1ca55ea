"""`vsense series`: many runs by a plan, without hands."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.terminal import Console, Interruption, interruption, print_data
from vsense.commands import arguments, hardware, lab, rosters, series_robots, sim
from vsense.config.roster import FILE_NAME
from vsense.modes.lab.hardware import BASES
from vsense.modes.sim.job import Setup
from vsense.monitor import recording
from vsense.monitor.ui.access import make_tokens
from vsense.monitor.ui.room import RoomOptions
from vsense.run.runs_csv import MODES, RUNS, read_runs
from vsense.studies.packages import origin
from vsense.studies.series import plan as plans
from vsense.studies.series.folder import SeriesFolder, allowed_changes
from vsense.studies.series.order import Cell, Forecast
from vsense.studies.series.parts import PlanLoader, PlannedExperiment, SeriesCast
from vsense.studies.series.plan import SeriesPlan
from vsense.studies.series.series import RunMaker, SeriesLoop
from vsense.tools.shipped import documents

DESCRIPTION = (
    "Makes many runs by a plan, without hands: conditions at the same starts, in an order that is"
    " shuffled block by block, simulated, in the lab or with real robots. Between runs robots drive"
    " to their starts. A run is valid or void by criteria that the plan has; void ones are kept,"
    " named and repeated. Every run is a row of runs.csv. Ctrl-C costs the run that goes on; the"
    " same command goes on from there, also on another day."
)

EXAMPLE = "plan.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument(
        "plan", nargs="?", type=Path, metavar="PLAN", help="a file such as plan.toml"
    )
    arguments.flag(parser, "--example", "print a plan whose lines are explained, and end")
    arguments.flag(
        parser, "--dry", "only say which runs follow, in which order, and how long they take"
    )
    parser.add_argument("--mode", choices=MODES, help="make the runs there (default: the plan's)")
    text = "folder of the series (default: NAME-MODE beside the plan)"
    arguments.option(parser, "-o --output", Path, "DIR", text)
    arguments.flag(parser, "--json", "print how the series stands in the end as one JSON object")
    text = (
        "go on where a controller asks for a sensor or actuator that nobody offers, or is told a"
        " parameter that it does not read"
    )
    arguments.flag(parser, "--lenient", text)
    arguments.add_code(parser)
    sim.add_on(parser)
    add_making(parser)
    group = parser.add_argument_group("control room")
    arguments.add_locked(group)
    arguments.add_recording(group)


def add_making(parser: argparse.ArgumentParser) -> None:
    """Declares who plays, and how runs are made in each mode."""
    text = "simulated runs at the same time (default: one per processor)"
    arguments.option(parser, "-j --jobs", arguments.positive, "N", text)
    default = f"(default: with real robots {FILE_NAME} in the current folder, otherwise none)"
    rosters.add_casting(parser, default)
    series_robots.add_arguments(parser)
    group = parser.add_argument_group("lab")
    arguments.add_bases(group, BASES)
    lab.add_cameras(group)
    lab.add_pace(group)
    hardware.add_errors(group)
    arguments.add_web(parser, insecure=False)
    arguments.add_foxglove(parser)


def run(options: argparse.Namespace) -> int:
    """Carries a series out; 0, or 130 after Ctrl-C, 143 after SIGTERM."""
    if options.example:
        print_data(documents.find(EXAMPLE).text().rstrip())
        return 0
    if options.plan is None:
        raise UsageError("expected a plan: vsense series --example > plan.toml makes one")
    plan = plans.read(options.plan, options.mode)
    loader, known = load(options, plan)
    path = options.output or plan.path.parent / f"{plan.name}-{plan.mode}"
    if options.dry:
        forecast = forecast_of(plan, known, path, options.pace)
        print_data(json.dumps(forecast.facts(), indent=2) if options.json else forecast.table())
        return 0

    def tell(facts: Mapping[str, Any]) -> None:
        if options.json:
            print_data(json.dumps(facts, indent=2))

    return carry_out(options, loader, known, path, tell)


def load(
    options: argparse.Namespace, plan: SeriesPlan
) -> tuple[PlanLoader, dict[str, PlannedExperiment]]:
    """Loads what the conditions of a plan run; raises as `PlanLoader.load_all`."""
    loader = _loader(options, plan)
    return loader, loader.load_all()


def forecast_of(
    plan: SeriesPlan, known: Mapping[str, PlannedExperiment], path: Path, pace: float
) -> Forecast:
    """What is left of the series in a folder; UsageError: the plan has changed too much."""
    allowed_changes(plan, path)
    table = path / RUNS
    return Forecast(plan, known, read_runs(table) if table.exists() else (), pace)


def carry_out(
    options: argparse.Namespace,
    loader: PlanLoader,
    known: Mapping[str, PlannedExperiment],
    path: Path,
    tell: Callable[[Mapping[str, Any]], None],
) -> int:
    """Makes the runs of a series in a folder; `tell` takes how it stands in the end.

    Returns:
        0 where all are there, else 130 after Ctrl-C, 143 after SIGTERM, or 1.
    """
    plan, console = loader.plan, Console()
    for warning in {text for one in known.values() for text in one.experiment.warnings}:
        console.say(f"vsense: {warning}")
    files = {path for one in known.values() for path in one.files}
    if options.on is not None and plan.mode != "sim":
        raise UsageError("--on: simulated runs only, see --mode sim")
    with interruption() as interrupted, ExitStack() as stack:
        common = loader, known, console, interrupted
        if plan.mode == "sim":
            maker = _simulated(options, *common, stack)
        elif plan.mode == "lab":
            maker = _rendered(options, *common)
        else:
            maker = series_robots.maker(options, *common, _room(options), stack)
        folder = stack.enter_context(SeriesFolder(path, plan, sorted(files)))
        _keep_origin(options, loader, known, folder, console)
        make = partial(maker.make, folder=folder)
        loop = SeriesLoop(plan, folder, make, console, interrupted)
        return _run_all(loop, console, interrupted, tell)


def _keep_origin(
    options: argparse.Namespace,
    loader: PlanLoader,
    known: Mapping[str, PlannedExperiment],
    folder: SeriesFolder,
    console: Console,
) -> None:
    """Keeps what the runs are made from, as it is now."""
    plan, setups = loader.plan, {}
    for name, planned in known.items():
        for start in plan.starts if plan.mode == "sim" else ():
            setups[origin.key_of(name, start.name)] = loader.setup(planned, start)
    made, others = [one.experiment for one in known.values()], options.tracking or ()
    origin.keep(folder.path, plan.mode, made, console.say, setups, others, rows=len(folder.rows))


def _loader(options: argparse.Namespace, plan: SeriesPlan) -> PlanLoader:
    real = plan.mode == "run"
    casting, code = rosters.casting_of(options, found=real), arguments.code_of(options)
    loader = PlanLoader(plan, code, casting, lenient=options.lenient)
    return series_robots.complete(loader, options) if real else loader


def _room(options: argparse.Namespace) -> RoomOptions:
    """How runs are seen and kept; every run is a series' and begins by itself."""
    web = arguments.web_of(options)
    if options.record or options.record_images:
        recording.require()
    others = {"hold": False, "runs": 1, "series": None}
    # One address of the page for all runs.
    tokens = None if web is None else make_tokens()
    return arguments.fill(RoomOptions, options, web=web, tokens=tokens, **others)


def _simulated(
    options: argparse.Namespace,
    loader: PlanLoader,
    known: Mapping[str, PlannedExperiment],
    console: Console,
    interrupted: Interruption,
    stack: ExitStack,
) -> RunMaker:
    """Who simulates runs; `stack` leaves a cluster."""
    from vsense.studies.series.simulated import SimulatedRuns, simulator

    if options.record_images or options.web or options.foxglove:
        raise UsageError("--record-images, --web, --foxglove: in the lab and with robots only")
    if options.record:
        recording.require()
    if options.on is not None:
        sim.check_on(options)
    jobs = options.jobs or len(os.sched_getaffinity(0))
    simulate = stack.enter_context(simulator(options.on, jobs, console, interrupted))

    def setup_of(planned: PlannedExperiment, cell: Cell) -> Setup:
        return loader.setup(planned, loader.plan.start(cell.start))

    reported = [text for planned in known.values() for text in planned.experiment.warnings]
    return SimulatedRuns(
        loader.plan,
        known,
        setup_of,
        simulate,
        console,
        interrupted,
        record=options.record,
        reported=reported,
    )


def _rendered(
    options: argparse.Namespace,
    loader: PlanLoader,
    known: Mapping[str, PlannedExperiment],
    console: Console,
    interrupted: Interruption,
) -> RunMaker:
    from vsense.studies.series.rendered import LabOptions, LabRuns

    for planned in known.values():
        lab.set_pace(options.pace, planned.experiment.host)
    made = arguments.fill(
        LabOptions,
        options,
        watchdog=options.firmware_watchdog,
        room=_room(options),
        robots=partial(hardware.robots_of, options),
    )
    cast = SeriesCast(known, console)
    return LabRuns(loader, cast, console, interrupted, made)


def _run_all(
    loop: SeriesLoop,
    console: Console,
    interrupted: Interruption,
    tell: Callable[[Mapping[str, Any]], None],
) -> int:
    """Makes the runs, and says how the series stands, also where one has failed."""
    try:
        loop.run()
    finally:
        console.end_progress()
        console.say(loop.in_words())
        tell(loop.facts())
    if not loop.end_reason:
        return 0
    console.say(f"{loop.end_reason}: the same command goes on from there")
    return interrupted.code if interrupted.is_set() else 1
