"""A simulated run: the same bits for a seed, bodies that respect each other, the lab's timing."""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.rigs.places import ROOT
from vsense.base.errors import ConfigError
from vsense.config.description import describe
from vsense.config.experiment import SHIPPED_FOLDER, first_robots, load
from vsense.config.specs import Experiment, Stage
from vsense.modes.origin import files_of
from vsense.modes.sim._simulation import Simulation
from vsense.modes.sim.outcome import libraries_of
from vsense.robots.inprocess import ACT_NS
from vsense.world.entities import Box, Cylinder
from vsense.world.physics.motion import obstacles
from vsense.world.robot_models import EPUCK, MODELS_FOLDER

SHORT_S = 12.0


@pytest.fixture(scope="module")
def experiment() -> Experiment:
    return load("pollutant", SHORT_S)


def lived(experiment: Experiment, library: Path, seed: int = 1, blind: bool = False) -> Simulation:
    run = Simulation(experiment, {experiment.controllers[0].id: library}, seed, blind)
    run.run()
    return run


def digest(run: Simulation) -> str:
    record = run.record
    return hashlib.sha256(record.poses.tobytes() + record.leds.tobytes()).hexdigest()


def test_a_seed_gives_the_same_bits_and_another_seed_others(experiment, pollutant) -> None:
    first, again, other = (lived(experiment, pollutant, seed) for seed in (1, 1, 2))
    assert digest(first) == digest(again)
    assert digest(first) != digest(other)


def test_nobody_is_inside_anybody_or_anything(experiment, pollutant) -> None:
    record = lived(experiment, pollutant).record
    places = record.poses[:, :, :2]
    apart = np.hypot(*(places[:, :, None] - places[:, None]).transpose(3, 0, 1, 2))
    apart[:, np.arange(places.shape[1]), np.arange(places.shape[1])] = 1.0
    assert apart.min() > 2 * EPUCK.radius_m - 2e-4
    assert np.abs(places[..., 0]).max() < 1.48 - EPUCK.radius_m + 2e-4
    assert np.abs(places[..., 1]).max() < 1.18 - EPUCK.radius_m + 2e-4
    moved = np.ptp(places[:, : len(record.tags)], axis=0).max(axis=1)
    assert (moved > 0.05).all(), "everybody drives about"
    np.testing.assert_array_equal(places[0, -1], places[-1, -1])


def test_blind_robots_never_find_the_cone(experiment, pollutant) -> None:
    seeing, blind = (lived(experiment, pollutant, 1, held) for held in (False, True))
    assert seeing.record.leds.any()
    assert not blind.record.leds.any()
    swarm = blind.record.swarm()
    assert swarm["lit_before_turn"] == swarm["lit_after_turn"] == 0


def test_figures_count_the_robots_that_truly_are_in_the_cone(experiment, pollutant) -> None:
    record = lived(experiment, pollutant).record
    source, swarm = experiment.sources[0], record.swarm()
    for row, key in ((59, "before"), (119, "after")):
        cone = source.cone_at(0.0, 0.0, row)
        inside = cone.contains(record.poses[row, : len(record.tags), :2])
        assert swarm[f"in_cone_{key}_turn"] == inside.sum()
        assert swarm[f"lit_{key}_turn"] == (inside & (record.leds[row] != 0)).sum()


def test_wheels_obey_31_ms_after_the_capture(experiment, probe) -> None:
    """Everybody drives straight on from the first timestep, 2000 steps/s cut to 1000."""
    alone = replace(first_robots(experiment, 1), sources=())
    straight = replace(alone.controllers[0], params={"speed": "3000"}, sensors=())
    record = lived(replace(alone, controllers=(straight,), length_s=0.3), probe).record
    way_m = np.hypot(*np.diff(record.poses[:, 0, :2], axis=0).T)
    full_m_s = 1000 * EPUCK.step_m
    np.testing.assert_allclose(way_m[0], full_m_s * (0.1 - ACT_NS * 1e-9), rtol=1e-9)
    np.testing.assert_allclose(way_m[1], full_m_s * 0.1, rtol=1e-9)


@pytest.mark.parametrize("ticks", [6, 30, 100])
def test_every_length_of_a_timestep_works(experiment, pollutant, ticks: int) -> None:
    """At 100 timesteps a second four of them are under way at a time."""
    record = lived(replace(experiment, ticks_per_second=ticks, length_s=6.0), pollutant).record
    assert len(record.poses) == 6 * ticks
    moved = np.ptp(record.poses[:, : len(record.tags), :2], axis=0).max(axis=1)
    assert (moved > 0.05).all()


def test_only_what_is_physical_stands_in_the_way(experiment, pollutant) -> None:
    things = (
        Box("crate", (0.6, 0.3, 0.0), (0.3, 0.2, 0.1), 0.4, True),
        Cylinder("post", (-0.6, -0.4, 0.0), 0.15, 0.2, True),
        Box("ghost", (0.6, -0.5, 0.0), (0.4, 0.4, 0.1), 0.0, False),
        Box("bridge", (0.0, 0.0, 0.1), (3.0, 0.2, 0.1), 0.0, True),
    )
    furnished = replace(experiment, entities=(*experiment.entities, *things), length_s=20.0)
    boxes, cylinders = obstacles(furnished.boxes, furnished.cylinders)
    assert len(boxes) == len(experiment.boxes) + 1 and len(cylinders) == 1
    record = lived(furnished, pollutant).record
    places = record.poses[:, : len(record.tags), :2]
    from_post = np.hypot(*(places - (-0.6, -0.4)).transpose(2, 0, 1))
    assert from_post.min() > 0.15 + EPUCK.radius_m - 2e-4
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    local = np.abs((places - (0.6, 0.3)) @ turn)
    beyond = np.maximum(local - (0.15, 0.1), 0.0)
    assert np.hypot(beyond[..., 0], beyond[..., 1]).min() > EPUCK.radius_m - 2e-4
    on_ghost = (np.abs(places - (0.6, -0.5)) < 0.2).all(axis=2)
    assert on_ghost.any()


def test_trajectories_are_what_was_recorded(experiment, pollutant, tmp_path: Path) -> None:
    record = lived(experiment, pollutant).record
    record.save(tmp_path / "it.npz")
    with np.load(tmp_path / "it.npz") as saved:
        np.testing.assert_array_equal(saved["poses"], record.poses[:, :15])
        np.testing.assert_array_equal(saved["object_poses"], record.poses[:, 15:])
        np.testing.assert_array_equal(saved["leds"], record.leds)
        assert saved["tags"].tolist() == [robot.tag for robot in experiment.robots]
        assert saved["time_s"][-1] == pytest.approx(SHORT_S - 0.1)


@pytest.mark.parametrize(
    "name", ["modes/sim/_simulation", "robots/inprocess", "modes/sim/_record", "run/environment"]
)
def test_what_decides_a_run_reads_no_clock(name: str) -> None:
    source = (ROOT / "vsense" / f"{name}.py").read_text()
    clocks = r"time|datetime|random|vsense\.base\.clock|vsense\.base import .*clock"
    assert not re.search(rf"^\s*(import|from) ({clocks})\b", source, re.M)


def test_no_robot_is_faster_than_the_file_allows(pollutant, tmp_path: Path) -> None:
    fence = '<vs:geofence v_max="0.05" /></arena>'
    path = tmp_path / "slow.argos"
    path.write_text((SHIPPED_FOLDER / "pollutant.argos").read_text().replace("</arena>", fence))
    speeds_m_s = []
    for name in ("pollutant", str(path)):
        run = lived(load(name, SHORT_S, stage=Stage.SIM), pollutant)
        own = run.record.poses[:, : len(run.record.tags), :2]
        speeds_m_s.append(np.linalg.norm(np.diff(own, axis=0), axis=-1).max() / 0.1)
    assert speeds_m_s[0] > 0.07
    # The e-puck's motors take the next lower step; bodies that are pushed move by 0.1 mm more.
    assert 0.04 < speeds_m_s[1] <= 0.05 + 1e-3


def test_robots_of_several_models_share_an_arena(tmp_path: Path) -> None:
    text = (SHIPPED_FOLDER / "predator_prey.argos").read_text()
    path, own = tmp_path / "mixed.argos", tmp_path / "big.toml"
    loops = (SHIPPED_FOLDER / "predator_prey.py").read_text()
    (tmp_path / "predator_prey.py").write_text(loops)
    path.write_text(text.replace('<e-puck id="predator"', '<e-puck vs:model="big" id="predator"'))
    with pytest.raises(ConfigError, match="there is no robot model 'big'"):
        load(str(path))
    thymio = (MODELS_FOLDER / "thymio2.toml").read_text()
    own.write_text(thymio.replace("radius_m = 0.08", "radius_m = 0.2"))
    mixed = load(str(path), 60.0, stage=Stage.SIM)
    models = [robot.model for robot in mixed.robots]
    assert {model.name for model in models} == {"big", "epuck"}
    predators = sum(model.name == "big" for model in models)
    said = f"big: {predators} robots, radius 0.2 m, marker at 0.06 m, 0.166 m/s at most"
    assert said in describe(mixed) and "marker at" not in describe(load("predator_prey"))
    kept = files_of(mixed)
    assert own in kept and MODELS_FOLDER / "epuck.toml" not in kept, "it is made again from them"
    run = Simulation(mixed, libraries_of(mixed), 1)
    run.run()
    places = run.record.poses[:, : len(models), :2]
    radii = np.array([model.radius_m for model in models])
    apart = np.hypot(*(places[:, :, None] - places[:, None]).transpose(3, 0, 1, 2))
    apart[:, np.arange(len(models)), np.arange(len(models))] = 1.0
    assert (apart > radii + radii[:, None] - 3e-4).all()
    assert (apart < radii + radii[:, None] + 1e-3).any(), "some touch"
    half = np.array(mixed.arena.size_m[:2]) / 2
    assert (np.abs(places) < half - radii[:, None] + 1e-3).all()
    world = run.environment.world
    rows = world.bodies().rows[: len(models)]
    np.testing.assert_array_equal(rows["radius_m"], radii)
