"""Waits for the robots, starts them together, runs the timesteps and stops them.

`vsense.modes._several` says where each run leaves its files, and whether another one follows.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from functools import partial

from vsense.base.arena import ArenaState
from vsense.base.clock import host_ns, real_s
from vsense.base.errors import NoMorePictures, VsenseError
from vsense.base.terminal import Console
from vsense.config.specs import Experiment, Stage
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.trackers.client import TrackerEnded
from vsense.robots.link.wire import Wanted
from vsense.run._standing import StandingRobots
from vsense.run.alarms import SILENCE_NS, Alarm, Obedience, Overload, stands
from vsense.run.control import DURING, HOMING, Control, State
from vsense.run.environment import Environment
from vsense.run.homing import starts
from vsense.run.robots import LinkCounters, Readiness, RobotAlarms
from vsense.run.runtime import Runtime, Step
from vsense.run.watch import NoArenaState, Silence

SILENCE_POLL_S = 0.25
"""A run without arena states checks this often whether it shall end."""

Observer = Callable[[Step | None, Mapping[int, RobotStatus]], None]
"""Called after every timestep, and with None in silences, with the status of every robot by tag;
what it raises ends the run."""

STAND_TIMEOUT_NS = 600_000_000
"""Robots that have not reported that they stand are watched so long after STOP."""

SETTLE_TIMEOUT_NS = 600_000_000
"""After the run the last telemetry may take this long to arrive: the robots hear nothing meanwhile,
and would report after 1 s, until the next state has come, that no UDP comes through ..."""

HURRY_NS = 300_000_000
"""... and this long where somebody has ended the process."""

LOOK_POLL_S = 0.02
"""Meanwhile reports are read so often."""


class Runner:
    """Runs, one after the other, from the wait for robots to the last telemetry; for one thread.

    Args:
        experiment: what to run.
        runtime: is open, or will be before `wait`.
        server: has been started.
        console: where to say what happens.
        interrupted: set to end everything.
        observe: see `Observer`.
        control: takes orders; None: there are none.
        between: is called before every timestep between runs.
        clock: the host's monotonic clock [ns].

    Attributes:
        counters: what the links sent and received, from the start of the server.
        reconnects: sessions that were opened in mid-run.
        robots: the status of every robot by tag in the newest timestep, when its readings had left.
        silences: times without arena states in the run.
        standing: the robots that stand while others run.
    """

    def __init__(
        self,
        experiment: Experiment,
        runtime: Runtime,
        server: VirtualSensorServer,
        console: Console,
        interrupted: threading.Event,
        observe: Observer = lambda step, robots: None,
        control: Control | None = None,
        clock: Callable[[], int] = host_ns,
        between: Callable[[], None] = lambda: None,
    ) -> None:
        self.counters, self.reconnects = LinkCounters(), 0
        self._alarms, self._obedience = RobotAlarms(), Obedience()
        real = experiment.stage is Stage.RUN
        makers = "cameras and this computer" if real else "this computer"
        self._overload = Overload(experiment.timestep_ns, makers, experiment.stage is Stage.LAB)
        self.silences: list[Silence] = []
        self.robots: Mapping[int, RobotStatus] = {}
        self._robots = {robot.tag: robot.id for robot in experiment.robots}
        self._objects = {thing.tag: thing.id for thing in experiment.objects}
        self._dt_ns, self._timesteps = experiment.timestep_ns, experiment.timesteps
        self._runtime = runtime
        self._server, self._console = server, console
        self._interrupted, self._observe = interrupted, observe
        self.control = control or Control(server.command, console.say)
        self._clock, self._between = clock, between
        self._heard_ns: int | None = None
        self._silent, self._run_timestep, self._end_ns, self._sessions = False, -1, 0, 0
        self._seen: frozenset[int] = frozenset()
        self.standing = StandingRobots(experiment)

    @property
    def ended(self) -> str:
        """Why the run ended: "time", "interrupted", or in words."""
        return self.control.why

    @property
    def alarms(self) -> list[Alarm]:
        """What is wrong now; any thread."""
        overload = self._overload.alarm
        return [*self._obedience.alarms, *([] if overload is None else [overload])]

    def link_figures(self) -> dict[str, int]:
        """What the links did in the run, under the names that scripts rely on."""
        counters = self.counters
        return {
            "sent": counters.sent,
            "received": counters.received,
            "dropped": counters.dropped,
            "reconnects": self.reconnects,
            "defects": counters.defects,
        }

    def wait(self, limit_s: float | None = None, busy: Callable[[], str] = lambda: "") -> Readiness:
        """Runs timesteps until every robot is connected and every marker is seen.

        Where runs are held it waits for a START; a START that comes early ends the wait at once.
        It waits for `limit_s` at the longest, None: for ever, and then while `busy` gives words.
        Gives who is there: all, unless the time is over or the wait was interrupted.
        """
        begun_ns = self._clock()
        while True:
            self._between()
            readiness = self._readiness(self._step())
            waited_ns = self._clock() - begun_ns
            over = limit_s is not None and waited_ns > limit_s * 1e9
            anybody = len(readiness.absent) < len(self._robots)
            waiting = self._waiting(readiness)
            still = busy() if readiness.complete or over else waiting
            if self._interrupted.is_set() or self._may_start(not still, anybody):
                return readiness
            stopped = self.control.state is State.EMERGENCY
            self._console.progress(waiting if stopped or not still else still)

    def _may_start(self, ready: bool, anybody: bool) -> bool:
        """Whether the run starts now; without `anybody` connected not even an order starts it."""
        control = self.control
        if control.state == State.EMERGENCY or control.asked or not ready:
            return control.asked and anybody
        if control.holds:
            control.ready()
        return not control.holds

    def _waiting(self, readiness: Readiness) -> str:
        """The live line before the run."""
        state = self.control.state
        word = {State.EMERGENCY: "EMERGENCY STOP, reset first", State.READY: "ready to start"}
        there = readiness.progress(self._heard_ns is not None)
        return f"{word.get(state, 'waiting')}: {there}"

    def home(self, homing: starts.Guide) -> None:
        """Has robots drive where they are guided, before `timesteps`; orders pause and end it."""
        control, order = self.control, self._server.command
        if self._interrupted.is_set() or not control.home(partial(order, Wanted.HOME)):
            return
        self._runtime.guide = starts.guide(homing, self._server, control)
        self.standing.begin()
        try:
            while not self._interrupted.is_set() and control.state in HOMING:
                if homing.done and control.state == State.HOMING:
                    break  # but a pause that came with the last arrival waits for its start
                self._step()
                starts.say_progress(homing, self._console)
        finally:
            self._runtime.guide = None
            control.arrive(partial(order, Wanted.IDLE))

    def timesteps(self) -> Iterator[Step]:
        """Starts all robots together; yields the run's timesteps, of which some may be missed."""
        self.counters.update(self._server.robots())
        self._sessions = self.counters.sessions
        if self._interrupted.is_set() or not self.control.begin(self._runtime.start):
            return
        self.standing.begin()
        length_ns, last = self._timesteps * self._dt_ns, self._timesteps - 1
        self._end_ns = self._clock() + length_ns
        try:
            while not self._interrupted.is_set() and self.control.state in DURING:
                step = self._step()
                if step is not None and step.run_timestep >= 0:
                    self._run_timestep = step.run_timestep
                    if last < 0 or step.run_timestep <= last:
                        late = self._overload.add(step, self.robots)
                        if late is not None:
                            self._console.say(late, "warning")
                        yield step
                # Lent pictures go back while the run is paused, unless the caller keeps the step.
                step = None
                # Arena states count the timesteps; where none come the clock ends the run.
                self._obey()
                over = self._silent and self._clock() > self._end_ns
                if last >= 0 and (self._run_timestep >= last or over):
                    self.control.end("time")
                elif self._run_timestep >= 0 and self._runtime.finished:
                    self._console.say("the loop functions say that the experiment is finished")
                    self.control.end("time")
        except (NoMorePictures, TrackerEnded) as end:
            self.control.end(str(end))

    def _obey(self) -> None:
        """Holds the world while the run is paused."""
        if self.control.state != State.PAUSED:
            return
        self._runtime.hold()
        self.standing.pause()
        begun_ns = self._clock()
        while self.control.state == State.PAUSED and not self._interrupted.is_set():
            if self.control.asked:
                self.control.begin(self._runtime.resume)
            else:
                self._step()
                self._console.progress(f"paused in timestep {self._run_timestep}")
        self._end_ns += self._clock() - begun_ns

    def rest(self) -> bool:
        """Runs on after a run, with the robots stopped, until an order wants the next one.

        False where the wait was interrupted, or there can be no other run.
        """
        try:
            while not self._interrupted.is_set() and not self.control.next_asked:
                is_free = self.control.state != State.EMERGENCY
                next_one = "start begins the next one" if is_free else "reset, then start"
                self._console.progress(f"the run has ended: {next_one}")
                self._between()
                self._step()
        except (NoMorePictures, TrackerEnded) as end:
            self._console.say(f"there can be no other run: {end}")
            return False
        return self.control.next_asked

    def next_run(self, environment: Environment) -> None:
        """Goes back to before the start of the next run, in another virtual world."""
        self._runtime.next_run(environment)
        self.control.next_run()
        self.silences, self._run_timestep = [], -1
        self.counters = self.counters.from_here()

    def recast(self, environment: Environment) -> None:
        """Goes on between runs with other robots, which the server expects already."""
        self._runtime.next_run(environment)
        self.control.wait_again()
        self._robots = {robot.tag: robot.id for robot in environment.experiment.robots}
        # Counts of who has left are no part of any later run's.
        counted = LinkCounters()
        counted.update(self._server.robots())
        self.counters = counted.from_here()
        self.standing = StandingRobots(environment.experiment)

    def stop(self) -> None:
        """Stops all robots, and waits until their telemetry says what they received."""
        if not self._interrupted.is_set() and self.control.state != State.EMERGENCY:
            # The robots have the last readings and a whole timestep to act on them.
            threading.Event().wait(real_s(self._dt_ns / 1e9))
        self._runtime.stop()
        if self._silent:
            self._note_silence()
        self.control.end("interrupted")
        verdict = self._overload.verdict(self._timesteps if self.ended == "time" else 0)
        if verdict is not None:
            self._console.say(verdict, "warning")
        self._see_them_stand()
        self._settle()
        self.reconnects = self.counters.sessions - self._sessions

    def _step(self) -> Step | None:
        """Runs one timestep; None where no arena state came for a while."""
        step: Step | None = None
        try:
            step = self._runtime.step(SILENCE_POLL_S)
        except NoArenaState:
            self._hear_nothing()
        if step is not None:
            if self._silent:
                duration_s = self._note_silence()
                self._console.say(f"arena states are back after {duration_s:.1f} s")
            self._heard_ns = step.arena_ns
            for robot, text in self._runtime.logged():
                self._console.say(f"{robot}: {text}")
            for text in self._runtime.said():
                self._console.say(f"loop functions: {text}")
            self._hold_robots(step.state)
        robots = self.robots = self._server.robots()
        for status in self.counters.update(robots):
            self._console.say(f"robot {status.tag}: its guard was replaced", "warning")
        for line, level in self._alarms.update(robots, self._clock()):
            self._console.say(line, level)
        self._say_disobedience(robots, None if step is None else step.state)
        # The readings have left.
        self._runtime.check_cameras()
        self._observe(step, robots)
        return step

    def _hold_robots(self, state: ArenaState) -> None:
        """Has robots pause that may not move, and go on when they may."""
        homing = self.control.state == State.HOMING
        if not homing and self.control.state != State.RUNNING:
            return
        exempt = {tag for tag, robot in self.robots.items() if not robot.holdable}
        if not homing:
            exempt |= self._server.resting
        for line in self.standing.update(state, homing, exempt):
            self._console.say(line, "warning")
        self._server.hold_robots(self.standing.reasons)

    def _readiness(self, step: Step | None) -> Readiness:
        # A moment without an arena state changes nothing.
        if step is not None:
            robots = step.state.robots
            self._seen = frozenset(robots["tag"][robots["seen"]].tolist())
        connected = {tag for tag, status in self.robots.items() if status.connected}
        refused = {tag: status.refused for tag, status in self.robots.items()}
        return Readiness.of(self._robots, self._objects, connected, self._seen, refused)

    def _hear_nothing(self) -> None:
        silent_ns = 0 if self._heard_ns is None else self._clock() - self._heard_ns
        if silent_ns < SILENCE_NS:
            return
        if not self._silent:
            self._silent = True
            self._console.say(
                "no arena state for half a second: the robots stand still until there is one",
                "trouble",
            )
        self._console.progress(f"no arena state for {silent_ns / 1e9:.1f} s")

    def _note_silence(self) -> float:
        """Ends a silence; gives its duration [s]."""
        assert self._heard_ns is not None
        self._silent = False
        duration_s = (self._clock() - self._heard_ns) / 1e9
        if self._run_timestep >= 0 and self.control.state != State.PAUSED:
            self.silences.append(Silence(self._run_timestep, duration_s))
        return duration_s

    def _see_them_stand(self) -> None:
        """Watches robots until they report that they stand, and says which go on.

        Robots that obey cost no time: what they report next is waited for anyhow. One that hung
        just before says nothing any more, and is left to the cameras.
        """

        def stand(robots: Mapping[int, RobotStatus]) -> bool:
            reported = all(stands(robot) for robot in robots.values() if robot.connected)
            return reported and not self._obedience.is_unsure(robots, self._clock())

        self._look_on(stand, STAND_TIMEOUT_NS)

    def _settle(self) -> None:
        """Stops sending and waits until every robot has reported what it received."""

        def told(robots: Mapping[int, RobotStatus]) -> bool:
            self.counters.update(robots)
            return self.counters.received >= self.counters.sent

        self._server.silence()
        self._look_on(told, HURRY_NS if self._interrupted.is_set() else SETTLE_TIMEOUT_NS)
        self._server.silence(False)

    def _look_on(self, done: Callable[[Mapping[int, RobotStatus]], bool], patience_ns: int) -> None:
        """Shows what is seen after a run, whose loop has ended, and says who does not obey.

        Until `done` of the robots' newest statuses, and no longer than `patience_ns`.
        """
        deadline_ns, sees = self._clock() + patience_ns, True
        robots = self._server.robots()
        while not done(robots) and self._clock() < deadline_ns:
            step = None
            if sees:
                try:
                    step = self._runtime.step(LOOK_POLL_S)
                except NoArenaState:
                    pass
                except VsenseError:
                    sees = False  # what has failed has ended the run, and is said there
            else:
                threading.Event().wait(LOOK_POLL_S)
            robots = self._server.robots()
            said = self._say_disobedience(robots, None if step is None else step.state)
            if said or step is not None:
                self._observe(step, robots)

    def _say_disobedience(self, robots: Mapping[int, RobotStatus], state: ArenaState | None) -> int:
        for line in (lines := self._obedience.update(robots, state, self._clock())):
            self._console.say(line, "trouble")
        return len(lines)
