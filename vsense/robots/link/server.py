"""The virtual sensor server: the host's side of the link to all robots.

Readings leave in the caller's thread, in the timestep in which they were made; a thread of the
server's own listens, answers, and repeats the newest STATE to every robot at least every 50 ms.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

from vsense.base.clock import host_ns
from vsense.robots.link import network as ports
from vsense.robots.link._meter import LinkMeter
from vsense.robots.link._peer import Orders
from vsense.robots.link._roster import SessionTable
from vsense.robots.link._shared import ServerState
from vsense.robots.link.keys import LinkTrust
from vsense.robots.link.network import ServerThread
from vsense.robots.link.status import (
    ActuatorReport,
    EventThrottle,
    LinkError,
    LinkEvent,
    LinkFigures,
    RobotStatus,
)
from vsense.robots.link.table import STAY, ExpectedRobot, Goal
from vsense.robots.link.wire import GoodbyeCause, ReadingValues, ShownData, Wanted

MOVING = frozenset({Wanted.RUN, Wanted.HOME})
"""In these the wheels may turn; in the others they stand still."""

NO_GOALS: Mapping[int, Goal] = {}

JOIN_TIMEOUT_S = 5.0
"""How long `close` waits for the thread; it needs half a second at most."""


class VirtualSensorServer:
    """Sessions with all robots of an experiment. Its methods may be called by any thread.

    Nothing is opened before `start`, from which on `port` is the port's number.

    Args:
        host: name or address of the interface to listen on.
        port: number for TCP and UDP; 0 takes any that is free on both.
        timestep_ns, seed, expected, trust: see `SessionTable`, which says what is raised, too.
        on_event: called from the server's thread; must not wait, nor call `close`.
        clock: the host's monotonic clock [ns].
        calendar: seconds since 1970. The first run's number is taken from it, so that the robots
            of a host that died never take its successor's run for the one before.
    """

    _network: ServerThread | None = None
    _thread: threading.Thread | None = None
    _failure: BaseException | None = None

    def __init__(
        self,
        *,
        host: str,
        port: int,
        timestep_ns: int,
        seed: int,
        expected: Mapping[int, ExpectedRobot],
        trust: LinkTrust,
        on_event: Callable[[LinkEvent], None],
        clock: Callable[[], int] = host_ns,
        calendar: Callable[[], float] = time.time,
    ) -> None:
        self._host, self._port = host, port
        self.port = port
        self._roster = SessionTable(expected, timestep_ns, seed, trust)
        self._roster.orders = Orders(int(calendar()))
        self._lock = threading.Lock()
        self._clock = clock
        throttle = self._throttle = EventThrottle(on_event, expected.keys())
        self._shared = ServerState(self._roster, self._lock, clock, throttle.notify, throttle.tick)
        self._goodbye = (GoodbyeCause.END, "")
        self._ordered_ns = clock()
        self._held_ns: dict[int, int] = {}
        self._shown: Mapping[int, ShownData] = {}

    def start(self) -> int:
        """Takes the port on TCP and UDP and begins to serve; returns the port's number.

        Raises:
            LinkError: another server has the port, or the host is not this machine's.
        """
        if self._thread is not None:
            raise LinkError("the virtual sensor server was started already")
        bound = ports.bind(self._host, self._port)
        self._network = ServerThread(self._shared, bound)
        self._thread = threading.Thread(target=self._serve, name="vsense-link", daemon=True)
        self._thread.start()
        self.port = bound.port
        return bound.port

    def publish(
        self,
        timestep: int,
        capture_ns: int,
        values: Mapping[int, ReadingValues],
        goals: Mapping[int, Goal] = NO_GOALS,
    ) -> int:
        """Sends the readings of a timestep to every robot, now and without waiting for any.

        Args:
            timestep: of the arena state.
            capture_ns: when the arena was seen, host's clock.
            values: by tag, the readings in the order of its table. A robot that is not in it is
                sent its last readings again, with their own capture times.
            goals: by tag, where robots are to drive with HOME; who is not in it stays.

        Returns:
            When the last packet had left, host's clock [ns].

        Raises:
            LinkError: the server has not been started, or its thread has failed.
            ValueError: readings do not fit the table.
        """
        network = self._running()
        # The lock is kept throughout: the server's thread would else be woken between any two
        # robots, and the two hand Python's own lock to and fro.
        with self._lock:
            for tag, robot in self._roster.robots.items():
                robot.hold(timestep, capture_ns, values.get(tag), goals.get(tag, STAY))
            network.send_all(r for r in self._roster.robots.values() if r.open)
        network.wake_for_streams()
        return self._clock()

    def command(self, wanted: Wanted, from_timestep: int = 0) -> None:
        """Sets what every robot shall do, until the next command; it leaves at once.

        With RUN, `from_timestep` is the first timestep in which the robots run. STOP leaves three
        times, 10 ms apart, the first time by UDP and TCP. Raises LinkError as `publish` does.
        """
        network = self._running()
        with self._lock:
            orders = replace(self._roster.orders, wanted=wanted, from_timestep=from_timestep)
            self._order(orders)
        self._send_orders(network, repeat=wanted == Wanted.STOP)

    def rest(self, tags: Collection[int]) -> None:
        """Has robots with these tags stand while others run, and nobody else, until the next run.

        They drive home as the others do.
        """
        with self._lock:
            self._roster.orders = replace(self._roster.orders, resting=frozenset(tags))

    @property
    def resting(self) -> frozenset[int]:
        """Tags of robots that rest: see `rest`."""
        return self._roster.orders.resting

    def hold_robots(self, reasons: Mapping[int, str]) -> None:
        """Has robots pause while others run or drive home, and nobody else; it leaves at once.

        `reasons` says why, by tag. Until the next run. Raises LinkError as `publish` does.
        """
        network = self._running()
        with self._lock:
            before, now_ns = self._roster.orders.held, self._clock()
            self._held_ns = {tag: self._held_ns.get(tag, now_ns) for tag in reasons}
            self._roster.orders = replace(self._roster.orders, held=dict(reasons))
        if before.keys() != reasons.keys():
            self._send_orders(network)

    def new_run(self, seed: int) -> int:
        """Begins a new run, all robots idle, no reading measured yet; returns its number.

        Where its seed is another one, robots are asked to come back for their controllers' seeds,
        and are not connected until then. Raises LinkError as `publish` does.
        """
        network = self._running()
        with self._lock:
            self._order(Orders(self._roster.orders.run + 1))
            self._roster.new_run(seed)
        self._send_orders(network)
        return self._roster.orders.run

    def recast(self, expected: Mapping[int, ExpectedRobot]) -> None:
        """Expects other robots from now on, to be called between runs.

        Who stays keeps its session; who leaves is told goodbye, and turned away from then on.
        Raises LinkError as `publish` does, and LinkError where this server cannot do it.
        """
        network = self._running()
        with self._lock:
            gone = self._roster.recast(expected)
        self._throttle.expect(expected.keys())
        network.part(gone, "another robot has its role")

    def silence(self, silent: bool = True) -> None:
        """Sends no STATE any more, or again, so that telemetry can catch up.

        To be called after STOP: to the robots it is the silence of a dead host. Raises LinkError as
        `publish` does.
        """
        self._running().silent = silent

    def robots(self) -> dict[int, RobotStatus]:
        """A snapshot of every expected robot, by tag."""
        statuses = {}
        with self._lock:
            now_ns, orders = self._clock(), self._roster.orders
            for tag, robot in self._roster.robots.items():
                ordered_ns = max(self._ordered_ns, self._held_ns.get(tag, 0))
                statuses[tag] = robot.status(now_ns, orders, ordered_ns)
        for tag, shown in self._shown.items():
            status = statuses.get(tag)
            if status is not None and status.telemetry is not None:
                shows = status.telemetry._replace(shown=shown)
                statuses[tag] = replace(status, telemetry=shows)
        return statuses

    def show(self, shown: Mapping[int, ShownData]) -> None:
        """What controllers on the host show of their robots, by tag: their robots show nothing."""
        self._shown = dict(shown)

    def measure(self) -> None:
        """Begins to measure the links of all robots, from now on."""
        with self._lock:
            for robot in self._roster.robots.values():
                robot.meter = LinkMeter()

    def measured(self) -> dict[int, LinkFigures]:
        """What the links were since `measure`, by tag; none before it."""
        with self._lock:
            now_ns, robots = self._clock(), self._roster.robots.items()
            meters = {tag: robot.meter for tag, robot in robots if robot.meter is not None}
            return {tag: meter.figures(now_ns) for tag, meter in meters.items()}

    def reports(self) -> dict[int, ActuatorReport]:
        """What the robots' virtual actuators report in the present run, by tag.

        A robot is missing before its first report, without a session, and `status.LIFE_NS` after
        its newest control step.
        """
        by_tag = {}
        with self._lock:
            run, now_ns = self._roster.orders.run, self._clock()
            for tag, robot in self._roster.robots.items():
                report = robot.reporter.report(run, now_ns)
                if report is not None:
                    by_tag[tag] = report
        return by_tag

    def strays(self) -> dict[str, int]:
        """Datagrams that belonged to no session, by the reason's name in C."""
        return dict(self._network.strays) if self._network is not None else {}

    def close(
        self, cause: GoodbyeCause = GoodbyeCause.END, text: str = "the host has ended"
    ) -> None:
        """Says goodbye to every robot and closes everything; safe to call again."""
        if self._network is None or self._thread is None:
            return
        self._goodbye = (cause, text)
        self._network.end()
        self._thread.join(JOIN_TIMEOUT_S)

    def _order(self, orders: Orders) -> None:
        """Sets what every robot shall do; the lock is held."""
        if (orders.wanted in MOVING) != (self._roster.orders.wanted in MOVING):
            self._ordered_ns = self._clock()
        self._roster.orders = orders

    def _running(self) -> ServerThread:
        if self._failure is not None:
            raise LinkError(f"the link to the robots has failed: {self._failure!r}")
        if self._network is None:
            raise LinkError("the virtual sensor server has not been started")
        return self._network

    def _send_orders(self, network: ServerThread, repeat: bool = False) -> None:
        for robot in self._roster.robots.values():
            with self._lock:
                if robot.open:
                    now_ns = self._clock()
                    network.send(robot, now_ns, surely=repeat)
                    if repeat:
                        robot.repeat_stop(now_ns)
        network.wake()

    def _serve(self) -> None:
        """The thread. A failure here is a bug; it is kept for the next caller."""
        network = self._network
        assert network is not None
        try:
            network.run()
            network.finish(*self._goodbye)
        except BaseException as error:
            self._failure = error
            raise
        finally:
            network.close()
