"""The original virtual sensor server, for robots that still run the original's client.

Readings leave in the caller's thread, in the timestep in which they were made, as far as the
kernel takes them at once; a thread of the server's own listens, sends what was left, and notices
robots that have gone. No robot waits for another. `MixedServer` serves robots with `vsensed`, too.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from vsense.base.clock import host_ns
from vsense.robots.link._listening import Client, ListeningServer
from vsense.robots.link.legacy.protocol import LegacyRobot, LegacySwarm
from vsense.robots.link.server import NO_GOALS, VirtualSensorServer
from vsense.robots.link.status import EventKind, EventThrottle, LinkEvent, RobotStatus
from vsense.robots.link.strangers import SUMMARY_PERIOD_NS
from vsense.robots.link.table import Goal
from vsense.robots.link.wire import GoodbyeCause, ReadingValues, Wanted

LEGACY_WRITE_TIMEOUT_NS = 5_000_000_000
"""A robot that takes nothing of what waits for it for this long is gone."""

COMES_MAX = 6
"""A robot that connects more often than that in `SUMMARY_PERIOD_NS` keeps its connection."""

_KEEPALIVE = (1, 3)


class _Connection(Client):
    def __init__(
        self, sock: socket.socket, origin: str, octet: int, robot: LegacyRobot, now_ns: int
    ) -> None:
        super().__init__(sock, robot, LEGACY_WRITE_TIMEOUT_NS, _KEEPALIVE, now_ns)
        self.octet = octet
        self.origin = origin
        self.robot = robot


class LegacyServer(ListeningServer):
    """Serves robots with the original client; its methods may be called by any thread.

    The `swarm` belongs to this server from now on. `on_event` must not wait, nor call the server.
    The rest is as for `ListeningServer`.
    """

    def __init__(
        self,
        host: str,
        port: int,
        swarm: LegacySwarm,
        on_event: Callable[[LinkEvent], None],
        clock: Callable[[], int] = host_ns,
    ) -> None:
        super().__init__("the original's virtual sensor server", host, port, clock)
        self._swarm = swarm
        # Of what is refused a few lines are told; that robots come and go always is.
        self._throttle = EventThrottle(on_event, port=f"port {self.port}")
        self._connections: dict[int, _Connection] = {}
        self._came: dict[int, list[int]] = {}

    def publish(self, values: Mapping[int, ReadingValues], first: bool = False) -> None:
        """Sends every robot what has changed in its readings, by tag, and waits for none.

        With the `first` ones the experiment starts, also for robots that come later.

        Raises:
            LinkError: the server's thread has failed.
        """
        self._check()
        with self._lock:
            for tag, translation in self._swarm.translations.items():
                if tag in values:
                    self._swarm.sense(tag, translation.payloads(values[tag]))
            if first:
                self._swarm.start()
            now_ns = self._clock()
            # The server's thread drops robots that are lost.
            left = [c for c in self._connections.values() if c.write(now_ns) or c.robot.pending]
        if left:
            self._waker.wake()

    def end(self) -> None:
        """Ends the experiment for all robots."""
        with self._lock:
            self._swarm.end()
        self._waker.wake()

    def robots(self) -> dict[int, int]:
        """By tag of each connected robot, how many updates it was sent."""
        with self._lock:
            return {robot.tag: robot.updates for robot in self._swarm.robots.values()}

    def close(self) -> None:
        """Ends the experiment and closes everything; can be called again."""
        self.end()
        self._ending = True
        self._join()

    # --- the server's thread

    def _greet(self, sock: socket.socket, origin: str) -> None:
        octet = int(origin.rpartition(".")[2]) if origin.count(".") == 3 else 0
        with self._lock:
            why = self._why_not(octet, origin)
            robot = None if why else self._swarm.join(octet)
            before = self._connections.get(octet)
            if robot is None:
                sock.close()
            else:
                if before is not None:
                    self._drop(before, "has come again")
                connection = _Connection(sock, origin, octet, robot, self._clock())
                self._connections[octet] = connection
                self._admit(connection)
        if robot is None:
            text = f"refused a robot with the original client from {origin}: {why}"
            self._throttle.notify(LinkEvent("refused", None, text, self._clock(), origin))
            return
        text = f"robot {robot.tag}: connected with the original client"
        self._notify("connected", robot.tag, text)

    def _why_not(self, octet: int, origin: str) -> str:
        """Why nobody who comes from there is let in, "" where that is a robot; the lock is held."""
        before = self._connections.get(octet)
        if not self._swarm.expects(octet):
            return self._swarm.why_not(octet)
        if before is not None and before.origin != origin:
            return f"{before.robot.name} is connected, from {before.origin}"
        now_ns = self._clock()
        recent = [at for at in self._came.get(octet, ()) if now_ns - at < SUMMARY_PERIOD_NS]
        if len(recent) >= COMES_MAX:
            return f"it came {COMES_MAX} times in the last {SUMMARY_PERIOD_NS // 10**9} s"
        self._came[octet] = [*recent, now_ns]
        return ""

    def _hear(self, client: _Connection) -> None:
        """Notices robots that have gone; none ever says anything."""
        with self._lock:
            if self._connections.get(client.octet) is not client:
                return
            said, why = client.read()
            if said:
                why = "says something, which the original client never does: turned away"
            if why:
                self._drop(client, why)

    def _settle(self) -> None:
        self._throttle.tick(self._clock())
        for connection in list(self._connections.values()):
            why = connection.write(self._clock())
            if why:
                self._drop(connection, why)
            else:
                self._await(connection, connection.robot.pending)

    def _let_go(self) -> None:
        for connection in list(self._connections.values()):
            self._drop(connection, "")

    def _drop(self, connection: _Connection, why: str) -> None:
        """Closes a robot's connection; the lock is held."""
        if self._connections.get(connection.octet) is connection:
            del self._connections[connection.octet]
        self._swarm.leave(connection.octet, connection.robot)
        self._dismiss(connection)
        if why:
            robot = connection.robot
            self._notify("lost", robot.tag, f"robot {robot.tag}: {why}")

    def _notify(self, kind: EventKind, tag: int | None, text: str) -> None:
        self._throttle.notify(LinkEvent(kind, tag, text, self._clock()))

    def _say(self, text: str) -> None:
        self._notify("protocol_error", None, text)

    def _unsent(self) -> bool:
        with self._lock:
            return any(c.robot.pending for c in self._connections.values())


LEGACY_CONTROLLER = "original client"


class MixedServer(VirtualSensorServer):
    """A virtual sensor server that speaks the original's protocol, too, on a port of its own.

    Args:
        legacy_address: interface and port for robots with the original client.
        swarm: which of them may come.
        options: of `VirtualSensorServer`, which says what is raised, too.

    Attributes:
        legacy_port: that port; known from the start on.
        unknown: virtual sensors that robots with the original's client do not get.
    """

    def __init__(self, legacy_address: tuple[str, int], swarm: LegacySwarm, **options: Any) -> None:
        super().__init__(**options)
        self.legacy_port = legacy_address[1]
        self.unknown = swarm.unknown
        self._legacy_address = legacy_address
        self._swarm = swarm
        self._on_event = options["on_event"]
        self._legacy: LegacyServer | None = None
        self._first_timestep: int | None = None
        self._legacy_lock = threading.Lock()

    def start(self) -> int:
        """Takes both ports; see `VirtualSensorServer.start`."""
        host, port = self._legacy_address
        legacy = LegacyServer(host, port, self._swarm, self._on_event)
        try:
            own = super().start()
        except BaseException:
            legacy.close()
            raise
        self.legacy_port = legacy.start()
        self._legacy = legacy
        return own

    def publish(
        self,
        timestep: int,
        capture_ns: int,
        values: Mapping[int, ReadingValues],
        goals: Mapping[int, Goal] = NO_GOALS,
    ) -> int:
        """See `VirtualSensorServer.publish`; robots with the original's client drive nowhere."""
        sent_ns = super().publish(timestep, capture_ns, values, goals)
        # Under the lock: a command that ends them must not come between flag and start.
        with self._legacy_lock:
            first = self._first_timestep is not None and timestep >= self._first_timestep
            if first:
                self._first_timestep = None
            if self._legacy is not None:
                self._legacy.publish(values, first)
        return sent_ns

    def command(self, wanted: Wanted, from_timestep: int = 0) -> None:
        """See `VirtualSensorServer.command`.

        Robots with the original client start when the first timestep has come, and know no other
        state: anything but a run is the end to them, except what is told before it: that others
        drive home, and stand there.
        """
        super().command(wanted, from_timestep)
        with self._legacy_lock:
            if wanted == Wanted.RUN:
                self._first_timestep = from_timestep
            elif self._first_timestep is None and wanted in (Wanted.HOME, Wanted.IDLE):
                return
            elif self._legacy is not None:
                self._first_timestep = None
                self._legacy.end()

    def robots(self) -> dict[int, RobotStatus]:
        """See `VirtualSensorServer.robots`."""
        statuses = super().robots()
        for tag in self._legacy.robots() if self._legacy is not None else ():
            statuses[tag] = replace(statuses[tag], connected=True, controller=LEGACY_CONTROLLER)
        return statuses

    def close(
        self, cause: GoodbyeCause = GoodbyeCause.END, text: str = "the host has ended"
    ) -> None:
        """See `VirtualSensorServer.close`."""
        if self._legacy is not None:
            self._legacy.close()
        super().close(cause, text)
