"""A series as it is asked for: loaded, forecast, and carried out in its mode."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from vsense.base.errors import UsageError
from vsense.base.interruption import Interruption, interruption
from vsense.base.terminal import Console, print_data
from vsense.config.casting import Casting, Pair
from vsense.config.description import tag_confusion
from vsense.config.roster import Roster, find_roster
from vsense.modes import origin
from vsense.modes.lab.hardware import EmulatedLab
from vsense.modes.live import opening
from vsense.modes.live.opening import LinkOptions
from vsense.modes.sim.job import Setup
from vsense.monitor.ui.access import make_tokens
from vsense.monitor.ui.room import RoomOptions
from vsense.robots.sources import CodeOptions
from vsense.run.runs_csv import RUNS, read_runs
from vsense.studies.series._folder import SeriesFolder, allowed_changes
from vsense.studies.series._order import Cell, Forecast
from vsense.studies.series._parts import PlanLoader, PlannedExperiment, SeriesCast
from vsense.studies.series._plan import SeriesPlan, read
from vsense.studies.series._series import RunMaker, SeriesLoop
from vsense.studies.series._simulated import SimulatedRuns, check_simulator, simulator

if TYPE_CHECKING:
    from vsense.studies.series._real import Bring


@dataclass(frozen=True, slots=True)
class SeriesOptions:
    """How the runs of a plan are made.

    Attributes:
        mode: where; None: as the plan says.
        output: folder of the series; None: NAME-MODE beside the plan.
        lenient: a controller may ask for what nobody offers, or be told what it does not read.
        code: where controllers' sources are.
        roster: of the robots that play; None: with real robots the one in the current folder.
        replace: who plays in whose place.
        json: how the series stands in the end is printed on standard output.
        room: how runs are seen and kept.
        jobs, on: of simulated runs, see `simulator`.
        lab: what the lab is made of.
        link: to robots.
        virtual_devices: as `load` has it.
        bringer: makes what brings real robots their controllers, by the roster; None: they have
            what they need.
        command: that holds real robots, for others.
        allow_upgrade: as `SeriesFolder.allows_upgrade`.
    """

    mode: str | None = None
    output: Path | None = None
    lenient: bool = False
    code: CodeOptions = field(default_factory=CodeOptions)
    roster: Path | None = None
    replace: tuple[Pair, ...] = ()
    json: bool = False
    room: RoomOptions = field(default_factory=RoomOptions)
    jobs: int | None = None
    on: str | None = None
    lab: EmulatedLab = field(default_factory=EmulatedLab)
    link: LinkOptions = field(default_factory=LinkOptions)
    virtual_devices: bool = False
    bringer: Callable[[Roster | None, Console], Bring] | None = None
    command: str = "series"
    allow_upgrade: bool = False


class PlannedSeries:
    """A series whose experiments are loaded and checked.

    Attributes:
        plan: of its runs.
        by_condition: what each condition runs.
        path: its folder.
    """

    def __init__(self, plan: Path | SeriesPlan, options: SeriesOptions) -> None:
        """Reads the plan where it is a file.

        Raises:
            UsageError: the plan or the roster cannot be read, or options do not go together.
            ConfigError: something in the plan, or in what it names, is wrong.
        """
        self.plan = read(plan, options.mode) if isinstance(plan, Path) else plan
        self._options = options
        name = f"{self.plan.name}-{self.plan.mode}"
        self.path = options.output or self.plan.path.parent / name
        self._loader = self._loader_of(options)
        self.by_condition: Mapping[str, PlannedExperiment] = self._loader.load_all()

    def forecast(self) -> Forecast:
        """What is left of the series; UsageError: the plan has changed too much."""
        allowed_changes(self.plan, self.path)
        table = self.path / RUNS
        rows = read_runs(table) if os.path.exists(table) else ()
        return Forecast(self.plan, self.by_condition, rows, self._options.lab.pace)

    def silence(self) -> None:
        """Has experiments warn of nothing."""
        self.by_condition = {
            name: replace(planned, experiment=replace(planned.experiment, warnings=()))
            for name, planned in self.by_condition.items()
        }

    def carry_out(self) -> int:
        """Makes the runs; says how the series stands in the end, also where one has failed.

        Returns:
            0 where all are there, else 130 after Ctrl-C, 143 after SIGTERM, or 1.

        Raises:
            UsageError: something is missing, before anything is started.
            VsenseError: a run has failed, or was void too often.
        """
        console, options = Console(), self._options
        for warning in self._warnings():
            console.say(f"vsense: {warning}")
        files = {path for planned in self.by_condition.values() for path in planned.files}
        if options.on is not None and self.plan.mode != "sim":
            raise UsageError("--on: simulated runs only, see --mode sim")
        makers = {"sim": self._simulated, "lab": self._rendered, "run": self._real}
        with interruption() as interrupted, ExitStack() as stack:
            maker = makers[self.plan.mode](console, interrupted, stack)
            folder = stack.enter_context(
                SeriesFolder(self.path, self.plan, sorted(files), options.allow_upgrade)
            )
            self._keep_origin(folder, console)
            make = partial(maker.make, folder=folder)
            loop = SeriesLoop(self.plan, folder, make, console, interrupted)
            return self._make_all(loop, console, interrupted)

    def _warnings(self) -> set[str]:
        experiments = [planned.experiment for planned in self.by_condition.values()]
        tags = {words for experiment in experiments if (words := tag_confusion(experiment))}
        return tags | {text for experiment in experiments for text in experiment.warnings}

    def _loader_of(self, options: SeriesOptions) -> PlanLoader:
        real = self.plan.mode == "run"
        roster = find_roster(options.roster, here=real)
        casting = Casting.of(roster, options.replace, self.plan.count)
        loader = PlanLoader(self.plan, options.code, casting, lenient=options.lenient)
        if not real:
            return loader
        markers = {} if roster is None else roster.markers
        return replace(
            loader,
            virtual_devices=options.virtual_devices,
            finish=lambda e: opening.with_tracker(
                replace(e, markers=markers), options.link.tracker
            ),
        )

    def _keep_origin(self, folder: SeriesFolder, console: Console) -> None:
        """Keeps what the runs are made from, as it is now."""
        plan, setups = self.plan, {}
        for name, planned in self.by_condition.items():
            for start in plan.starts if plan.mode == "sim" else ():
                setups[origin.key_of(name, start.name)] = self._loader.setup(planned, start)
        experiments = [planned.experiment for planned in self.by_condition.values()]
        extra, rows = self._options.link.tracking or (), len(folder.rows)
        origin.keep(folder.path, plan.mode, experiments, console.say, setups, extra, rows=rows)

    def _room(self) -> RoomOptions:
        """Every run is a series' and begins by itself; all have one address of the page."""
        room = self._options.room
        return room if room.web is None else replace(room, tokens=make_tokens())

    def _simulated(self, console: Console, interrupted: Interruption, stack: ExitStack) -> RunMaker:
        """Who simulates runs; `stack` leaves a cluster."""
        options, loader = self._options, self._loader
        room = options.room
        if room.record_images or room.web or room.foxglove:
            raise UsageError("--record-images, --web, --foxglove: in the lab and with robots only")
        check_simulator(options.on, options.jobs, room.record)
        here = simulator(options.on, options.jobs, console, interrupted)

        def setup_of(planned: PlannedExperiment, cell: Cell) -> Setup:
            return loader.setup(planned, self.plan.start(cell.start))

        return SimulatedRuns(
            self.plan,
            self.by_condition,
            setup_of,
            stack.enter_context(here),
            console,
            interrupted,
            record=room.record,
            reported=sorted(self._warnings()),
        )

    def _rendered(self, console: Console, interrupted: Interruption, stack: ExitStack) -> RunMaker:
        from vsense.modes.lab.experiment import set_pace
        from vsense.studies.series._rendered import LabRuns

        lab, cast = self._options.lab, SeriesCast(self.by_condition, console)
        link = LinkOptions(port=self._options.link.port)
        for planned in self.by_condition.values():
            experiment = planned.experiment
            opening.check_ports(self._options.room, link.in_lab(experiment), experiment)
            set_pace(lab.pace, experiment.host)
        return LabRuns(self._loader, cast, console, interrupted, lab, self._room(), link)

    def _real(self, console: Console, interrupted: Interruption, stack: ExitStack) -> RunMaker:
        """Who makes runs with real robots; `stack` gives the robots back."""
        from vsense.studies.series._real import RealRuns, RobotSeries, count_programs

        options, link = self._options, self._options.link
        for planned in self.by_condition.values():
            opening.require_source(planned.experiment, link.tracking)
            opening.check_ports(options.room, link, planned.experiment)
        first = next(iter(self.by_condition.values())).experiment
        real = RobotSeries(opening.trust_of(link.key, link.insecure), link, self._room())
        host, _ = link.address(first)
        lease = opening.lease_robots((), options.command, self.plan.name, host)
        if (leases := stack.enter_context(lease)) is not None:
            real = replace(real, lease=leases.take)
        if options.bringer is not None and count_programs(self.by_condition.values()) > 1:
            real = replace(real, bring=options.bringer(find_roster(options.roster), console))
        cast = SeriesCast(self.by_condition, console)
        return RealRuns(self._loader, cast, console, interrupted, real)

    def _make_all(self, loop: SeriesLoop, console: Console, interrupted: Interruption) -> int:
        try:
            loop.run()
        finally:
            console.end_progress()
            for line in loop.table():
                console.say(line)
            console.say(loop.in_words())
            if self._options.json:
                print_data(json.dumps(loop.facts(), indent=2))
        if not loop.end_reason:
            return 0
        console.say(f"{loop.end_reason}: the same command goes on from there")
        return interrupted.code if interrupted.is_set() else 1
