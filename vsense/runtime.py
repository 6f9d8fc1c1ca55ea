"""The runtime: one timestep of the host, from the pictures to the datagrams, in a fixed order.

It is the only module of the host that reads the clock: every other box is told the time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from vsense.arena import ArenaState, Frame
from vsense.link.server import VirtualSensorServer
from vsense.link.wire import Values, Wanted
from vsense.sensors.bank import SensorBank
from vsense.tracking.grabbers import Grabber
from vsense.world.world import World

START_LEAD = 3
"""START names a timestep this many ahead, so that one lost datagram delays no robot."""


class Tracker(Protocol):
    """What turns pictures into the arena state."""

    def update(self, frames: Sequence[Frame]) -> ArenaState:
        """Finds and follows the robots in one timestep's pictures."""


@dataclass(frozen=True, slots=True)
class Step:
    """One timestep as the host lived it; times are the host's monotonic clock in ns.

    Attributes:
        timestep: the cameras' trigger number.
        run_timestep: timestep of the run, from 0; -1 before it.
        capture_ns: middle of the exposure.
        ready_ns: the last picture was in memory.
        arena_ns: the arena state was done.
        sent_ns: the last robot's datagram had left.
        state: the arena state.
        frames: the pictures; valid until the grabber needs their memory again.
    """

    timestep: int
    run_timestep: int
    capture_ns: int
    ready_ns: int
    arena_ns: int
    sent_ns: int
    state: ArenaState
    frames: Sequence[Frame]

    def without_frames(self) -> Step:
        """The same, without holding on to the pictures."""
        return replace(self, frames=())


class Runtime:
    """Calls every box of the host in order.

    The world updates, senses and sends in the same timestep in which the arena state arrived.

    Attributes:
        readings: what every robot was sent last, by tag: (value, capture time) per sensor.
    """

    def __init__(
        self,
        grabber: Grabber,
        tracker: Tracker,
        world: World,
        bank: SensorBank,
        server: VirtualSensorServer,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._grabber = grabber
        self._tracker = tracker
        self._world = world
        self._bank = bank
        self._server = server
        self._clock = clock
        self.readings: Mapping[int, Values] = {}
        self._last_timestep = -1
        self._first_timestep: int | None = None

    def start(self) -> int:
        """Starts all robots together a few timesteps from now.

        Returns:
            The timestep that is the run's first.
        """
        self._first_timestep = self._last_timestep + START_LEAD
        self._server.command(Wanted.RUN, self._first_timestep)
        return self._first_timestep

    def stop(self) -> None:
        """Stops all robots at once."""
        self._server.command(Wanted.STOP)

    def step(self, timeout_s: float = 2.0) -> Step:
        """Lives one timestep: waits for its pictures and has the readings sent.

        Raises:
            GrabberError: no picture came in time.
        """
        frames = self._grabber.next(timeout_s)
        state = self._tracker.update(frames)
        arena_ns = self._clock()
        self._last_timestep = state.timestep
        run_timestep = self._run_timestep(state.timestep)
        self._world.update(state, max(run_timestep, 0))
        self.readings = self._bank.encode(self._world, state.timestep)
        sent_ns = self._server.publish(state.timestep, state.capture_ns, self.readings)
        ready_ns = max(frame.ready_ns for frame in frames)
        return Step(
            state.timestep,
            run_timestep,
            state.capture_ns,
            ready_ns,
            arena_ns,
            sent_ns,
            state,
            frames,
        )

    def _run_timestep(self, timestep: int) -> int:
        if self._first_timestep is None or timestep < self._first_timestep:
            return -1
        return timestep - self._first_timestep
