"""The world's benchmark: what it measures is what it says, and its report. No time is asserted."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.bench import main, world
from tests.conftest import require_tool
from tests.rigs.lines import in_sight
from vsense.world.robot_models import EPUCK


def test_a_step_senses_all_lights_anew() -> None:
    swarm = world.SensingSwarm(30)
    first, second = swarm.step(), swarm.step()
    assert set(first) == set(range(30))
    for sent in (first, second):
        assert all(len(value) == 4 * world.SENSORS for ((value, _),) in sent.values())
    assert first != second, "robots drive"
    readings = np.array([np.frombuffer(value, "<f4") for ((value, _),) in second.values()])
    assert readings == pytest.approx(by_hand(swarm), rel=1e-5)


def by_hand(swarm: world.SensingSwarm) -> np.ndarray:  # type: ignore[type-arg]
    """clip01(sum (I/d)^2) over the lights whose rays meet no body, ray by ray."""
    robots, lights = swarm.world.robots, swarm.world.lights()
    expected = np.zeros((len(robots), world.SENSORS))
    for n, robot in enumerate(robots):
        for k in range(world.SENSORS):
            angle = robot["yaw_rad"] + 2 * np.pi * k / world.SENSORS
            place = [robot["x_m"], robot["y_m"]] + EPUCK.infrared.radius_m * np.array(
                [np.cos(angle), np.sin(angle)]
            )
            start = np.array([*place, EPUCK.infrared.height_m])
            for light in lights:
                way = np.array(light.position_m) - start
                if not meets(start, way, robots):
                    expected[n, k] += light.intensity**2 / (way @ way)
    return np.minimum(expected, 1.0)


def meets(start: np.ndarray, way: np.ndarray, robots: np.ndarray) -> bool:  # type: ignore[type-arg]
    """Whether a ray passes through a body: its nearest point below 76 mm, seen from above."""
    below = min(1.0, (0.076 - start[2]) / way[2])
    offset = np.stack((robots["x_m"], robots["y_m"]), axis=1) - start[:2]
    share = np.clip(offset @ way[:2] / (way[:2] @ way[:2]), 0.0, below)
    gaps = np.linalg.norm(offset - share[:, None] * way[:2], axis=1)
    return bool((gaps <= 0.035).any())


def test_robots_stand_in_each_others_light_and_not_in_each_other() -> None:
    swarm = world.SensingSwarm(200)
    swarm.step()
    robots = swarm.world.robots
    places = np.stack((robots["x_m"], robots["y_m"]), axis=1)
    gaps = np.linalg.norm(places[:, None] - places, axis=2)[np.triu_indices(200, 1)]
    assert gaps.min() > 0.07
    starts = np.column_stack((places, np.full(200, 0.032)))
    goals = [light.position_m for light in swarm.world.lights()]
    assert len(goals) == world.LIGHTS
    seen = in_sight(starts, goals, swarm.world.bodies(), np.arange(200))
    assert 0.2 < 1.0 - seen.mean() < 0.8


def test_the_report_is_as_promised(capsys: pytest.CaptureFixture[str]) -> None:
    require_tool("cc", "build-essential")
    assert main.main(["world", "--json", "--rounds", "1"]) == 0
    captured = capsys.readouterr()
    report = json.loads(captured.out)
    assert set(report) == {"rows", "floor_ms", "sim_speedup"}
    assert [row["robots"] for row in report["rows"]] == [15, 100, 1000]
    for row in report["rows"]:
        assert set(row) == {"robots", "ms_per_step", "us_per_robot"}
        assert row["us_per_robot"] == pytest.approx(1e3 * row["ms_per_step"] / row["robots"])
    assert report["floor_ms"] > 0.0 and report["sim_speedup"] > 0.0
    assert "round 1 of 1" in captured.err
    assert "1000" in world.table(report)
