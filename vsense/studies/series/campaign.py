"""A campaign: a series of simulated runs whose plan comes from the command line.

Its conditions are all combinations of settings, its starts the seeds.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from vsense.base.errors import Interrupted, UsageError, VsenseError, failing_as
from vsense.base.interruption import Interruption, interruption
from vsense.base.terminal import Console, print_data
from vsense.config.placement import StartPlaces, settle
from vsense.config.specs import Experiment
from vsense.modes import origin
from vsense.modes.options import ExperimentOptions, say_warnings
from vsense.modes.sim import fingerprint
from vsense.modes.sim.engine import Engine
from vsense.modes.sim.job import Job, Setup, Sweep, setup_of
from vsense.modes.sim.outcome import Task, libraries_of
from vsense.monitor.recording import MCAP
from vsense.run import asked
from vsense.run.runs_csv import RunsFile, condition_of
from vsense.studies.report import FORMATS, _plot, can_draw, lacking
from vsense.studies.series._folder import CampaignTable
from vsense.studies.series._order import CAMPAIGN, Cell, condition_words
from vsense.studies.series._parts import PlannedExperiment
from vsense.studies.series._plan import Condition, PlannedStart, SeriesPlan
from vsense.studies.series._series import (
    ConditionMeasures,
    SeriesLoop,
    measure_table,
    measures_of,
    spreads,
)
from vsense.studies.series._simulated import Simulate, SimulatedRuns, check_simulator, simulator

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EVER = 2**31
"""A run that somebody has made void in the table is repeated however often."""


@dataclass(frozen=True, slots=True)
class CampaignOptions:
    """What of a campaign is asked for beside its experiment and its sweep.

    Attributes:
        output: the CSV file, or the picture's; None: results.csv.
        format: of the picture, of `FORMATS`; None: as `output` says, or png.
        style: of the picture: a Matplotlib style sheet or its name, or None.
        jobs: runs at the same time on this machine; None: one per processor.
        on: address of a Dask cluster that does the runs instead; None: this machine does.
        json: print the figures on standard output.
        record: every run has a recording, in a folder beside the CSV file.
    """

    output: Path | None = None
    format: str | None = None
    style: str | None = None
    jobs: int | None = None
    on: str | None = None
    json: bool = False
    record: bool = False

    def check(self) -> None:
        """Raises UsageError where something is missing that the runs need."""
        check_simulator(self.on, self.jobs, self.record)


@dataclass(frozen=True, slots=True)
class Campaign:
    """A campaign.

    Attributes:
        output: the CSV file.
        drawing: the picture's file.
        how: what else is asked for.
        lenient: a controller may ask for what nobody offers, or be told what it does not read.
    """

    sweep: Sweep
    setup: Setup
    output: Path
    drawing: Path
    how: CampaignOptions = CampaignOptions(jobs=1)
    lenient: bool = False

    def setup_of(self, planned: PlannedExperiment, cell: Cell | None = None) -> Setup:
        """What the runs of a condition are made from."""
        return replace(self.setup, settings=planned.settings)


def simulate(experiment: ExperimentOptions, sweep: Sweep, options: CampaignOptions) -> int:
    """Does the campaign of an experiment; 0, or 130 after Ctrl-C, 143 after SIGTERM.

    Raises:
        UsageError: something is missing or does not go together.
        VsenseError: it cannot run, or a run has failed.
    """
    options.check()
    loaded, console = experiment.load(), Console()
    setup = setup_of(experiment)
    say_warnings(setup.fit(loaded), console)
    output, drawing = outputs(options.output, options.format)
    campaign = Campaign(sweep, setup, output, drawing, options, experiment.lenient)
    with interruption() as interrupted:
        try:
            run(campaign, console, interrupted)
        except Interrupted:
            console.end_progress()
            return interrupted.code
    return 0


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


def run(
    campaign: Campaign,
    console: Console,
    interrupted: Interruption,
    engine: Engine | None = None,
) -> None:
    """Does all runs that the file does not hold yet, and compares the settings.

    Rows are written in the order of the campaign, wherever and in whatever order runs are done.

    Args:
        engine: does the runs, on other machines; None: as `Campaign.how` says.

    Raises:
        Interrupted: the user has ended it; the rows until then are in the file.
        CutShort: likewise, while a cluster was connected or the results were drawn.
        VsenseError: it cannot run, or a run has failed.
    """
    _plot.require_sheet(campaign.how.style)
    with ExitStack() as stack:
        if engine is None:
            here = simulator(campaign.how.on, campaign.how.jobs, console, interrupted)
            simulate = stack.enter_context(here)
        else:
            simulate = engine.simulate
        plan, table = _complete(campaign, simulate, console, interrupted)
    with interrupted.in_time():
        _report(campaign, plan, table, console)


def _complete(
    campaign: Campaign, simulate: Simulate, console: Console, interrupted: Interruption
) -> tuple[SeriesPlan, CampaignTable]:
    """Does the runs that are missing; raises as `run`."""
    plan, by_condition = prepare(campaign)
    rows = RunsFile(campaign.output)
    plan = replace(plan, name=_name_before(campaign, by_condition, rows) or plan.name)
    table = CampaignTable(rows, plan)
    reported = next(iter(by_condition.values())).experiment.warnings  # by the command
    maker = SimulatedRuns(
        plan,
        by_condition,
        campaign.setup_of,
        simulate,
        console,
        interrupted,
        record=campaign.how.record,
        reported=reported,
    )
    loop = SeriesLoop(plan, table, lambda runs: maker.make(runs, table), console, interrupted)
    _keep_origin(campaign, by_condition, table, console)
    if campaign.how.record:
        _say_unrecorded(loop, table, console)
    loop.complete()
    return plan, table


def prepare(campaign: Campaign) -> tuple[SeriesPlan, dict[str, PlannedExperiment]]:
    """Makes the plan, and loads what its conditions run.

    A setting that cannot be had, and robots that find no room with any seed, are found before the
    first run.

    Raises:
        VsenseError: an experiment cannot be loaded, or a controller not be built; or, unless it is
            lenient, it asks for what nobody offers or is told what it does not read.
    """
    by_condition = {}
    blind, file = campaign.setup.blind, campaign.setup.experiment
    for settings in campaign.sweep.combinations():
        experiment = replace(campaign.setup, settings=settings).load()
        if not campaign.lenient:
            asked.check(experiment)
        for seed in campaign.sweep.seeds or (1,):
            settle(experiment, seed)
        condition = Condition(condition_of(blind, settings), file, settings=settings, blind=blind)
        by_condition[condition.name] = PlannedExperiment(condition, experiment, settings)
    first = next(iter(by_condition.values()))
    job = Job(campaign.setup_of(first), 0, libraries_of(first.experiment))
    plan = SeriesPlan(
        path=first.experiment.path,
        name=fingerprint.of_campaign(Task(job, first.experiment)),
        mode="sim",
        conditions=tuple(planned.condition for planned in by_condition.values()),
        starts=tuple(PlannedStart(f"seed{n}", StartPlaces(n)) for n in campaign.sweep.seeds or ()),
        seed=CAMPAIGN,
        again=EVER,
    )
    return plan, by_condition


def _name_before(
    campaign: Campaign, by_condition: Mapping[str, PlannedExperiment], table: RunsFile
) -> str:
    """The name that a table's rows have from vsense 0.1, where they are of this campaign.

    That name depended on the compiler and on every C file of vsense, and cannot be made again: what
    the runs were made of is kept beside the table, and is compared.
    """
    path = table.path
    kept = origin.kept_beside(path)
    if not (table.rows and kept) or len(table.rows[0].series) == fingerprint.NAME_DIGITS:
        return ""
    experiments, setups = _origins(campaign, by_condition)
    setup = next(iter(setups.values()))
    with failing_as(VsenseError, f"{path}: cannot be compared with what its rows were made of"):
        same = all(origin.is_of(origin.read(p), experiments, setup) for _, p in kept)
    return table.rows[0].series if same else ""


def _keep_origin(
    campaign: Campaign,
    by_condition: Mapping[str, PlannedExperiment],
    table: CampaignTable,
    console: Console,
) -> None:
    """Keeps what the runs are made from, beside the table."""
    path = table.table.path
    with failing_as(VsenseError, f"{path}: cannot be written"):
        path.parent.mkdir(parents=True, exist_ok=True)
    experiments, setups = _origins(campaign, by_condition)
    stem, rows = origin.stem_beside(path), len(table.rows)
    origin.keep(path.parent, "sim", experiments, console.say, setups, (), stem, rows)


def _origins(
    campaign: Campaign, by_condition: Mapping[str, PlannedExperiment]
) -> tuple[list[Experiment], dict[str, Setup]]:
    """The experiments that differ in their files, and the setups by `origin.key_of`."""
    setups = {origin.key_of(n): campaign.setup_of(p) for n, p in by_condition.items()}
    experiments = [p.experiment for p in by_condition.values()]
    if not any(key.endswith(".library") for key in campaign.sweep.values):
        del experiments[1:]  # all are made from the same files
    return experiments, setups


def _say_unrecorded(loop: SeriesLoop, table: CampaignTable, console: Console) -> None:
    count = loop.valid - sum(1 for _ in table.path.glob(f"*{MCAP}"))
    if count > 0:
        console.say(f"{count} runs that are there already have no recording, and get none")


def _report(campaign: Campaign, plan: SeriesPlan, table: CampaignTable, console: Console) -> None:
    """Prints the results, and draws them where Matplotlib is there."""
    groups, path = measures_of(plan, table), table.table.path
    if campaign.how.json:
        figures = [{"settings": c.settings, "measures": spreads(v)} for c, v in groups]
        print_data(json.dumps({"file": str(path), "settings": figures}, indent=2))
    names = [condition_words(condition.name) for condition, _ in groups]
    for line in measure_table("setting", names, groups):
        console.say(line)
    console.say(f"results: {path}, {len(table.rows)} runs")
    if not table.table.measures:
        console.say("the experiment measures nothing: no picture")
    elif not can_draw():
        console.say(f"no picture: {lacking()}")
    else:
        _draw(campaign, table, groups)
        console.say(f"picture: {campaign.drawing}")


def _draw(campaign: Campaign, table: CampaignTable, groups: Sequence[ConditionMeasures]) -> None:
    from vsense.studies.series import _comparison

    measures = {name: [values[name] for _, values in groups] for name in table.table.measures}
    settings = [condition.settings for condition, _ in groups]
    title = table.rows[0].experiment
    title += ", without virtual sensors" if campaign.setup.blind else ""
    draw = partial(_comparison.draw, title, settings, measures)
    write_picture(draw, campaign.drawing, campaign.how.style)


def write_picture(draw: Callable[[], Figure], path: Path, style: str | None) -> Path | None:
    """Draws in a style, see `_plot.styled`, and writes; None: Matplotlib is not there.

    VsenseError: it cannot be written.
    """
    if not can_draw():
        return None
    with _plot.styled(style):
        data = _plot.encode(draw(), path.suffix[1:])
    with failing_as(VsenseError, f"{path}: cannot be written"):
        path.write_bytes(data)
    return path
