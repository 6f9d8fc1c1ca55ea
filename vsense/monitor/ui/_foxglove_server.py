"""Serves a run or a replay to Foxglove (`--foxglove`), read-only, by a process of its own.

The process is `_foxglove_process.py`.
"""

from __future__ import annotations

import time
from collections.abc import Collection
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from vsense.base import errors
from vsense.base.clock import host_ns
from vsense.base.errors import UsageError, VsenseError
from vsense.base.message_bus import Message, MessageBus
from vsense.base.terminal import Console
from vsense.monitor.foxglove.channels import LASTING
from vsense.monitor.ui._bus_process import BusProcess, Heard
from vsense.monitor.ui.access import FoxgloveAddress, is_loopback
from vsense.robots.link import network
from vsense.run.orders import Give, Order, OrderError, OrderKind

if TYPE_CHECKING:
    from vsense.monitor.recording.reader import Recording

LAYOUT = "foxglove-layout.json"
"""The name of the layout in `vsense docs`."""
_MODULE = "vsense.monitor.ui._foxglove_process"


class FoxgloveError(VsenseError):
    """Foxglove cannot be served."""


def check_foxglove(address: FoxgloveAddress | None, taken: Collection[int | None] = ()) -> None:
    """Refuses what cannot be served, before anything is started; None: nothing is asked for.

    `taken` are the run's other ports.

    Raises:
        UsageError: the package is missing, or the port is one of `taken`.
        VsenseError: another program has the port, or the host is unknown.
    """
    if address is None:
        return
    errors.require("--foxglove needs", "foxglove")
    if address.port and address.port in taken:
        raise UsageError(
            f"--foxglove: {address.port} is a port for robots or the page, too: give it another,"
            f" such as --foxglove {address.port + 1}"
        )
    network.listen(address.host, address.port)[0].close()


class FoxgloveServer:
    """Serves what a bus carries; ends with `close`.

    Args:
        bus: what is served.
        address: where.
        console: takes a line where it is served, and about trouble.
        recording: the one that is played, None: time is now.
        give: carries out a replay's PLAY, SPEED and SEEK.
    """

    def __init__(
        self,
        bus: MessageBus,
        address: FoxgloveAddress,
        console: Console,
        recording: Recording | None = None,
        give: Give | None = None,
    ) -> None:
        self._address, self._console = address, console
        self._recording, self._give = recording, give
        self._wanted: frozenset[str] = LASTING
        self._process = BusProcess(bus, _MODULE, self._follow, self._tell_end)
        self._paused_at_s: float | None = None
        self._owes = False
        self.port = 0

    def start(self) -> None:
        """Begins to serve, and says where.

        Raises:
            VsenseError: the port is taken, or a library is missing.
        """
        check_foxglove(self._address)
        try:
            # Where a replay is comes before all else.
            port = self._process.start(self._spec(), lambda topic: topic in self._wanted, "/run")
        except VsenseError as error:
            raise FoxgloveError(f"Foxglove cannot be served: {error}") from None
        self.port = int(port)
        host = f"[{self._address.host}]" if ":" in self._address.host else self._address.host
        line = f"Foxglove: ws://{host}:{self.port}; its layout: vsense docs --path {LAYOUT}"
        for text in [line, *self._address.warnings()]:
            self._console.say(text)

    def close(self) -> None:
        """Ends the serving; can be called again."""
        self._process.close()

    def _spec(self) -> dict[str, Any]:
        address, recording = self._address, self._recording
        where = {"host": address.host, "port": address.port}
        if recording is None:
            return {**where, "utc_shift_ns": time.time_ns() - host_ns()}
        begin_ns = recording.begin_ns + recording.utc_shift_ns
        return {
            **where,
            "utc_shift_ns": recording.utc_shift_ns,
            "begin_ns": begin_ns,
            "end_ns": begin_ns + round(1e9 * recording.duration_s),
            "steered": self._give is not None and is_loopback(address.host),
        }

    def _follow(self, sent: list[Message], heard: Heard) -> None:
        for message in sent:
            self._note(message)
        for kind, value in heard:
            self._hear(kind, value)
        self._show_standing()

    def _tell_end(self, error: Exception) -> None:
        text = f"Foxglove is served no more, and the run goes on without: {error!r}"
        self._console.say(text, "warning")

    def _note(self, message: Message) -> None:
        """Keeps where a replay stands still."""
        replay = message.data.get("replay") if message.topic == "/run" else None
        if replay:
            self._paused_at_s = None if replay["playing"] else replay["position_s"]
            self._owes = self._owes and not replay["playing"]

    def _show_standing(self) -> None:
        """Has a replay that stands still tell again what somebody has begun to look at."""
        if self._owes and self._paused_at_s is not None:
            self._owes = False
            self._order(OrderKind.SEEK, self._paused_at_s)

    def _hear(self, kind: str, value: Any) -> None:
        if kind == "wants":
            wanted = frozenset(map(str, value))
            self._owes = self._owes or not wanted <= self._wanted
            self._wanted = wanted
        else:
            for name, number in value:
                self._order(OrderKind(name), number)

    def _order(self, kind: OrderKind, value: float) -> None:
        if self._give is not None:
            with suppress(OrderError):
                self._give(Order(kind, "Foxglove", value))
