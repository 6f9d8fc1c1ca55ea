"""Loads robots' links as a run does, while all wheels stand still: `vsense robot link`.

Every robot gets packets of the experiment's sizes at its rate, with readings that nobody looks at,
and answers with its actuators. It is to drive home (`c_src/PROTOCOL.md`, section 11) to where it
stands: so it makes its control steps, asks its base and tells the host as in a run, and neither a
controller nor a wheel moves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from threading import Event

from vsense.base.clock import host_ns
from vsense.config.specs import ControllerSpec
from vsense.robots.link.keys import LinkTrust
from vsense.robots.link.server import LinkError, LinkEvent, VirtualSensorServer
from vsense.robots.link.status import LinkFigures, RobotStatus
from vsense.robots.link.table import Direction, Entry, ExpectedRobot, Table
from vsense.robots.link.wire import GoodbyeCause, Values, Wanted

Tell = Callable[[str], None]
"""Takes a line for a person; does not wait."""

STILL_S = 0.1
"""After STOP: its three packets leave."""


def traffic_of(controller: ControllerSpec) -> Table:
    """The sensor table of the robots of a controller, as a run has it."""
    sensors = [(m.sensor.name, m.sensor.layout, Direction.SENSOR) for m in controller.sensors]
    actuators = [
        (m.actuator.name, m.actuator.layout, Direction.ACTUATOR) for m in controller.actuators
    ]
    return Table(Entry(number, *row) for number, row in enumerate(sensors + actuators, 1))


class LinkLoad:
    """A host of robots that stand; a context that says goodbye to them.

    Args:
        robots: by tag, with the table of their traffic.
        timestep_ns: how often readings leave.
        address: interface and port; 0 takes a free one.
        trust: which robots are believed.
        tell: takes what happens to links.

    Attributes:
        port: that robots connect to.

    Raises:
        LinkError: another server has the port, or the host is not this machine's.
    """

    def __init__(
        self,
        robots: Mapping[int, ExpectedRobot],
        timestep_ns: int,
        address: tuple[str, int],
        trust: LinkTrust,
        tell: Tell,
    ) -> None:
        self._tell, self._over = tell, False
        self._dt_ns = timestep_ns
        self._server = VirtualSensorServer(
            host=address[0],
            port=address[1],
            timestep_ns=timestep_ns,
            seed=1,
            expected=robots,
            trust=trust,
            on_event=self._on_event,
        )
        self._payloads = {
            tag: [bytes(size) for _, _, size in robot.table.of_direction(Direction.SENSOR)]
            for tag, robot in robots.items()
        }
        self._timestep = 0
        self.port = self._server.start()

    def __enter__(self) -> LinkLoad:
        return self

    def __exit__(self, *exception: object) -> None:
        self._over = True
        with suppress(LinkError):
            self._server.command(Wanted.STOP)
            Event().wait(STILL_S)
        self._server.close(GoodbyeCause.END, "the link was measured")

    def wait(self, limit_s: float, interrupted: Event, progress: Tell) -> int:
        """Waits until all robots are connected, for so long at most; gives how many are."""
        end_ns, there = host_ns() + round(1e9 * limit_s), 0
        while host_ns() < end_ns and there < len(self._payloads) and not interrupted.wait(0.1):
            there = sum(status.connected for status in self.robots().values())
            progress(f"{there} of {len(self._payloads)} robots connected")
        return there

    def load(self, duration_s: float, interrupted: Event, progress: Tell) -> float:
        """Sends readings every timestep, for so long or until it is interrupted.

        Returns:
            How long it did [s].

        Raises:
            LinkError: the server's thread has failed.
        """
        self._server.command(Wanted.HOME)
        self._server.measure()
        began_ns = host_ns()
        due_ns, end_ns = began_ns, began_ns + round(1e9 * duration_s)
        while due_ns < end_ns and not interrupted.wait(max(0, due_ns - host_ns()) / 1e9):
            now_ns = host_ns()
            self._send(now_ns)
            there = sum(status.connected for status in self.robots().values())
            progress(
                f"{(now_ns - began_ns) / 1e9:.0f} of {duration_s:g} s,"
                f" {there} of {len(self._payloads)} robots connected, wheels stand still"
            )
            due_ns += self._dt_ns * max(1, 1 + (host_ns() - due_ns) // self._dt_ns)
        return min(host_ns() - began_ns, end_ns - began_ns) / 1e9

    def robots(self) -> dict[int, RobotStatus]:
        """The robots now, by tag."""
        return self._server.robots()

    def measured(self) -> dict[int, LinkFigures]:
        """What the links were since `load` began, by tag."""
        return self._server.measured()

    def _send(self, now_ns: int) -> None:
        """A timestep's readings; that nobody has a goal says to stand."""
        self._timestep += 1
        values: dict[int, Values] = {
            tag: [(payload, now_ns) for payload in payloads]
            for tag, payloads in self._payloads.items()
        }
        self._server.publish(self._timestep, now_ns, values)

    def _on_event(self, event: LinkEvent) -> None:
        if not self._over and event.kind != "connected":
            self._tell(event.text)
