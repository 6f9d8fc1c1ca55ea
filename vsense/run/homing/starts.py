"""Robots drive to their starts before a run: where these are, which robots cannot, and messages.

`homing` plans; `Runner.home` carries it out.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from vsense.base.arena import ArenaState
from vsense.base.terminal import Console, shorten
from vsense.config.placement import settle
from vsense.config.specs import Experiment, Pose
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.table import Goal
from vsense.robots.link.wire import StopCause, Wanted
from vsense.run.control import Control, State
from vsense.run.homing._homing import Homing
from vsense.run.homing.floor import DrivingFloor
from vsense.run.homing.robots import LIMITS, HomingLimits, Trouble

_HELD = (StopCause.BASE, StopCause.BATTERY)
"""For these reasons a robot that is connected may not drive."""


class Guide(Protocol):
    """Plans where robots drive by themselves, one arena state after the other: a `Homing`.

    Attributes:
        doing: what they do, for people.
        news: lines for people that were not printed yet.
    """

    doing: str
    news: list[str]

    @property
    def done(self) -> bool:
        """Whether nobody has to drive any more."""
        ...

    def step(self, state: ArenaState, troubles: Mapping[int, Trouble]) -> Mapping[int, Goal]:
        """Takes an arena state, and by tag who cannot drive; gives where robots are to drive."""
        ...

    def rest(self) -> None:
        """All robots stand, by an order."""
        ...

    def progress(self) -> str:
        """A line for people."""
        ...


@dataclass(frozen=True, slots=True)
class Starts:
    """Where the robots of an experiment begin its runs.

    Attributes:
        experiment: as its file says, nothing in it placed yet.
        virtual_walls: ways to the starts lead around virtual walls, too.
        limits: how long robots are waited for.
    """

    experiment: Experiment
    virtual_walls: bool = False
    limits: HomingLimits = LIMITS

    def of(self, seed: int) -> dict[int, Pose]:
        """The starts of the run with this seed, by tag: those of `vsense sim`.

        Raises:
            ConfigError: there is no place for all.
        """
        robots = settle(self.experiment, seed).robots
        return {robot.tag: robot.pose for robot in robots if robot.pose is not None}

    def kinds(self) -> dict[int, Hashable]:
        """By tag, what robots that may exchange their starts have in common.

        That is the controller, with its devices and settings, the type of robot as the roster has
        it, and whether it pollutes.
        """
        types = dict(self.experiment.casting.types)
        polluting = {source.tag for source in self.experiment.sources}
        return {
            robot.tag: (robot.controller, types.get(robot.tag, ""), robot.tag in polluting)
            for robot in self.experiment.robots
        }

    def homing(self, settled: Experiment, seed: int) -> Homing:
        """What brings the robots there; those of the same kind exchange places.

        Args:
            settled: the experiment with everything in its place.
            seed: of the run.
        """
        return Homing(
            self.of(seed),
            {robot.tag: robot.id for robot in settled.robots},
            self.kinds(),
            DrivingFloor.of(settled, self.virtual_walls),
            self.limits,
            settled.models,
        )


def hindered(robots: Mapping[int, RobotStatus]) -> dict[int, Trouble]:
    """By tag, why robots cannot drive home."""
    troubles = dict[int, Trouble]()
    for tag, robot in robots.items():
        if not robot.connected:
            troubles[tag] = Trouble.NO_LINK
        elif not robot.drives_home:
            troubles[tag] = Trouble.TOO_OLD
        elif robot.telemetry is not None and robot.telemetry.stop_cause in _HELD:
            troubles[tag] = Trouble.HELD
        elif robot.held:
            troubles[tag] = Trouble.NEAR
    return troubles


def guide(
    homing: Guide, server: VirtualSensorServer, control: Control
) -> Callable[[ArenaState], Mapping[int, Goal]]:
    """What says in each timestep where robots are to drive; nowhere while they rest.

    It has them drive on where an order wants that.
    """

    def goals(state: ArenaState) -> Mapping[int, Goal]:
        if control.asked:
            control.home(partial(server.command, Wanted.HOME))
        if control.state is State.HOMING:
            return homing.step(state, hindered(server.robots()))
        homing.rest()
        return {}

    return goals


def say_progress(homing: Guide, console: Console) -> None:
    """Says what is new on the way, and how far they are."""
    for line in homing.news:
        console.say(line, "warning")
    homing.news.clear()
    console.progress(f"{homing.doing}: {homing.progress()}")


def say_end(homing: Homing, console: Console) -> None:
    """Says who stands at its start, and who does not, and why."""
    say_progress(homing, console)
    arrivals = homing.arrivals()
    left = [f"{a.name} ({a.trouble})" for a in arrivals if a.trouble]
    there = f"{len(arrivals) - len(left)} of {len(arrivals)} robots stand at their starts"
    after = f"{there} after {homing.spent_s:.0f} s"
    if left:
        console.say(f"{after}; not {shorten(left)}", "warning")
    else:
        console.say(after)


def say_next(starts: Starts | None, seed: int, console: Console) -> None:
    """Says what the next run's seed is, and whether robots drive to `starts` before it."""
    where = "stay where they stand" if starts is None else "drive to their starts"
    console.say(f"the next run has seed {seed}: the robots {where}")
