"""What a control room is told of the runs of robots, and how somebody takes their robots over."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from vsense.monitor.recording.form import Data
from vsense.monitor.ui import keyboard
from vsense.monitor.ui.messages import ExperimentFacts
from vsense.monitor.ui.publisher import Publisher
from vsense.monitor.ui.room import ControlRoom, RoomCallbacks
from vsense.robots.link import strangers
from vsense.robots.link.server import VirtualSensorServer
from vsense.run.alarms import Alarm
from vsense.run.control import DURING, Control
from vsense.run.environment import Environment
from vsense.run.orders import Order, OrderError, OrderKind
from vsense.run.runtime import Runtime


@dataclass(frozen=True, slots=True)
class SessionCallbacks:
    """What a session says beside the state of its runs, and how it ends; for any thread.

    Attributes:
        doubts: how other machines could move robots without showing who they are.
        alarms: gives what is wrong with the run now.
        spares: gives the robots that may be put in for others.
        leave: ends the process in order, as Ctrl-C does.
    """

    doubts: Sequence[str]
    alarms: Callable[[], Sequence[Alarm]]
    spares: Callable[[], list[int]]
    leave: Callable[[], None]


class RunSteering:
    """Shows the runs of a session in its control room, and takes orders for them.

    Args:
        room: where they are shown.
        facts: what all runs have in common.
        environment: the present run's virtual world.
        runtime: has the readings that the robots were sent.
    """

    def __init__(
        self,
        room: ControlRoom,
        facts: ExperimentFacts,
        environment: Environment,
        server: VirtualSensorServer,
        runtime: Runtime,
        control: Control,
        callbacks: SessionCallbacks,
    ) -> None:
        self._room, self._facts, self._server = room, facts, server
        self._control, self._callbacks = control, callbacks
        self._changes = runtime.changes
        self._publisher = Publisher(
            room.bus,
            facts,
            environment,
            runtime,
            control,
            self._run_facts,
            changes=runtime.changes,
            alarms=callbacks.alarms,
        )

    def open(self) -> None:
        """Opens the room; VsenseError if it cannot be served."""
        if shortage := strangers.shortage():
            self._room.console.say(shortage, "warning")
        changes, publisher = self._changes, self._publisher
        self._room.open(
            RoomCallbacks(
                self._control.give,
                self.status,
                self.hand_over,
                None if changes is None else changes.ask,
                lambda: publisher.time_s,
                keys=keyboard.HELP,
                publisher=publisher,
            )
        )

    def status(self) -> Data:
        """The answer to `vsense control status`; any thread."""
        publisher, server = self._publisher, self._server
        name = publisher.environment.experiment.name
        status = self._room.status_data(name, self._facts.command, publisher.run_data())
        return {**status, "port": server.port, "robots": publisher.robots_data(server.robots())}

    def hand_over(self, by: str, force: bool) -> str:
        """Ends the process, so that its robots are free; see `HandOver` of the control socket."""
        if self._control.state in DURING:
            if not force:
                now = self._publisher.run_data()
                raise OrderError(
                    f"run {now['run']} is {self._control.state.value}, {now['time_s']:.0f} s:"
                    " with --force it ends"
                )
            self._control.give(Order(OrderKind.STOP, by))
        self._room.console.say(f"{by} takes the robots over: vsense ends", "warning")
        self._callbacks.leave()
        return "gives its robots back, and ends"

    def _run_facts(self) -> Data:
        callbacks = self._callbacks
        return {
            **self._room.run_data(),
            "doubts": list(callbacks.doubts),
            "spares": [] if self._room.locked else callbacks.spares(),
        }
