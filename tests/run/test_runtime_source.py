"""The runtime on another tracker's arena states, in place of cameras of our own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

from tests.robots.link.arena_rig import ONE_SHOT, PATIENCE_S, START, STOP, OldTracker
from vsense.config.experiment import load
from vsense.robots.link.status import ActuatorReport
from vsense.robots.link.trackers.client import ArenaClient
from vsense.robots.link.wire import ReadingValues, ShownData, Wanted
from vsense.run.environment import Environment
from vsense.run.runtime import Runtime


class Robots:
    """Stands in for the virtual sensor server."""

    def __init__(self) -> None:
        self.published: list[tuple[int, int]] = []
        self.commands: list[Wanted] = []

    def publish(self, timestep: int, capture_ns: int, readings: Mapping[int, ReadingValues]) -> int:
        self.published.append((timestep, capture_ns))
        return capture_ns

    def show(self, shown: Mapping[int, ShownData]) -> None:
        """There is nobody to show it to."""

    def reports(self) -> Mapping[int, ActuatorReport]:
        return {}

    def command(self, wanted: Wanted, from_timestep: int = 0) -> None:
        self.commands.append(wanted)


def test_another_trackers_states_drive_a_run_from_start_to_stop() -> None:
    experiment = load("pollutant")
    robot, source = experiment.robots[0], experiment.objects[0]
    tags = [robot.tag, source.tag]
    places = f"{robot.tag} 0 0 0 0.5 0.25 90 {source.tag} 0 0 0 0 0 0"
    tracker, robots = OldTracker(), Robots()
    client = ArenaClient("127.0.0.1", tracker.port, tags, lambda line: None)
    environment = Environment(experiment, seed=1)
    runtime = Runtime(client, environment, robots)  # type: ignore[arg-type]
    runtime.open()
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(runtime.step, PATIENCE_S)
        tracker.accept()
        assert tracker.command() == ONE_SHOT
        tracker.send(f"0 {places}")
        before = coming.result()
        assert before.run_timestep == -1 and before.frames == ()
        first = runtime.start()
        while tracker.command() != START:
            tracker.send("0")
        steps = []
        for theirs in range(1, 6):
            coming = pool.submit(runtime.step, PATIENCE_S)
            tracker.send(f"{theirs} {places}")
            steps.append(coming.result())
        runtime.stop()
        assert tracker.command() == STOP
    assert steps[-1].run_timestep == steps[-1].timestep - first >= 0
    pose = steps[-1].state.robots[steps[-1].state.robots["tag"] == robot.tag][0]
    assert (pose["x_m"], pose["y_m"], bool(pose["seen"])) == (0.5, 0.25, True)
    assert math.isclose(pose["yaw_rad"], math.pi / 2)
    assert robots.commands == [Wanted.RUN, Wanted.STOP]
    assert [timestep for timestep, _ in robots.published] == [
        step.timestep for step in (before, *steps)
    ]
    assert runtime.readings.keys() == {robot.tag for robot in experiment.robots}
    client.close()
    runtime.close()
    tracker.close()
