"""The runs of a series with real robots: who can play, with its controller, from its start."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from vsense.base.interruption import Interruption
from vsense.base.terminal import Console
from vsense.config.specs import Experiment
from vsense.modes.live.opening import LinkOptions
from vsense.modes.live.run import OneRun
from vsense.modes.live.session import RunSession, RunSetup
from vsense.monitor.ui.room import ControlRoom, RoomOptions
from vsense.robots.link.keys import LinkTrust
from vsense.run.directory import RunLog
from vsense.run.link_check import RunLinkCheck
from vsense.run.robots import Readiness
from vsense.studies.series._folder import SeriesFolder
from vsense.studies.series._order import PlannedRun
from vsense.studies.series._parts import PlanLoader, PlannedExperiment, SeriesCast
from vsense.studies.series._series import RunOutcome, RunResult
from vsense.studies.series._staged import NotEnoughRobots, StagedRun

Bring = Callable[[Experiment, Collection[int]], Mapping[int, str]]
"""Brings robots with these tags what they run in an experiment; gives whom it did not reach, with
why."""


@dataclass(frozen=True, slots=True)
class RobotSeries:
    """What a series with real robots is made with.

    Attributes:
        trust: which robots are believed.
        link: where they connect to, and where arena states come from.
        room: how runs are seen and kept.
        bring: see `Bring`; None: nothing is ever brought.
        lease: takes robots by their tags, before they hear of a run.
    """

    trust: LinkTrust
    link: LinkOptions = field(default_factory=LinkOptions)
    room: RoomOptions = field(default_factory=RoomOptions)
    bring: Bring | None = None
    lease: Callable[[Collection[int]], None] = lambda tags: None


class RealRuns:
    """Runs with real robots; see `RunMaker`."""

    def __init__(
        self,
        loader: PlanLoader,
        cast: SeriesCast,
        console: Console,
        interrupted: Interruption,
        options: RobotSeries,
    ) -> None:
        self._loader, self._cast, self._options = loader, cast, options
        self._console, self._interrupted = console, interrupted
        self._has: dict[int, object] = {}
        self._is_checked = False

    def make(self, runs: Sequence[PlannedRun], folder: SeriesFolder) -> Iterator[RunResult]:
        """Makes the first of these runs, with whoever can play; none where the user ends it.

        Raises:
            NotEnoughRobots: fewer than the plan wants can.
            VsenseError: robots or tracker cannot be reached.
        """
        run = runs[0]
        directory, left_out = folder.of_run(run), set[int]()
        with RunLog(directory) as log:
            while not self._interrupted.is_set():
                planned = self._cast.by_condition[run.cell.condition]
                staged = StagedRun.of(self._loader.plan, run, planned, left_out)
                unable = self._bring(staged.experiment)
                outcome = None
                if not unable:
                    unable, outcome = self._attempt(staged, directory, log)
                if outcome is not None:
                    yield run, outcome
                    staged.replace_lost(self._cast)
                    return
                self._do_without(unable, left_out, staged)

    def _bring(self, experiment: Experiment) -> dict[int, str]:
        """Brings controllers to those that have another one; gives whom they did not reach."""
        bring = self._options.bring
        runs = {r.tag: experiment.controller_of(r).program for r in experiment.robots}
        lacking = [tag for tag, program in runs.items() if self._has.get(tag) != program]
        if bring is None or not lacking:
            return {}
        self._options.lease(lacking)
        failed = dict(bring(experiment, lacking))
        self._has |= {tag: runs[tag] for tag in lacking if tag not in failed}
        return failed

    def _attempt(
        self, staged: StagedRun, directory: Path, log: RunLog
    ) -> tuple[dict[int, str], RunOutcome | None]:
        """Tries to make a run; gives by tag who cannot play, and why, or what the run came to."""
        self._options.lease([robot.tag for robot in staged.experiment.robots])
        with staged.control_room(self._options.room, log) as room:
            session = RunSession(self._setup(staged, room, log), self._options.link.tracking, None)
            with session:
                room.begin_run(session.environment, directory)
                check = self._link_check(session, log)
                readiness = staged.wait(session, self._cast, check)
                if self._interrupted.is_set():
                    return {}, None
                self._is_checked |= bool(check.verdicts)
                if not readiness.complete:
                    return staged.missing(readiness), None
                low = staged.low(session.runner.robots)
                session.home()
                if low or self._interrupted.is_set():
                    return low, None
                return {}, self._carry_out(staged, session, directory, readiness, log, check)

    def _link_check(self, session: RunSession, log: RunLog) -> RunLinkCheck:
        """What measures the links before the first run of this process."""
        span_s = 0.0 if self._is_checked else self._options.link.link_check
        return RunLinkCheck(session.server, span_s, session.experiment.timestep_s, log.say)

    def _carry_out(
        self,
        staged: StagedRun,
        session: RunSession,
        directory: Path,
        readiness: Readiness,
        log: RunLog,
        check: RunLinkCheck,
    ) -> RunOutcome:
        run = staged.run
        log.say(f"run {run.cell.number} of {staged.plan.runs}: {run.in_words()}")
        live_run = OneRun(session, directory, readiness, log, check)
        staged.begin()
        staged.figures = live_run.figures
        live_run.run()
        session.setup.room.recorders.end_run()
        summary = live_run.report()
        ended = session.runner.ended
        if live_run.failure is not None:
            ended = str(live_run.failure)
        outcome = staged.outcome(summary, ended, session.runner.control)
        return outcome if live_run.failure is None else replace(outcome, halt_reason=ended)

    def _setup(self, staged: StagedRun, room: ControlRoom, log: RunLog) -> RunSetup:
        experiment, options, cell = staged.experiment, self._options, staged.run.cell
        code = asdict(self._loader.code.absolute(Path.cwd()))
        who = options.link.address(experiment), options.trust, log, self._interrupted, room
        origin = staged.origin(code) | {"virtual_devices": self._loader.virtual_devices}
        blind = staged.planned.condition.blind
        setup = RunSetup(experiment, cell.seed, blind, *who, origin, staged.starts)
        taken = options.link.other_programs
        criteria = staged.plan.void
        return replace(setup, lease=options.lease, other_programs=taken, criteria=criteria)

    def _do_without(self, unable: Mapping[int, str], left_out: set[int], staged: StagedRun) -> None:
        """Puts spares in for those that cannot play, or leaves them out of this run."""
        missing = self._cast.put_in_for(unable)
        left_out |= set(missing)
        playing = [r.tag for r in staged.experiment.robots if r.tag not in missing]
        least = staged.plan.robots.least
        if missing and (least is None or len(playing) < least):
            wanted = "all of them" if least is None else f"{least} robots"
            why = ", ".join(f"robot {tag} {unable[tag]}" for tag in missing)
            raise NotEnoughRobots(
                f"{staged.run.name} cannot begin: {why}; the plan wants {wanted} (least in its"
                " [robots]). The same command goes on from there"
            )
        for tag in missing:
            self._console.say(f"robot {tag} is left out of {staged.run.name}", "warning")


def count_programs(conditions: Iterable[PlannedExperiment]) -> int:
    """How many programs conditions run for some part."""
    parts: dict[int, set[object]] = {}
    for planned in conditions:
        experiment = planned.experiment
        for number, robot in enumerate(experiment.robots):
            parts.setdefault(number, set()).add(experiment.controller_of(robot).program)
    return max(map(len, parts.values()), default=0)
