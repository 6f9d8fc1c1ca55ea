"""The simulator's benchmark: its world and its report are as promised. No time is asserted."""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from tests.bench import beside_argos, main, sim
from tests.conftest import require_tool
from vsense.config.experiment import load
from vsense.config.placement import settle
from vsense.modes.sim._simulation import Simulation
from vsense.run.programs import shared_objects
from vsense.world.entities import Light


@pytest.mark.parametrize("robots", [15, 100])
def test_the_world_is_that_of_the_comparison(robots: int, tmp_path: Path) -> None:
    path = tmp_path / "world.argos"
    path.write_text(sim.experiment_text(robots))
    experiment = settle(load(str(path)), 1)
    side_m = math.sqrt(robots * 0.48)
    assert len(experiment.robots) == robots
    assert experiment.timestep_s == sim.TIMESTEP_S == 0.1
    assert len(experiment.boxes) == 4
    lights = [entity for entity in experiment.entities if isinstance(entity, Light)]
    assert len(lights) == 4
    for light in lights:
        x_m, y_m, z_m = light.position_m
        assert (abs(x_m), abs(y_m), z_m) == pytest.approx((side_m / 4, side_m / 4, 0.4))
        assert 2.5 * light.intensity == pytest.approx(side_m), "where the formula ends"
    ((sensor),) = experiment.controllers[0].sensors
    assert (sensor.sensor.name, sensor.sensor.layout) == ("light", "8*f4")


def test_robots_drive_and_turn_to_the_light(tmp_path: Path) -> None:
    require_tool("cc", "build-essential")
    path = tmp_path / "world.argos"
    path.write_text(sim.experiment_text(15))
    experiment = load(str(path), 20.0)
    run = Simulation(experiment, shared_objects(experiment), 1)
    run.run()
    moved = np.ptp(run.record.poses[..., :2], axis=0).max(axis=1)
    assert (moved > 0.1).all()
    assert run.complaints() == []


def test_the_report_is_as_promised(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    require_tool("cc", "build-essential")
    monkeypatch.setattr(sim, "STEPS_OF_ALL", 600)
    monkeypatch.setattr(sim, "MIN_STEPS", 10)
    assert main.main(["sim", "--json", "--rounds", "1"]) == 0
    captured = capsys.readouterr()
    report = json.loads(captured.out)
    assert set(report) == {"rows", "devices", "startup_s"}
    assert set(report["devices"]) == {*sim.DEVICES, sim.ALL_DEVICES}
    assert min(report["devices"].values()) > 0.0
    assert [row["robots"] for row in report["rows"]] == [15, 100, 1000]
    assert [row["timesteps"] for row in report["rows"]] == [40, 10, 10]
    for row in report["rows"]:
        assert set(row) == {"robots", "timesteps", "robot_steps_per_s", "us_per_timestep"}
        assert row["robot_steps_per_s"] > 0.0
        parts = {"physics", "world", "bodies", "sensors", "rings", "controllers", "rest"}
        assert set(row["us_per_timestep"]) == parts
        assert min(row["us_per_timestep"].values()) >= 0.0
    assert report["startup_s"] > 0.0
    assert "round 1 of 1" in captured.err
    assert "1000" in sim.table(report) and "camera and LEDs" in sim.table(report)


def test_devices_are_read_and_set_without_python(tmp_path: Path) -> None:
    require_tool("cc", "build-essential")
    experiment = sim._with_devices(sim.ALL_DEVICES, tmp_path).experiment
    run = Simulation(experiment, shared_objects(experiment), 1)
    for timestep in range(-3, 40):
        run.go_on(timestep, 1)
    assert run.chain is not None and run.chain.cdata.stops == 0
    assert (run.environment.world.messages["length"] == 1).all()
    assert run.environment.world.led_colors[:, 8:].all()
    assert run.complaints() == []


def test_argos_is_given_the_same_world_without_what_it_does_not_know() -> None:
    ours = ET.fromstring(sim.experiment_text(100))
    text = beside_argos.for_argos(sim.experiment_text(100), "/tmp/libwander.so", 42.5)
    theirs = ET.fromstring(text)
    assert "vs:" not in text and "vsense" not in text and "virtual" not in text
    assert theirs.find("framework/experiment").attrib["length"] == "42.5"  # type: ignore[union-attr]
    sensors = theirs.find("controllers/wander_controller/sensors")
    assert sensors is not None
    assert [one.tag for one in sensors] == ["epuck_proximity", "epuck_light"]
    for tag in ("arena", "arena/box", "arena/light", "arena/box/body", "arena/distribute/position"):
        found = [[one.attrib for one in tree.findall(tag)] for tree in (ours, theirs)]
        assert found[0] == found[1] and found[0]
    entity = theirs.find("arena/distribute/entity")
    assert entity is not None and entity.attrib == {"quantity": "100", "max_trials": "1000"}


def test_the_ratio_is_that_of_medians() -> None:
    ours = {"port": [90.0, 30.0, 60.0], "file": [20.0, 20.0, 20.0]}
    (row,) = beside_argos.rows_of({15: {"argos": [10.0, 20.0, 40.0], **ours}})
    assert (row["port_ratio"], row["file_ratio"]) == (3.0, 1.0)
    assert row["port_ratios"] == [1.5, 1.5, 9.0]
