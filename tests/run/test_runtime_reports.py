"""The runtime hands the robots' newest reports to the virtual world, and its readings to them."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vsense.base.arena import POSE, ArenaState, Frame
from vsense.robots.link.status import ActuatorReport
from vsense.robots.link.wire import ReadingValues, ShownData, Wanted
from vsense.run.runtime import START_LEAD, Runtime


class Source:
    """Gives an arena state whenever the test lets it."""

    def __init__(self) -> None:
        self.due = threading.Semaphore(0)
        self._timestep = -1

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        assert self.due.acquire(timeout=20.0)
        self._timestep += 1
        return ArenaState(self._timestep, self._timestep, np.zeros(0, dtype=POSE), 0), ()

    def start(self) -> None:
        """See `ArenaSource`."""

    def stop(self) -> None:
        """See `ArenaSource`."""


class Robots:
    """Stands in for the virtual sensor server."""

    def __init__(self) -> None:
        self.said: dict[int, ActuatorReport] = {}
        self.sent: list[Mapping[int, ReadingValues]] = []

    def show(self, shown: Mapping[int, ShownData]) -> None:
        """There is nobody to show it to."""

    def reports(self) -> dict[int, ActuatorReport]:
        return dict(self.said)

    def publish(self, timestep: int, capture_ns: int, values: Mapping[int, ReadingValues]) -> int:
        self.sent.append(values)
        return capture_ns

    def command(self, wanted: Wanted, from_timestep: int = 0) -> None:
        pass


class Echo:
    """A virtual world in which every robot senses what it reported."""

    def __init__(self) -> None:
        self.lived: list[tuple[int, Mapping[int, bytes]]] = []
        self.commands: dict[int, Any] = {}
        self.shown: dict[int, ShownData] = {}

    def step(
        self,
        state: ArenaState,
        run_timestep: int,
        reports: Mapping[int, bytes],
        senders: Mapping[int, bytes],
        heard_ns: Mapping[int, int],
    ) -> dict[int, Any]:
        self.lived.append((run_timestep, dict(senders)))
        return {tag: [(said, state.capture_ns)] for tag, said in reports.items()}


def test_reports_act_in_the_timestep_in_which_they_arrive() -> None:
    source, robots, world = Source(), Robots(), Echo()
    runtime = Runtime(source, world, robots, lambda: 0)  # type: ignore[arg-type]
    runtime.open()
    expected: list[dict[int, Any]] = []
    for timestep in range(6):
        if timestep == 1:
            assert runtime.start() == START_LEAD
        robots.said = {7: ActuatorReport(b"me", bytes([timestep]))} if timestep != 4 else {}
        expected.append({7: [(bytes([timestep]), timestep)]} if timestep != 4 else {})
        source.due.release()
        runtime.step()
        assert runtime.readings == expected[-1]
    source.due.release()
    runtime.close()
    assert robots.sent == expected
    assert [run_timestep for run_timestep, _ in world.lived] == [-1, -1, -1, 0, 1, 2]
    assert world.lived[3][1] == {7: b"me"} and world.lived[4][1] == {}
