"""What runs in the lab and with real robots share: where robots are, the control room, the row."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

from vsense.base.errors import UsageError, VsenseError
from vsense.base.terminal import Console
from vsense.config.placement import settle
from vsense.config.specs import Experiment, Pose
from vsense.modes.live.session import ExperimentSession
from vsense.monitor.ui.room import ControlRoom, RoomOptions
from vsense.robots.link.status import RobotStatus
from vsense.run.control import Control, State
from vsense.run.figures import Figures
from vsense.run.homing.starts import Starts
from vsense.run.robots import Readiness, low_batteries
from vsense.run.runs_csv import RunRow, row_of, utc
from vsense.run.verdict import VOID, RunRecord, is_by_people
from vsense.studies.series._order import PlannedRun
from vsense.studies.series._parts import PlannedExperiment, SeriesCast
from vsense.studies.series._plan import SeriesPlan
from vsense.studies.series._series import RunOutcome


class NotEnoughRobots(VsenseError):
    """A run cannot begin with who is there; the message names who is not."""


@dataclass(slots=True)
class StagedRun:
    """One run while it is made.

    Attributes:
        experiment: with the robots at their starts, and all that is distributed in its place.
        began_s: when the run began, by the clock.
        figures: of the run; None: it has not begun.
    """

    plan: SeriesPlan
    run: PlannedRun
    planned: PlannedExperiment
    experiment: Experiment
    began_s: float = 0.0
    figures: Figures | None = None

    @classmethod
    def of(
        cls,
        plan: SeriesPlan,
        run: PlannedRun,
        planned: PlannedExperiment,
        left_out: Collection[int] = (),
    ) -> StagedRun:
        """Puts everything at the start of a run; robots with tags in `left_out` do not play.

        Raises:
            ConfigError: there is no place for all.
            UsageError: poses do not fit, or what pollutes would be left out.
        """
        experiment = plan.start(run.cell.start).places.settled(planned.experiment)
        experiment = without(experiment, left_out)
        return cls(plan, run, planned, experiment)

    def control_room(self, options: RoomOptions, console: Console) -> ControlRoom:
        """The control room of this run."""
        return ControlRoom(replace(options, series=self.facts()), console)

    def wait(
        self, session: ExperimentSession, cast: SeriesCast, busy: Callable[[], str] = lambda: ""
    ) -> Readiness:
        """Waits for the robots, as `Runner.wait`, and follows whom people have put in meanwhile.

        Raises:
            VsenseError: an experiment cannot be played by them.
        """
        readiness = session.wait_patiently(self.plan.robots.ready_s, busy)
        experiment = session.experiment
        if experiment.casting != self.experiment.casting:
            self.experiment = experiment
        cast.follow(self.run.cell.condition, experiment.casting)
        return readiness

    def replace_lost(self, cast: SeriesCast) -> None:
        """Has spares play from now on for robots that were lost when the run ended."""
        gone = [] if self.figures is None else self.figures.witness.gone
        cast.put_in_for(dict.fromkeys(gone, "was lost when the run ended"))

    def begin(self) -> None:
        """The run begins now."""
        self.began_s = time.time()

    def missing(self, readiness: Readiness) -> dict[int, str]:
        """By tag, which robots cannot begin, and why."""
        absent, unseen = set(readiness.absent), set(readiness.unseen)
        whys = dict.fromkeys(unseen, "is not seen") | dict.fromkeys(absent, "is not connected")
        return {r.tag: whys[r.id] for r in self.experiment.robots if r.id in whys}

    def low(self, robots: Mapping[int, RobotStatus]) -> dict[int, str]:
        """By tag, which robots have too little in their batteries for this run."""
        low = low_batteries(robots, self.plan.robots.battery_v)
        return {tag: f"{words}, and drove home" for tag, words in low.items()}

    @property
    def starts(self) -> Starts | None:
        """Where robots drive before the run; None: they stay where they are."""
        rules = self.plan.robots
        return Starts(self.experiment, rules.virtual_walls) if rules.home else None

    def from_where(self, poses: Mapping[int, Pose]) -> Experiment:
        """The experiment with robots where they stand, of those that stand elsewhere."""
        robots = tuple(
            replace(robot, pose=poses.get(robot.tag, robot.pose))
            for robot in self.experiment.robots
        )
        return settle(replace(self.experiment, robots=robots), self.run.cell.seed)

    def origin(self, code: Mapping[str, Any]) -> dict[str, Any]:
        """How the experiment was read, for recordings; see `vsense.monitor.recording.resense`."""
        plan, experiment = self.plan, self.experiment
        places = plan.start(self.run.cell.start).places
        return {
            "path": str(experiment.path.absolute()),
            "stage": experiment.stage.value,
            "length_s": plan.duration_s,
            "settings": dict(self.planned.settings),
            "virtual_devices": False,
            "robots": plan.count,
            "seed": places.seed,
            "poses": [list(pose) for pose in places.poses],
            "code": dict(code),
            "series": self.facts(),
        }

    def facts(self) -> dict[str, Any]:
        """Which run of the series it is, for status and recordings."""
        cell, plan = self.run.cell, self.plan
        return {
            "name": plan.name,
            "run": self.run.name,
            "number": cell.number,
            "of": plan.runs,
            "attempt": self.run.attempt,
            "block": cell.block,
            "condition": cell.condition,
            "start": cell.start,
            "repetition": cell.repetition,
        }

    def outcome(
        self, summary: Mapping[str, Any] | None, ended: str, control: Control
    ) -> RunOutcome:
        """What the run came to, by what its summary.json has; None: nothing was measured."""
        mode, name = self.plan.mode, self.experiment.name
        if summary is None or self.figures is None:
            row = RunRow(run="", mode=mode, experiment=name, condition="")
            why = RunRecord(ended=ended, timesteps=False).judge(self.plan.void).why
            row = replace(row, verdict=VOID, why=why)
            return RunOutcome(row, ended, halt_reason(ended, control))
        row, witness = row_of(summary, mode, self.experiment, ""), self.figures.witness
        row = replace(
            row,
            began=utc(self.began_s),
            uids=witness.uids,
            batteries_v=witness.volts or row.batteries_v,
            versions=(*row.versions, *witness.programs),
        )
        return RunOutcome(row, ended, halt_reason(ended, control))


def without(experiment: Experiment, tags: Collection[int]) -> Experiment:
    """An experiment without some of its robots; UsageError where what pollutes is among them."""
    if not tags:
        return experiment
    if polluting := {source.tag for source in experiment.sources} & set(tags):
        raise UsageError(f"{experiment.file}: robot {polluting.pop()} pollutes: not without it")
    rest = replace(experiment, robots=tuple(r for r in experiment.robots if r.tag not in tags))
    return replace(rest, controllers=tuple(c for c in rest.controllers if rest.driven_by(c)))


def halt_reason(ended: str, control: Control) -> str:
    """Why no other run may follow by itself: who stopped this one shall look first."""
    if control.state is State.EMERGENCY:
        return "an emergency stop"
    return ended if is_by_people(ended) else ""
