"""A campaign: many runs of one experiment, with every combination of settings and every seed."""

from __future__ import annotations

import hashlib
import json
import re
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.sax.saxutils import unescape

import numpy as np

from vsense import __version__
from vsense.errors import UsageError, VsenseError
from vsense.report import FORMATS, LACKING, can_draw, plot
from vsense.run.programs import loop_object, shared_objects
from vsense.sim import comparison
from vsense.sim.job import Job, Setup, Sweep
from vsense.sim.outcome import Interrupted, Task
from vsense.sim.results import DURATION, EXPERIMENT, ROBOTS, SEED, CampaignResults
from vsense.sim.watch import Show, WorkerProcess, simulate_all
from vsense.terminal import Console, Interruption, print_data

BAR_WIDTH = 24

MAX_NAME = 256
"""[byte] Longer texts are no file names, and the system refuses to look for them."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """The options of a campaign.

    Attributes:
        output: the CSV file.
        drawing: the picture's file.
        style: of the picture: a Matplotlib style sheet or its name, or None.
        jobs: runs at the same time.
        json: print the figures on standard output.
    """

    sweep: Sweep
    setup: Setup
    output: Path
    drawing: Path
    style: str | None
    jobs: int
    json: bool


def run(campaign: Campaign, console: Console, interrupted: Interruption) -> None:
    """Does all runs that the file does not hold yet, and compares the settings.

    Rows are written in the order of the campaign, whatever the number of processes.

    Raises:
        Interrupted: the user has ended it; the rows until then are in the file.
        CutShort: likewise, while the results were drawn; all rows are in the file.
        VsenseError: it cannot run, or a run has failed.
    """
    sweep, path = campaign.sweep, campaign.output
    if campaign.style is not None and can_draw():
        plot.require_sheet(campaign.style)
    tasks = prepare(sweep, campaign.setup)
    results = CampaignResults(path, fingerprint(tasks[0]), tuple(sweep.values))
    there = results.keys()
    todo = [
        task for task in tasks if results.key(task.job.setup.settings, task.job.seed) not in there
    ]
    if results.repaired:
        console.say(f"{path}: its last row was cut short: that run is done again")
    if len(todo) < len(tasks):
        console.say(f"{path}: {len(tasks) - len(todo)} of {len(tasks)} runs are there already")
    try:
        _simulate(todo, campaign.jobs, results, console, interrupted)
    except Interrupted:
        done = len(tasks) - len(todo) + len(results.rows) - len(there)
        console.end_progress()
        console.say(f"{path}: {done} of {len(tasks)} runs; the same command goes on from there")
        raise
    console.end_progress()
    with interrupted.in_time():
        _report(campaign, results, console)


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


def prepare(sweep: Sweep, setup: Setup) -> list[Task]:
    """Makes all runs; a setting that cannot be had is found before the first one.

    Raises:
        VsenseError: an experiment cannot be loaded, or a controller not be built.
    """
    tasks = []
    for settings in sweep.combinations():
        changed = replace(setup, settings=settings)
        experiment = changed.load()
        libraries = {name: str(path) for name, path in shared_objects(experiment).items()}
        words = [f"{key} {value}" for key, value in settings.items()]
        for seed in sweep.seeds or ():
            label = ", ".join([*words, f"seed {seed}"])
            tasks.append(Task(Job(changed, seed, libraries), experiment, label))
    return tasks


def fingerprint(task: Task) -> str:
    """What all runs of a campaign have in common, as 8 hexadecimal digits.

    That is the experiment's file with the files it names, the programs, the length, the robots,
    whether they are blind, and vsense itself; not settings and seeds, of which more may come.

    Raises:
        VsenseError: a file cannot be read.
    """
    setup = task.job.setup
    digest = hashlib.sha256()
    try:
        for file in _files(task.experiment.path):
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    except OSError as error:
        raise VsenseError(f"{error.filename}: cannot be read: {error.strerror}") from None
    built = [Path(library).parent.name for library in task.job.libraries.values()]
    loop_functions = loop_object(task.experiment)
    if loop_functions is not None:
        built.append(loop_functions.parent.name)
    words = [*built, setup.duration_s, setup.robots, setup.blind]
    digest.update(json.dumps([__version__, *words]).encode())
    return digest.hexdigest()[:8]


_QUOTED = re.compile(r"\"([^\"<]*)\"|'([^'<]*)'")


def _files(path: Path) -> list[Path]:
    """An experiment's file, and every file that an attribute in it names.

    The file is not parsed: ARGoS's files need not be well-formed.
    """
    quoted = _QUOTED.findall(path.read_text(encoding="utf-8", errors="replace"))
    values = {unescape(double or single) for double, single in quoted}
    named = (path.parent / value for value in sorted(values) if value and len(value) < MAX_NAME)
    return [path, *(file for file in named if file.is_file())]


def _simulate(
    todo: Sequence[Task],
    jobs: int,
    results: CampaignResults,
    console: Console,
    interrupted: threading.Event,
) -> None:
    """Does the runs and appends their rows in the runs' order."""
    finished: dict[int, dict[str, Any]] = {}
    number = {id(task): place for place, task in enumerate(todo)}
    written = 0
    show = _progress(console, todo, lambda: written + len(finished))
    for task, result in simulate_all(todo, jobs, interrupted, show):
        finished[number[id(task)]] = result
        while written in finished:
            _append(results, todo[written], finished.pop(written))
            written += 1


def _append(results: CampaignResults, task: Task, result: dict[str, Any]) -> None:
    swarm = {name: value for name, value in result["swarm"].items() if task.experiment.sources}
    fixed = {
        EXPERIMENT: result["name"],
        **task.job.setup.settings,
        SEED: task.job.seed,
        ROBOTS: result["robots"],
        DURATION: f"{result['timesteps'] * result['timestep_s']:g}",
    }
    results.append(fixed, {**swarm, **result["measures"]})


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
    groups, drawing = group(campaign.sweep, results), campaign.drawing
    if campaign.json:
        summary = {"file": str(results.path), "settings": [_figures(*some) for some in groups]}
        print_data(json.dumps(summary, indent=2))
    console.say(f"results: {results.path}, {len(results.rows)} runs")
    if not results.measures:
        console.say("the experiment measures nothing: no picture")
    elif not can_draw():
        console.say(f"no picture: {LACKING}")
    else:
        names = {name: [measures[name] for _, measures in groups] for name in results.measures}
        title, labels = results.rows[0][EXPERIMENT], [settings for settings, _ in groups]
        with plot.styled(campaign.style):
            data = plot.encode(comparison.draw(title, labels, names), drawing.suffix[1:])
        try:
            drawing.write_bytes(data)
        except OSError as error:
            raise VsenseError(f"{drawing}: cannot be written: {error.strerror}") from None
        console.say(f"picture: {drawing}")


Group = tuple[dict[str, str], dict[str, list[float]]]
"""A combination of settings, and the values of its runs by measure."""


def group(sweep: Sweep, results: CampaignResults) -> list[Group]:
    """Gathers the rows of every combination of the campaign, of all seeds."""
    groups = []
    for settings in sweep.combinations():
        wanted = results.key(settings, "")[:-1]
        rows = [row for row in results.rows if results.key(row, "")[:-1] == wanted]
        measures = {
            name: [float(row[name]) for row in rows if row[name]] for name in results.measures
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
