"""A campaign: many runs of one experiment, with every combination of settings and every seed."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.errors import UsageError, VsenseError
from vsense.base.terminal import Console, Interruption, print_data
from vsense.modes.sim import dask_cluster, fingerprint
from vsense.modes.sim.engine import Engine
from vsense.modes.sim.job import Job, Setup, Sweep
from vsense.modes.sim.outcome import Interrupted, Task
from vsense.modes.sim.recordings import CampaignRecordings, recording_of, recordings_of
from vsense.modes.sim.results import CampaignResults, Key
from vsense.modes.sim.watch import Show, WorkerProcess, simulate_all
from vsense.run import asked
from vsense.run.programs import shared_objects
from vsense.run.runs_csv import condition_of
from vsense.studies.report import FORMATS, can_draw, lacking

BAR_WIDTH = 24


@dataclass(frozen=True, slots=True)
class Campaign:
    """The options of a campaign.

    Attributes:
        output: the CSV file.
        drawing: the picture's file.
        style: of the picture: a Matplotlib style sheet or its name, or None.
        jobs: runs at the same time on this machine.
        on: address of a Dask cluster that does the runs instead; None: this machine does.
        json: print the figures on standard output.
        lenient: see `prepare`.
        record: every run has a recording, in the folder that `recordings_of` names.
    """

    sweep: Sweep
    setup: Setup
    output: Path
    drawing: Path
    style: str | None = None
    jobs: int = 1
    json: bool = False
    on: str | None = None
    lenient: bool = False
    record: bool = False


def run(
    campaign: Campaign,
    console: Console,
    interrupted: Interruption,
    engine: Engine | None = None,
    begin: Callable[[], None] = lambda: None,
) -> None:
    """Does all runs that the file does not hold yet, and compares the settings.

    Rows are written in the order of the campaign, wherever and in whatever order runs are done.

    Args:
        engine: does the runs, on other machines; None: as `Campaign.on` says.
        begin: is called when all is checked, before the first run.

    Raises:
        Interrupted: the user has ended it; the rows until then are in the file.
        CutShort: likewise, while a cluster was connected or the results were drawn.
        VsenseError: it cannot run, or a run has failed.
    """
    if campaign.style is not None and can_draw():
        from vsense.studies.report import plot  # with all that draws

        plot.require_sheet(campaign.style)
    with ExitStack() as stack:
        if campaign.on is not None and engine is None:
            cluster = dask_cluster.connected(campaign.on, console, interrupted)
            engine = stack.enter_context(cluster)
        results = _complete(campaign, engine, console, interrupted, begin)
    with interrupted.in_time():
        _report(campaign, results, console)


def _complete(
    campaign: Campaign,
    engine: Engine | None,
    console: Console,
    interrupted: Interruption,
    begin: Callable[[], None],
) -> CampaignResults:
    """Does the runs that are missing; raises as `run`."""
    sweep, path = campaign.sweep, campaign.output
    folder = recordings_of(path) if campaign.record else None
    tasks = prepare(sweep, campaign.setup, campaign.lenient, folder)
    results = CampaignResults(path, fingerprint.of_campaign(tasks[0]))
    there = results.keys()
    todo = [task for task in tasks if _key(task) not in there]
    if results.repaired:
        console.say(f"{path}: its last row was cut short: that run is done again")
    if len(todo) < len(tasks):
        console.say(f"{path}: {len(tasks) - len(todo)} of {len(tasks)} runs are there already")
    begin()
    simulate = partial(simulate_all, processes=campaign.jobs) if engine is None else engine.simulate
    try:
        told = set(tasks[0].experiment.warnings)
        kept = None if folder is None else CampaignRecordings(folder, todo, len(tasks), console)
        _simulate(todo, simulate, results, console, interrupted, told, kept)
    except Interrupted:
        done = len(tasks) - len(todo) + len(results.rows) - len(there)
        console.end_progress()
        console.say(f"{path}: {done} of {len(tasks)} runs; the same command goes on from there")
        raise
    console.end_progress()
    if kept is not None:
        kept.say()
    return results


def outputs(output: Path | None, form: str | None) -> tuple[Path, Path]:
    """The campaign's CSV file and its picture's.

    The picture's format, one of `FORMATS`, is `form` or the suffix of --output.

    Raises:
        UsageError: the suffix says something else than `form`.
    """
    output = output or Path("results.csv")
    suffix = output.suffix[1:]
    if suffix not in FORMATS:
        return output, output.with_suffix(f".{form or 'png'}")
    if form not in (None, suffix):
        raise UsageError(f"--format {form}: --output {output} says {suffix}")
    return output.with_suffix(".csv"), output


def prepare(
    sweep: Sweep, setup: Setup, lenient: bool = False, recordings: Path | None = None
) -> list[Task]:
    """Makes all runs; a setting that cannot be had is found before the first one.

    `recordings` is the folder of their recordings, None: there are none.

    Raises:
        VsenseError: an experiment cannot be loaded, or a controller not be built; or, unless
            `lenient`, it asks for what nobody offers or is told what it does not read.
    """
    tasks = []
    for number, settings in enumerate(sweep.combinations(), 1):
        changed = replace(setup, settings=settings)
        experiment = changed.load()
        if not lenient:
            asked.check(experiment)
        libraries = {name: str(path) for name, path in shared_objects(experiment).items()}
        for seed in sweep.seeds or ():
            label = ", ".join([*_words(settings), f"seed {seed}"])
            kept = recordings and str(recording_of(recordings, number, settings, seed))
            job = Job(changed, seed, libraries, recording=kept or None)
            tasks.append(Task(job, experiment, label))
    return tasks


def _words(settings: Mapping[str, str]) -> list[str]:
    return [f"{key} {value}" for key, value in settings.items()]


def _simulate(
    todo: Sequence[Task],
    simulate: Callable[..., Iterator[tuple[Task, dict[str, Any]]]],
    results: CampaignResults,
    console: Console,
    interrupted: threading.Event,
    told: set[str],
    kept: CampaignRecordings | None = None,
) -> None:
    """Does the runs and appends their rows in the runs' order.

    What is not right in a combination's file, or with its controllers, is said once, unless it is
    among the warnings that were `told` before.
    """
    finished: dict[int, dict[str, Any]] = {}
    number = {id(task): place for place, task in enumerate(todo)}
    written = 0
    show = _progress(console, todo, lambda: written + len(finished))
    for task, result in simulate(todo, interrupted=interrupted, show=show):
        finished[number[id(task)]] = result
        while written in finished:
            _append(results, todo[written], done := finished.pop(written))
            _warn(console, todo[written], done["complaints"], told)
            if kept is not None:
                kept.add(done["recording"])
            written += 1
    if todo:
        show(())


def _warn(console: Console, task: Task, complaints: Sequence[str], told: set[str]) -> None:
    """Says what a run of a combination warns of, and what was not `told` yet."""
    settings = ", ".join(_words(task.job.setup.settings))
    for warning in (*task.experiment.warnings, *complaints):
        words = f"{settings}: {warning}" if settings else warning
        if not told & {words, warning}:
            told.add(words)
            console.end_progress()
            console.say(f"vsense: {words}")


def _key(task: Task) -> Key:
    setup = task.job.setup
    return condition_of(setup.blind, setup.settings), task.job.seed


def _append(results: CampaignResults, task: Task, result: dict[str, Any]) -> None:
    swarm = {name: value for name, value in result["swarm"].items() if task.experiment.sources}
    fixed = {
        "name": result["name"],
        "duration_s": float(result["timesteps"] * result["timestep_s"]),
        "tags": [robot.tag for robot in task.experiment.robots],
    }
    results.append(task.job.setup, task.job.seed, fixed, {**swarm, **result["measures"]})


def _progress(console: Console, todo: Sequence[Task], count: Callable[[], int]) -> Show:
    """Makes the function that draws the progress bar."""
    begun_s = time.monotonic()

    def show(workers: Sequence[WorkerProcess[Task]]) -> None:
        under_way = sum(
            worker.timesteps / worker.task.experiment.timesteps for worker in workers if worker.task
        )
        share = (count() + under_way) / len(todo)
        full = round(BAR_WIDTH * share)
        left = ""
        if share > 0.0:
            left_s = round((time.monotonic() - begun_s) * (1.0 - share) / share)
            left = f"  {left_s // 60}:{left_s % 60:02d} left"
        bar = "#" * full + "." * (BAR_WIDTH - full)
        console.progress(f"[{bar}] {count()} of {len(todo)} runs{left}")

    return show


def _report(campaign: Campaign, results: CampaignResults, console: Console) -> None:
    """Prints the results, and draws them where Matplotlib is there."""
    groups, drawing = group(campaign, results), campaign.drawing
    if campaign.json:
        summary = {"file": str(results.path), "settings": [_figures(*some) for some in groups]}
        print_data(json.dumps(summary, indent=2))
    console.say(f"results: {results.path}, {len(results.rows)} runs")
    if not results.measures:
        console.say("the experiment measures nothing: no picture")
    elif not can_draw():
        console.say(f"no picture: {lacking()}")
    else:
        from vsense.studies.campaign import comparison
        from vsense.studies.report import plot

        names = {name: [measures[name] for _, measures in groups] for name in results.measures}
        title, labels = results.rows[0].experiment, [settings for settings, _ in groups]
        with plot.styled(campaign.style):
            data = plot.encode(comparison.draw(title, labels, names), drawing.suffix[1:])
        try:
            drawing.write_bytes(data)
        except OSError as error:
            raise VsenseError(f"{drawing}: cannot be written: {error.strerror}") from None
        console.say(f"picture: {drawing}")


Group = tuple[dict[str, str], dict[str, list[float]]]
"""A combination of settings, and the values of its runs by measure."""


def group(campaign: Campaign, results: CampaignResults) -> list[Group]:
    """Gathers the rows of every combination of the campaign, of all seeds."""
    groups = []
    for settings in campaign.sweep.combinations():
        wanted = condition_of(campaign.setup.blind, settings)
        rows = [row for row in results.rows if row.condition == wanted]
        taken = {name: [row.measures[name] for row in rows] for name in results.measures}
        measures = {
            name: [value for value in values if value is not None] for name, values in taken.items()
        }
        groups.append((settings, measures))
    return groups


def _figures(settings: dict[str, str], measures: dict[str, list[float]]) -> dict[str, Any]:
    """Mean and standard deviation of every measure."""
    spread = {
        name: {
            "runs": len(values),
            "mean": round(float(np.mean(values)), 6) if values else None,
            "std": round(float(np.std(values, ddof=1)), 6) if len(values) > 1 else None,
        }
        for name, values in measures.items()
    }
    return {"settings": settings, "measures": spread}
