"""The link to a swarm in which some robots run `vsensed` and others still the original's client."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from vsense.link.legacy_robots import LegacySwarm
from vsense.link.legacy_server import LegacyServer
from vsense.link.server import VirtualSensorServer
from vsense.link.status import RobotStatus, Teller
from vsense.link.wire import GoodbyeCause, Values, Wanted

CONTROLLER = "original client"


class MixedServer(VirtualSensorServer):
    """A virtual sensor server that speaks the original's protocol, too, on a port of its own.

    Attributes:
        legacy_port: that port; known from the start on.
        unknown: virtual sensors that robots with the original's client are not told.
    """

    def __init__(self, legacy_address: tuple[str, int], swarm: LegacySwarm, **options: Any) -> None:
        """Prepares a server; nothing is opened before `start`.

        Args:
            legacy_address: interface and port for robots with the original client.
            swarm: who of them may come.
            options: of `VirtualSensorServer`.

        Raises:
            WireError: as `VirtualSensorServer`.
        """
        super().__init__(**options)
        self.legacy_port = legacy_address[1]
        self.unknown = tuple(swarm.translation.unknown)
        self._legacy_address = legacy_address
        self._swarm = swarm
        self._on_event = Teller(options["on_event"]).tell
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

    def publish(self, timestep: int, capture_ns: int, values: Mapping[int, Values]) -> int:
        """Sends a timestep's readings to all robots; see `VirtualSensorServer.publish`."""
        sent_ns = super().publish(timestep, capture_ns, values)
        # Under the lock: a command that ends them must not come between flag and start.
        with self._legacy_lock:
            first = self._first_timestep is not None and timestep >= self._first_timestep
            if first:
                self._first_timestep = None
            if self._legacy is not None:
                self._legacy.publish(values, first)
        return sent_ns

    def command(self, wanted: Wanted, from_timestep: int = 0) -> None:
        """Sets what every robot shall do; see `VirtualSensorServer.command`.

        Robots with the original client start when the first timestep has come, and know no
        other state: whatever is not a run is the end to them.
        """
        super().command(wanted, from_timestep)
        with self._legacy_lock:
            if wanted == Wanted.RUN:
                self._first_timestep = from_timestep
            elif self._legacy is not None:
                self._first_timestep = None
                self._legacy.end()

    def robots(self) -> dict[int, RobotStatus]:
        """A snapshot of every expected robot, by tag; see `VirtualSensorServer.robots`."""
        found = super().robots()
        for tag in self._legacy.robots() if self._legacy is not None else ():
            found[tag] = replace(found[tag], connected=True, controller=CONTROLLER)
        return found

    def close(
        self, cause: GoodbyeCause = GoodbyeCause.END, text: str = "the host has ended"
    ) -> None:
        """Says goodbye to every robot and closes everything; safe to call again."""
        if self._legacy is not None:
            self._legacy.close()
        super().close(cause, text)
