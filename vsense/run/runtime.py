"""The runtime: every timestep of the host, from the pictures to the datagrams.

Two threads, as in the thesis: one watches the arena (grabber and tracker, or the link to another
tracker), the other runs the world (world, virtual sensors, server). The double buffer of
`vsense.run.watch` lies between them, so a slow world never holds the cameras up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from vsense.base.arena import ArenaState, Frame
from vsense.base.clock import host_ns
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.table import Goal
from vsense.robots.link.wire import ReadingValues, Wanted
from vsense.run.changes import Changes
from vsense.run.environment import Environment
from vsense.run.watch import WATCH_TIMEOUT_S, ArenaSource, Watch

FOLLOW = 100
"""The grid of the timesteps follows a tracker of nearly the same rate by up to one part in this
many, so that the two do not drift apart."""


class Pace:
    """Numbers capture times, from 0 at the first one.

    An experiment sets the length of its timesteps; a tracker or a camera may be faster or slower,
    or fall silent. The number of a timestep therefore follows from the capture time: a state too
    early for the next timestep is passed over, and a pause leaves timesteps out.
    """

    def __init__(self, timestep_ns: int) -> None:
        self._timestep_ns = timestep_ns
        self._epoch_ns = 0
        self._newest = -1
        self._passed_over = False

    def timestep(self, capture_ns: int) -> int | None:
        """Gives the number of the timestep that a state begins, greater than all before.

        None where the newest timestep is not over yet. `capture_ns` is of a steady clock.
        """
        if self._newest < 0:
            self._epoch_ns, self._newest = capture_ns, 0
            return 0
        span_ns = self._timestep_ns
        number = (capture_ns - self._epoch_ns + span_ns // 2) // span_ns
        if number <= self._newest:
            self._passed_over = True
            return None
        if not self._passed_over:
            # Of a faster tracker the first state in time is taken, which has no fixed phase.
            late_ns = capture_ns - self._epoch_ns - number * span_ns
            self._epoch_ns += max(-span_ns // FOLLOW, min(late_ns, span_ns // FOLLOW))
        self._newest, self._passed_over = number, False
        return number


START_LEAD = 3
"""START names a timestep this many ahead, so that one lost datagram delays no robot."""


@dataclass(frozen=True, slots=True)
class GivenDeeds:
    """What the robots gave the world in one of its timesteps.

    Attributes:
        count: of the world's timesteps before this one.
        orders: so many changes were carried out in the world before it.
        reports: by tag, the actuators' block of each robot's newest report, as on the wire.
        senders: by tag, who reports.
    """

    count: int
    reports: Mapping[int, bytes]
    senders: Mapping[int, bytes]
    orders: int = 0


@dataclass(frozen=True, slots=True)
class Step:
    """One timestep of the host; times are the host's monotonic clock in ns.

    Attributes:
        timestep: the cameras' trigger number.
        run_timestep: timestep of the run, from 0; -1 before it.
        capture_ns: middle of the exposure.
        ready_ns: the last picture was in memory.
        arena_ns: the arena state was done.
        sent_ns: the last robot's datagram had left.
        frames: valid as long as this refers to them, see
            `vsense.vision.cameras.grabber.Grabber.next`.
        given: what the robots gave the world; None: it was held.
    """

    timestep: int
    run_timestep: int
    capture_ns: int
    ready_ns: int
    arena_ns: int
    sent_ns: int
    state: ArenaState
    frames: Sequence[Frame]
    given: GivenDeeds | None = None


class Runtime:
    """Calls grabber, world, sensors and server in order.

    The world updates, senses and sends in the same timestep in which the arena state arrived.
    `readings` is what every robot was sent last, by tag: (value, capture time) per sensor;
    `changes` are those that people ask for, None: there are none; `guide` says where robots that
    drive home are to drive, None: none does.
    """

    guide: Callable[[ArenaState], Mapping[int, Goal]] | None = None

    def __init__(
        self,
        source: ArenaSource,
        environment: Environment,
        server: VirtualSensorServer,
        clock: Callable[[], int] = host_ns,
        changes: Changes | None = None,
    ) -> None:
        self.changes = changes
        self._source = source
        self._watch = Watch(source, clock)
        self._environment = environment
        self._server = server
        self.readings: Mapping[int, ReadingValues] = {}
        self._last_timestep = -1
        self._first_timestep: float = math.inf
        self._lived = -1
        self._held = False
        self._count = 0

    def open(self) -> None:
        """Begins to watch the arena."""
        self._watch.start()

    def close(self) -> None:
        """Ends the watch."""
        self._watch.close()

    def start(self) -> int:
        """Starts all robots together a few timesteps from now; gives the run's first timestep."""
        self._source.start()
        return self.resume()

    def hold(self) -> None:
        """Holds the virtual world; the robots must be told separately.

        They are sent their last readings again, which say how old they are.
        """
        self._held, self._first_timestep = True, math.inf

    def resume(self) -> int:
        """Has world and robots go on together where they were held; gives the timestep of that."""
        first = self._last_timestep + START_LEAD
        self._first_timestep = first - (self._lived + 1)
        self._server.command(Wanted.RUN, first)
        return first

    def stop(self) -> None:
        """Stops all robots at once; the virtual world stays as it is."""
        self._server.command(Wanted.STOP)
        self.hold()
        self._source.stop()

    def next_run(self, environment: Environment) -> int:
        """Goes back to before the start, in another world with the same sensors and actuators.

        Returns the number by which the robots know the run.
        """
        self._environment = environment
        self._first_timestep, self._lived, self._held = math.inf, -1, False
        self._count = 0
        if self.changes is not None:
            self.changes.carried = 0
        return self._server.new_run(environment.seed)

    def step(self, timeout_s: float = 2 * WATCH_TIMEOUT_S) -> Step:
        """Runs one timestep: waits for its arena state and has the readings sent.

        Raises:
            NoArenaState: none came in time.
            VsenseError: something of the host has failed.
        """
        newest = self._watch.next(timeout_s)
        state = newest.state
        self._last_timestep = state.timestep
        run_timestep = self._run_timestep(state.timestep)
        if self.changes is not None:
            self.changes.carry_out(self._environment, state.timestep, run_timestep)
        given = None if self._held else self._sense(state, run_timestep)
        goals = () if self.guide is None else (self.guide(state),)
        newest_ns = state.capture_ns
        sent = {**self.readings, **self._environment.commands}
        sent_ns = self._server.publish(state.timestep, newest_ns, sent, *goals)
        return Step(
            timestep=state.timestep,
            run_timestep=run_timestep,
            capture_ns=state.capture_ns,
            ready_ns=newest.ready_ns,
            arena_ns=newest.done_ns,
            sent_ns=sent_ns,
            state=state,
            frames=newest.frames,
            given=given,
        )

    def check_cameras(self) -> None:
        """See `ArenaSource.check_cameras`."""
        self._source.check_cameras()

    def logged(self) -> Sequence[tuple[str, str]]:
        """See `Environment.logged`."""
        return self._environment.logged()

    def said(self) -> Sequence[str]:
        """See `Environment.said`."""
        return self._environment.said()

    @property
    def finished(self) -> bool:
        """See `Environment.finished`."""
        return self._environment.finished

    def _sense(self, state: ArenaState, run_timestep: int) -> GivenDeeds:
        """Runs a timestep in the virtual world; gives what the robots did in it."""
        reports = self._server.reports()
        payloads = {tag: report.payload for tag, report in reports.items()}
        senders = {tag: report.uid for tag, report in reports.items()}
        heard_ns = {tag: report.heard_ns for tag, report in reports.items()}
        self.readings = self._environment.step(state, run_timestep, payloads, senders, heard_ns)
        self._server.show(self._environment.shown)
        self._count += 1
        orders = 0 if self.changes is None else self.changes.carried
        return GivenDeeds(self._count - 1, payloads, senders, orders)

    def _run_timestep(self, timestep: int) -> int:
        """The run's timestep; -1 before the run, and while it is held."""
        run_timestep = timestep - self._first_timestep
        if run_timestep <= self._lived:
            return -1
        self._held, self._lived = False, int(run_timestep)
        return self._lived
