"""ARGoS's devices, mounted as its files ask for them, against what its own build read: without
noise to 1e-6, with noise by their distributions (tests/data/argos-noise)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.rigs.places import DATA
from tests.world.sensors.scenes import rows, world_of
from vsense.base.arena import POSE, ArenaState
from vsense.config.experiment import read
from vsense.config.placement import settle
from vsense.config.specs import Experiment, Stage
from vsense.run.environment import Environment
from vsense.world.entities import Cylinder, Led
from vsense.world.sensors.omnidirectional_camera import OmnidirectionalCamera

MEASURED = json.loads((DATA / "argos-noise/quantiles.json").read_text())
LEVELS = np.array(MEASURED["levels"])
STEPS = 1200
SAMPLES = 6000
"""Timesteps of ours and of ARGoS's."""
LIMIT = 1.95 * np.sqrt((STEPS + SAMPLES) / (STEPS * SAMPLES))
"""Of Kolmogorov's and Smirnov's D: one comparison in a thousand is above by chance."""

SCENE = """<argos-configuration>
  <framework><experiment length="600" ticks_per_second="10" random_seed="1" /></framework>
  <controllers>
    <logger id="log" library="build/liblogger.so">
      <actuators><epuck_wheels implementation="default" /></actuators>
      <sensors>
        <epuck_proximity implementation="default" show_rays="false" NOISE_LEVEL />
        <epuck_light implementation="default" show_rays="false" NOISE_LEVEL />
        <epuck_ground implementation="rot_z_only" NOISE_LEVEL />
        <epuck_range_and_bearing implementation="medium" medium="rab" data_size="4" RAB />
        <epuck_omnidirectional_camera implementation="rot_z_only" medium="leds" CAMERA />
      </sensors>
    </logger>
    <logger id="send" library="build/liblogger.so">
      <actuators>
        <epuck_rgb_leds implementation="default" medium="leds" />
        <epuck_range_and_bearing implementation="medium" medium="rab" data_size="4" range="0.7" />
      </actuators>
      <sensors>
        <epuck_range_and_bearing implementation="medium" medium="rab" data_size="4" />
      </sensors>
    </logger>
  </controllers>
  <arena size="2,2,1" center="0,0,0.5">
    <floor id="floor" source="image" path="floor.png" />
    <light id="light" position="0.9,-0.1,0.3" orientation="0,0,0" color="yellow" intensity="1"
      medium="leds" />
    <box id="wall" size="0.02,0.08,0.1" movable="false">
      <body position="0.49,0.4,0" orientation="0,0,0" />
    </box>
    <e-puck id="r0" omnidirectional_camera_aperture="75">
      <body position="0.43,0.4,0" orientation="20,0,0" /><controller config="log" /></e-puck>
    <e-puck id="a1"><body position="0.23,0.5,0" orientation="0,0,0" /><controller config="send" />
    </e-puck>
    <e-puck id="b2"><body position="0.35,0.1,0" orientation="90,0,0" /><controller config="send" />
    </e-puck>
    <e-puck id="c3"><body position="0.43,0.49,0" orientation="0,0,0" /><controller config="send" />
    </e-puck>
  </arena>
  <physics_engines><dynamics2d id="dyn2d" /></physics_engines>
  <media><led id="leds" /><range_and_bearing id="rab" /></media>
</argos-configuration>
"""
NOISE = {
    "quiet": ("", "", ""),
    "noise05": ('noise_level="0.05"', 'noise_std_dev="0.01"', 'noise_std_dev="0.01"'),
    "noise30": ('noise_level="0.3"', 'noise_std_dev="0.05"', 'noise_std_dev="0.05"'),
    "realrange": ('noise_level="0.1"', 'real_range_noise="true" max_packets="2"', ""),
    "loss85": ("", 'loss_probability="0.85"', ""),
}

Numbers = NDArray[np.float64]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("noise")
    ramp = np.floor(np.linspace(0.0, 255.0, 200)).astype(np.uint8)
    cv2.imwrite(str(place / "floor.png"), np.tile(ramp, (200, 1)))
    return place


def loaded(folder: Path, name: str) -> Experiment:
    text = SCENE
    for word, noise in zip(("NOISE_LEVEL", "RAB", "CAMERA"), NOISE[name]):
        text = text.replace(word, noise)
    experiment = read(text.encode(), "x.argos", folder / "x.argos", stage=Stage.SIM)
    return settle(experiment, 1)


@cache
def readings(folder: Path, name: str, steps: int) -> Mapping[str, Numbers]:
    """What the first robot reads in each timestep, by the sensor's name."""
    experiment = loaded(folder, name)
    environment = Environment(experiment, 1)
    poses = np.zeros(len(experiment.robots), dtype=POSE)
    for row, robot in zip(poses, experiment.robots):
        row["tag"], row["seen"] = robot.tag, True
        row["x_m"], row["y_m"], row["yaw_rad"] = robot.pose or (0.0, 0.0, 0.0)
    found: list[list[Any]] = []
    for timestep in range(steps):
        poses["capture_ns"] = capture_ns = (timestep + 10) * 100_000_000
        reports = {
            robot.tag: bytes((255, 0, 0) * 3 + (4, int(robot.id[1]), timestep % 256, 7, 4))
            if robot.controller == "send"
            else b""
            for robot in experiment.robots
        }
        state = ArenaState(timestep, capture_ns, np.sort(poses, order="tag"), len(poses))
        values = environment.step(state, timestep, reports)[experiment.robots[0].tag]
        found.append([np.frombuffer(value, dtype="<f4") for value, _ in values])
    names = [mounted.sensor.name for mounted in experiment.controllers[0].sensors]
    return {
        sensor: np.array([row[i] for row in found], dtype=np.float64)
        for i, sensor in enumerate(names)
    }


def places(reading: Numbers, width: int) -> Numbers:
    """The places in use of readings that begin with their count, one below the other."""
    rows = [row[1 : 1 + round(row[0]) * width].reshape(-1, width) for row in np.atleast_2d(reading)]
    return np.concatenate(rows)


def distance(ours: Numbers, quantiles: Sequence[float]) -> float:
    """D of our sample and the quantiles of another; a step of ours may be at any of its heights."""
    ordered = np.sort(ours)
    below, upto = (np.searchsorted(ordered, quantiles, side) for side in ("left", "right"))
    low, high = below / len(ordered), upto / len(ordered)
    return float(np.maximum(np.maximum(LEVELS - high, low - LEVELS), 0.0)[1:-1].max())


def test_without_noise_every_device_reads_what_argos_reads(folder: Path) -> None:
    read_, quiet = readings(folder, "quiet", 3), MEASURED["quiet"]
    # The robot counts its ring the other way round than ARGoS, and in raw numbers.
    for ring in ("proximity", "light"):
        np.testing.assert_allclose(read_[ring][-1][::-1] / 4096.0, quiet[ring], atol=1e-6)
    np.testing.assert_allclose(read_["ground"][-1], quiet["ground"], atol=1e-6)
    heard = places(read_["range_and_bearing"][-1], 6)
    heard = heard[np.argsort(heard[:, 2])]
    np.testing.assert_allclose(heard[:, [2, 0, 1]], quiet["range_and_bearing"], atol=1e-5)
    assert (heard[:, 5] == 4.0).all()
    blobs = places(read_["omnidirectional_camera"][-1], 5)
    np.testing.assert_allclose(blobs[:, :2], quiet["omnidirectional_camera"], atol=1e-5)
    assert (blobs[:, 2:] == (255.0, 0.0, 0.0)).all()


@pytest.mark.parametrize("name", sorted(MEASURED["runs"]))
def test_noisy_readings_are_distributed_as_those_of_argos(folder: Path, name: str) -> None:
    read_, run = readings(folder, name, STEPS), MEASURED["runs"][name]
    samples: dict[str, list[Numbers]] = {
        "proximity": list(read_["proximity"].T[::-1] / 4096.0),
        "light": list(read_["light"].T[::-1] / 4096.0),
        "ground": list(read_["ground"].T),
    }
    heard = places(read_["range_and_bearing"], 6)
    by_sender = [heard[heard[:, 2] == sender] for sender in (1.0, 2.0, 3.0)]
    samples["range_cm"] = [rows[:, 0] for rows in by_sender]
    samples["bearing_rad"] = [rows[:, 1] for rows in by_sender]
    samples["blobs"] = list(places(read_["omnidirectional_camera"], 5)[:, :2].T)
    for device, columns in run.items():
        for number, quantiles in enumerate(columns):
            ours = samples[device][number]
            # Of two messages for three senders a sender has fewer, of many blobs there are more.
            limit = LIMIT * max(np.sqrt(STEPS / len(ours)), 1.0)
            assert distance(ours, quantiles) < limit, (device, number)


def test_messages_are_lost_as_often_as_in_argos(folder: Path) -> None:
    heard = readings(folder, "loss85", STEPS // 2)["range_and_bearing"][:, 0]
    deviation = np.sqrt(3 * 0.15 * 0.85 / len(heard))
    assert abs(heard.mean() - MEASURED["loss85_packets_per_step"]) < 4.0 * deviation


def test_a_cameras_noise_goes_all_ways_alike() -> None:
    """Its direction is uniform, its length normal. Source: epuck_omnidirectional_camera."""
    camera = OmnidirectionalCamera(0.5, False, 0.05, 1)
    places = {tag: (2.0 * tag, 0.0, 0.0) for tag in range(500)}
    lamps = [
        Cylinder(
            f"lamp{tag}",
            (x_m + 0.2, 0.0, 0.0),
            0.01,
            0.01,
            leds=(Led((0.0, 0.0, 0.1), (255, 0, 0)),),
        )
        for tag, (x_m, *_) in places.items()
    ]
    world = world_of(places, lamps)
    seen = np.concatenate([rows(camera, world) for _ in range(40)])
    assert (seen[:, 0] == 1.0).all()
    away_m = 0.01 * seen[:, 1:2] * np.stack((np.cos(seen[:, 2]), np.sin(seen[:, 2])), axis=1)
    away_m[:, 0] -= 0.2
    assert away_m.std(axis=0) == pytest.approx([0.05 / np.sqrt(2.0)] * 2, rel=0.03)
    assert abs(np.corrcoef(away_m.T)[0, 1]) < 0.03 and (abs(away_m.mean(axis=0)) < 1e-3).all()
