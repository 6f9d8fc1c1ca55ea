"""One process's runs: the virtual world, the link to the robots, and the arena state's source."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any

from vsense.base.errors import VsenseError
from vsense.base.files import read_bytes
from vsense.base.interruption import Interruption
from vsense.base.sharing import user_name
from vsense.base.terminal import Console, Level
from vsense.base.users_code import CallWatchdog
from vsense.config.casting import Pair
from vsense.config.specs import Experiment
from vsense.modes.live._own_daemons import OwnDaemons
from vsense.modes.live._sources import SteadySource, open_source, seen_by
from vsense.modes.live._steering import RunSteering, SessionCallbacks
from vsense.monitor.ui.access import is_loopback
from vsense.monitor.ui.messages import ExperimentFacts
from vsense.monitor.ui.room import ControlRoom
from vsense.robots.link.keys import LinkTrust
from vsense.robots.link.legacy.server import MixedServer
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.status import EventKind, LinkEvent, RobotStatus
from vsense.robots.link.wire import GoodbyeCause
from vsense.run.cast import Cast, parts_of, recast, spares_for
from vsense.run.changes import Changes
from vsense.run.changing import HANDS, Ground
from vsense.run.control import Control, State
from vsense.run.environment import Environment
from vsense.run.figures import Figures
from vsense.run.homing.starts import Starts, say_end, say_next
from vsense.run.robots import (
    Readiness,
    RunBatteries,
    expected_robots,
    low_batteries,
    make_server,
)
from vsense.run.runner import Runner
from vsense.run.runtime import Runtime, Step
from vsense.run.verdict import RunRecord, VoidCriteria
from vsense.run.watch import ArenaSource
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.grabber import Troubles

TROUBLES = frozenset({"doubt", "defect"})
"""Kinds of link events that somebody has to look after."""

Busy = Callable[[], str]
ROBOT_WAIT_S = 10.0
"""In a series, every run but the first waits this long for robots, then starts without them."""


class NoRobotError(VsenseError):
    """A run cannot begin: not one robot is there."""


@dataclass(frozen=True, slots=True)
class RunSetup:
    """What all runs of one process are made from.

    Attributes:
        seed: of everything that is drawn in the first run.
        blind: hold the virtual sensors at 0.
        address: interface and port for the robots; port 0 takes a free one.
        trust: which robots are believed.
        interrupted: set to end everything.
        room: where the runs are seen and steered.
        origin: how the experiment was read, for recordings; see `vsense.monitor.recording.resense`.
        starts: where robots drive before each run; None: they stay where they are.
        battery_v: who has less at its start rests in the run; 0: nobody does.
        lease: takes robots that are put in between runs, by their tags, before they hear of it.
        other_programs: robots that run another program than the file's are taken.
        criteria: what makes a run invalid beside what always does.
    """

    experiment: Experiment
    seed: int
    blind: bool
    address: tuple[str, int]
    trust: LinkTrust
    console: Console
    interrupted: Interruption
    room: ControlRoom
    origin: Mapping[str, Any] = field(default_factory=dict)
    starts: Starts | None = None
    battery_v: float = 0.0
    lease: Callable[[Collection[int]], None] = lambda tags: None
    other_programs: bool = False
    criteria: VoidCriteria = field(default_factory=VoidCriteria)


class ExperimentSession(ABC):
    """What `vsense run` and `vsense lab` share; a context that leaves no thread and no socket.

    Attributes:
        environment: the virtual world of the present run.
        runner: waits for the robots and carries out the runs.
        resting: robots that are not in the present run, by name: their batteries are low.
        away: why robots are not at their starts in it, by name.
        quiet: kinds of link events that are not printed.
    """

    quiet: frozenset[EventKind] = frozenset()
    resting: tuple[str, ...] = ()
    away: Mapping[str, str] = {}

    def __init__(self, setup: RunSetup, legacy_port: int | None = None) -> None:
        """Makes the first world; `legacy_port` is for robots with the original's client."""
        self.setup, self.experiment = setup, setup.experiment
        self.environment = Environment(setup.experiment, setup.seed, setup.blind)
        self.server: VirtualSensorServer = make_server(
            setup.experiment,
            self.environment.wire_tables,
            setup.address,
            setup.seed,
            setup.trust,
            self._on_link_event,
            legacy_port,
            setup.other_programs,
        )
        self._stack, self._over = ExitStack(), False
        self._cast = Cast(lambda: [self.experiment], lambda tag: setup.lease([tag]), self._unable)
        self._put_in: set[int] = set()
        roster = setup.experiment.casting.roster
        self._batteries = RunBatteries(roster, setup.experiment.timestep_s)

    def __enter__(self) -> None:
        try:
            with self.setup.interrupted.at_once():
                self._open()
        except BaseException:
            self._stack.close()
            raise

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    @abstractmethod
    def _open(self) -> None:
        """Opens everything; `_stack` closes it again."""

    def _start_server(self) -> int:
        """Takes the robots' port; gives its number."""
        port = self.server.start()
        self._stack.callback(self._close_server)
        return port

    def _open_room(
        self,
        source: ArenaSource,
        scene: ExperimentFacts,
        suspends: bool = False,
        ground: Ground = HANDS,
    ) -> Runtime:
        """Makes the runner and opens the control room; for `suspends` see `Control`.

        Gives the runtime, which has yet to be opened.
        """
        setup, server, room = self.setup, self.server, self.setup.room
        self._changes = Changes(setup.console.say, room.locked, ground)
        runtime = Runtime(source, self.environment, server, changes=self._changes)
        can_recast = not isinstance(server, MixedServer)
        recast = self._cast.ask if can_recast else None
        record, say, holds = room.recorders.switch, setup.console.say, room.holds
        control = Control(server.command, say, holds, suspends, record=record, replace=recast)
        self.runner = Runner(
            setup.experiment,
            runtime,
            server,
            setup.console,
            setup.interrupted,
            self._observe,
            control,
            between=self._between,
        )
        callbacks = SessionCallbacks(
            self.doubts(),
            lambda: self.runner.alarms,
            lambda: spares_for(self.experiment) if can_recast else [],
            setup.interrupted.set,
        )
        RunSteering(room, scene, self.environment, server, runtime, control, callbacks).open()
        self._stack.enter_context(CallWatchdog(lambda text: setup.console.say(text, "trouble")))
        return runtime

    def _scene(
        self, command: str, cameras: Sequence[Camera], trackers: dict[str, str], troubles: Troubles
    ) -> ExperimentFacts:
        setup, text = self.setup, read_bytes(self.experiment.path).decode(errors="replace")
        user, made, homes = user_name(), dict(setup.origin), setup.starts is not None
        return ExperimentFacts(
            command, text, setup.blind, cameras, trackers, troubles, made, user=user, homes=homes
        )

    def _observe(self, step: Step | None, robots: Mapping[int, RobotStatus]) -> None:
        """Is called after every timestep; see `vsense.run.runner.Observer`."""
        self.setup.room.update(step, robots)
        if step is not None and step.run_timestep >= 0:
            self._batteries.update(step.run_timestep, robots)

    def wait_patiently(self, limit_s: float | None, busy: Busy = lambda: "") -> Readiness:
        """Waits for all robots, as `Runner.wait`; those that are missing then may come later."""
        return self.runner.wait(limit_s, busy)

    def wait_for_some(self, limit_s: float | None, busy: Busy = lambda: "") -> Readiness:
        """As `wait_patiently`, and says without whom the run starts.

        Raises:
            NoRobotError: not one robot is there.
        """
        readiness = self.wait_patiently(limit_s, busy)
        if readiness.complete or self.setup.interrupted.is_set():
            return readiness
        missing = readiness.missing
        if not {robot.id for robot in self.experiment.robots} - set(missing):
            raise NoRobotError(f"no robot is there; {readiness.missing_text()}")
        words = f"starting without all robots; {readiness.missing_text()}"
        self.setup.console.say(words, "warning")
        return readiness

    def home(self) -> None:
        """Has the robots drive to the starts of the present run, where that is wanted.

        Who has too little in its battery by then rests in the run.
        """
        self.away, starts = {}, self.setup.starts
        if starts is not None:
            homing = starts.homing(self.environment.experiment, self.environment.seed)
            self.runner.home(homing)
            if homing.done or homing.spent_s:  # else somebody has ended it before it began
                say_end(homing, self.setup.console)
            self.away = {a.name: a.trouble for a in homing.arrivals() if a.trouble}
        self._leave_out_low()

    def _leave_out_low(self) -> None:
        """Has those whose batteries are low rest in the run, and says who they are."""
        low = low_batteries(self.runner.robots, self.setup.battery_v)
        for tag, words in low.items():
            self.setup.console.say(f"robot {tag} {words}: it stands in this run", "warning")
        self.resting = tuple(self.runner.robots[tag].name for tag in low)
        self.server.rest(low)

    def _unable(self, tag: int) -> str:
        """Why a robot cannot be put in; "": it can."""
        return ""

    @abstractmethod
    def _make_room(self, pair: Pair, experiment: Experiment) -> None:
        """Has whatever sees and moves robots know of one who is put in for another.

        VsenseError: that cannot be; everything is as before.
        """

    def _between(self) -> None:
        """Puts robots in that people wish for; between runs, before a timestep."""
        for wish in self._cast.due():
            out, new = wish.pair
            try:
                self._recast(wish.pair)
            except VsenseError as error:
                text = f"robot {new} does not take the role of {out}: {error}"
                self.setup.console.say(text, "trouble")
                continue
            part, control = parts_of(self.experiment)[new], self.runner.control
            whose = "its own role" if part == new else f"the role of {part}"
            text = f"{whose} from run {control.run + (control.state is State.ENDED)} on"
            self.setup.console.say(f"{wish.by}: robot {new} takes {text}", "warning")

    def _put_in_spares(self) -> None:
        """Has the roster's spares play for robots whose batteries are low, while there are some."""
        if isinstance(self.server, MixedServer):
            return
        low = low_batteries(self.runner.robots, self.setup.battery_v)
        reasons = {tag: f"robot {tag} {words}" for tag, words in low.items()}
        self._cast.ask_for_spares(reasons, self.setup.console.say)

    def _recast(self, pair: Pair) -> None:
        experiment, settled = recast(self.experiment, pair), self.environment.experiment
        environment = self.environment.recast(recast(settled, pair))
        self._make_room(pair, experiment)
        self.experiment, self.environment = experiment, environment
        starts = self.setup.starts
        if starts is not None:
            starts = replace(starts, experiment=recast(starts.experiment, pair))
        self.setup = replace(self.setup, experiment=experiment, starts=starts)
        self._put_in.add(pair[1])
        tables, taken = environment.wire_tables, self.setup.other_programs
        self.server.recast(expected_robots(experiment, tables, self._put_in, taken))
        self.runner.recast(environment)
        self.setup.room.recast(environment)

    def record_of(self, figures: Figures, failure: VsenseError | None) -> RunRecord:
        """What there was of the run that is over: by its figures, and what has ended it."""
        changes = self._changes.carried
        record = figures.record(self.runner, self.resting, self.away, changes, failure)
        return replace(record, failed=self.environment.failed())

    def judge(self, record: RunRecord) -> None:
        """Has page, recording and terminal know whether the run that is over is valid."""
        if record.timesteps:
            self.setup.room.judge(record.judge(self.setup.criteria).facts())

    def next_run(self) -> None:
        """Goes back to before the start of the next run, whose seed is one more."""
        self._put_in_spares()
        self._between()
        self.environment = self.environment.following()
        self.runner.next_run(self.environment)
        say_next(self.setup.starts, self.environment.seed, self.setup.console)
        self._over = False

    def stop(self) -> None:
        """Stops all robots and waits for their last telemetry; see `Runner.stop`."""
        # The words before a failure; otherwise they were told with their timestep.
        for text in self.environment.said():
            self._say(f"loop functions: {text}")
        # From here on silence is expected and not reported.
        self._over = True
        self.runner.stop()
        try:
            self._batteries.end()
        except VsenseError as error:
            self.setup.console.say(f"the batteries' history: {error}", "trouble")

    def doubts(self) -> list[str]:
        """How other machines could move robots without showing who they are."""
        server, host = self.server, self.setup.address[0]
        if is_loopback(host):
            return []
        port = f"robots' port on {host} (--insecure): anybody can drive robots"
        doubts = [port] if self.setup.trust.insecure else []
        if isinstance(server, MixedServer):
            where = f"original client's port {server.legacy_port} on {host}"
            doubts.append(f"{where}: any machine with a robot's address is taken for it")
        return doubts

    def _close_server(self) -> None:
        self._over = True
        self.server.close(GoodbyeCause.END, "the run has ended")

    def _on_link_event(self, event: LinkEvent) -> None:
        if event.kind not in self.quiet:
            self._say(event.text, "trouble" if event.kind in TROUBLES else "info")

    def _say(self, text: str, level: Level = "info") -> None:
        if not self._over:
            self.setup.console.say(text, level)


class RunSession(ExperimentSession):
    """The runs with real robots, from the arena states of `source`; they connect to `port`."""

    def __init__(
        self, setup: RunSetup, tracking: tuple[str, str] | None, legacy_port: int | None
    ) -> None:
        """Prepares the runs; for `tracking` see `open_source`."""
        super().__init__(setup, legacy_port)
        self._tracking = tracking

    def _open(self) -> None:
        self.source: SteadySource = open_source(self.experiment, self._tracking, self._say)
        self._stack.callback(self.source.close)
        self.port = self._start_server()
        keys, address = self.setup.trust.keys, (self.setup.address[0], self.port)
        self._daemons = OwnDaemons(address, keys, self._say)
        self._stack.callback(self._daemons.close)
        self._daemons.serve(self.experiment)
        own, suspends = self.source.own, False
        scene = self._scene("run", (), {}, Troubles())
        if own is not None:
            recorders, timestep_s = self.setup.room.recorders, self.experiment.timestep_s
            recorders.watch_session(own.session, own.tracking, timestep_s=timestep_s)
            scene = seen_by(own, scene)
            # STOP may only suspend a run (thesis, 2.3.1).
            suspends = not own.session.record.change_root_directory_on_start
        runtime = self._open_room(self.source, scene, suspends)
        runtime.open()
        self._stack.callback(runtime.close)
        # Closed first of all: the thread that watches the arena waits in it.
        self._stack.callback(self.source.close)

    def _make_room(self, pair: Pair, experiment: Experiment) -> None:
        """See `ExperimentSession`."""
        self.source.expect(experiment)
        self._daemons.serve(experiment)

    def _observe(self, step: Step | None, robots: Mapping[int, RobotStatus]) -> None:
        """See `ExperimentSession`."""
        self._daemons.look()
        super()._observe(step, robots)

    def doubts(self) -> list[str]:
        """See `ExperimentSession.doubts`."""
        return [*super().doubts(), *([self.source.doubt] if self.source.doubt else [])]
