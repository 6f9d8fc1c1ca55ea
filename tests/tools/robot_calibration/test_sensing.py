"""Robots measure their sensors at real walls and on a real floor, seen and told with a delay."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tests.tools.robot_calibration.arena import Arena
from vsense.base.errors import UsageError
from vsense.config import roster
from vsense.config.specs import Experiment, FloorSpec
from vsense.run.homing.floor import DrivingFloor
from vsense.tools.robot_calibration._commanding import OwnReadings
from vsense.tools.robot_calibration._places import (
    GroundPlaces,
    WallSpot,
    ground_places,
    spots,
    stage_m,
)
from vsense.tools.robot_calibration._results import RobotResult, table, worst
from vsense.tools.robot_calibration._routine import Moment
from vsense.tools.robot_calibration._sensing import Sensing
from vsense.world.robot_models import EPUCK, model_of

WHITE, BLACK = (0.3, 0.3), (0.0, 0.3)


def everything(experiment: Experiment) -> Sensing:
    before = {EPUCK: spots(experiment, EPUCK)}
    return Sensing(DrivingFloor.of(experiment), before, GroundPlaces(WHITE, BLACK))


def before_walls(experiment: Experiment) -> Sensing:
    return Sensing(DrivingFloor.of(experiment), {EPUCK: spots(experiment, EPUCK)})


def test_sensors_are_known_though_walls_stand_elsewhere_than_was_said(tmp_path: Path) -> None:
    places = [(0.0, 0.85), (0.3, 0.8)]
    arena = Arena(places, everything, wall_off_m=0.002)
    swarm = arena.run(6000)
    assert not swarm.failed
    for tag, built, home in zip(arena.tags, arena.built, places):
        arena.check(tag)
        found, troubles = swarm.sensors_of(tag, "")
        assert not troubles and built.sensors is not None
        for name, low_raw, width in (("proximity", 4.0, 0.03), ("ground", 4.0, 0.01)):
            spans, true = found[name].spans, built.sensors.spans(built.model)[f"{name}_scale"]
            assert np.abs(spans[:, 0] - true[:, 0]).max() < low_raw
            assert np.diff(spans) == pytest.approx(np.diff(true), rel=width)
        assert found["proximity"].error_m == pytest.approx(0.002, abs=0.0005)
        place = swarm.routines[tag]._place
        assert math.dist(place, home) < 0.06
    results = [
        RobotResult(tag, f"r{tag}", swarm.fits[tag], "", built, None, *swarm.sensors_of(tag, ""))
        for tag, built in zip(arena.tags, arena.built)
    ]
    errors = worst(results)
    assert errors["proximity_low"] < 4.0 and errors["ground_width"] < 0.01
    lines = table(results).splitlines()
    assert sum("  truth" in line for line in lines) == 6 and "proximity" in table(results)
    held = tmp_path / "robots.toml"
    held.write_text("".join(f"[[robot]]\ntag = {tag}\n" for tag in arena.tags))
    roster.update(held, {one.tag: one.for_roster("2026-11-24") for one in results})
    for one in results:
        before = roster.read(held).get(one.tag)
        assert before is not None and before.calibration.proximity_scale is not None
        again = replace(one, before=before)
        assert {"proximity_scale", "ground_scale"} < again.changes.keys()
        assert again.changes == pytest.approx(dict.fromkeys(again.changes, 1.0), abs=0.004)
        assert again.as_json()["sensors"]["proximity"]["truth"] is not None
    # Bodies are 3.7 cm wide at most.
    assert arena.nearest_wall_m > 0.037 - 0.002
    assert arena.nearest_m > 0.08


# A robot of its own: a body of 12 cm, five sensors that see 12 cm far, two ground sensors.
ROVER = """[body]
radius_m = 0.06
height_m = 0.08
marker_height_m = 0.09
mass_kg = 0.5
[wheels]
axle_m = 0.1
diameter_m = 0.041
steps_per_turn = 1000
max_steps_s = 1500
[ring]
places_m = [[0.05, -0.03], [0.055, 0.0], [0.05, 0.03], [0.0, 0.055], [-0.05, 0.0]]
headings_deg = [-30.0, 0.0, 30.0, 90.0, 180.0]
half_cone_deg = 15.0
table_m = [0.0, 0.03, 0.05, 0.08, 0.12]
table_raw = [4095.0, 3000.0, 1500.0, 500.0, 80.0]
noise_raw = 5.0
[ground]
places_m = [[0.05, 0.01], [0.05, -0.01]]
"""


def test_robots_of_other_models_are_measured_by_what_their_files_say(tmp_path: Path) -> None:
    """Wheels and markers of all; sensors as many as there are, and those missing by name."""
    (tmp_path / "rover.toml").write_text(ROVER)
    rover = model_of("rover", tmp_path)
    models = [rover, model_of("footbot"), model_of("thymio2"), EPUCK]
    measured = (rover, EPUCK)

    def all_of(experiment: Experiment) -> Sensing:
        before = {model: spots(experiment, model) for model in measured}
        return Sensing(DrivingFloor.of(experiment), before, GroundPlaces(WHITE, BLACK))

    places = [(0.0, 0.8), (0.55, 0.0), (-0.55, 0.0), (0.0, -0.55)]
    arena = Arena(places, all_of, wall_off_m=0.002, models=models)
    swarm = arena.run(9000)
    assert not swarm.failed
    for tag, built in zip(arena.tags, arena.built):
        arena.check(tag)
        found, troubles = swarm.sensors_of(tag, "")
        assert built.sensors is not None
        true = built.sensors.spans(built.model)
        if built.model.name != "footbot":
            assert found["ground"].spans == pytest.approx(true["ground_scale"], abs=4.0)
        if built.model in measured:
            assert not troubles and len(found["proximity"].spans) == len(true["proximity_scale"])
            assert np.diff(found["proximity"].spans) == pytest.approx(
                np.diff(true["proximity_scale"]), rel=0.05
            )
    _, troubles = swarm.sensors_of(arena.tags[1], "")
    assert "model footbot has no proximity" in troubles["proximity"]
    assert "a footbot has 4 ground sensors" in troubles["ground"]
    assert "thymio2 does not tell" in swarm.sensors_of(arena.tags[2], "")[1]["proximity"]
    assert arena.nearest_wall_m > 0.037 - 0.002

    held = tmp_path / "robots.toml"
    held.write_text("".join(f"[[robot]]\ntag = {tag}\n" for tag in arena.tags))
    results = [
        RobotResult(tag, "", swarm.fits[tag], "", built, None, *swarm.sensors_of(tag, ""))
        for tag, built in zip(arena.tags, arena.built)
    ]
    lab = roster.update(held, {one.tag: one.for_roster("2026-11-28") for one in results})
    assert [robot.model for robot in lab.robots] == ["rover", "footbot", "thymio2", ""]
    # vsensed is told of an e-puck that is as far off: what a nominal rover reads comes out.
    told = lab.settings_of(lab.robots[0])
    assert float(told["axle-length"]) / 53.0 == pytest.approx(arena.built[0].axle_m / 0.1, rel=0.01)
    for text, (low, high) in zip(
        told["proximity-scale"].split(","), results[0].sensors["proximity"].spans
    ):
        nothing, wall = map(float, text.split(":"))
        gain = (1466.0 - 67.0) / (wall - nothing)
        scaled = [67.0 + gain * (raw - nothing) for raw in (low, high)]
        assert scaled == pytest.approx([80.0, 3000.0], rel=0.01, abs=3.0)


def one(change: Callable[[Arena, int, Moment], Moment]) -> tuple[Arena, int]:
    """A robot near a wall, of which something else is seen and heard than there is."""
    arena = Arena([(0.0, 1.05)], before_walls)
    (tag,) = arena.tags
    arena.change = lambda tag, timestep, moment: change(arena, timestep, moment)
    arena.run(3000)
    return arena, tag


def doing(arena: Arena) -> str:
    return arena.swarm.routines[arena.tags[0]].doing


def test_who_is_not_seen_before_a_wall_stands_at_once_and_is_named_after_a_second() -> None:
    unseen: list[tuple[int, int]] = []

    def hide(arena: Arena, timestep: int, moment: Moment) -> Moment:
        if doing(arena) != "before a wall":
            return moment
        unseen.append(moment.motors)
        return replace(moment, pose=None)

    arena, tag = one(hide)
    assert "was not seen for 1 s while it was before a wall" in arena.swarm.failed[tag]
    # What it was told before it was lost arrives two timesteps later; then nothing does.
    assert len(unseen) > 8 and not any(map(any, unseen[3:]))
    found, troubles = arena.swarm.sensors_of(tag, "")
    assert tag in arena.swarm.fits and not found and "not seen" in troubles["proximity"]


def test_another_robot_that_comes_near_stops_it_until_that_one_has_gone() -> None:
    told: dict[bool, list[tuple[int, int]]] = {True: [], False: []}

    def visit(arena: Arena, timestep: int, moment: Moment) -> Moment:
        floor, at_wall = arena.swarm.routines[arena.tags[0]]._floor, doing(arena) == "before a wall"
        near = at_wall and moment.pose is not None and len(told[True]) < 50
        floor.models[9999] = EPUCK
        if near:
            floor.places[9999] = (moment.pose[0] + 0.05, moment.pose[1] + 0.05)
        else:
            floor.places.pop(9999, None)
        told[near].append(moment.motors)
        return moment

    arena, tag = one(visit)
    assert tag not in arena.swarm.failed and "proximity" in arena.swarm.sensors_of(tag, "")[0]
    assert len(told[True]) == 50 and not any(map(any, told[True][3:]))


def test_one_that_is_held_before_a_wall_gives_up() -> None:
    held: list[tuple[float, float, float]] = []

    def hold(arena: Arena, timestep: int, moment: Moment) -> Moment:
        if doing(arena) != "before a wall" or moment.pose is None:
            return moment
        held.append(moment.pose)
        return replace(moment, pose=held[0])

    arena, tag = one(hold)
    assert "is it held" in arena.swarm.failed[tag]


def test_a_sensor_that_does_not_answer_is_named_and_wheels_are_kept() -> None:
    arena, tag = one(lambda arena, timestep, moment: replace(moment, readings={}))
    found, troubles = arena.swarm.sensors_of(tag, "")
    assert not found and "reports no proximity readings" in troubles["proximity"]
    assert tag in arena.swarm.fits and tag not in arena.swarm.failed


def test_spots_are_before_walls_and_away_from_corners() -> None:
    experiment = Arena([(0.0, 0.0)]).experiment
    found = spots(experiment, EPUCK, "wall_north")
    assert {spot.wall for spot in found} == {"wall_north"} and len(found) > 20
    spot: WallSpot = found[0]
    # The wall's middle is at y = 1.19 and it is 2 cm thick.
    assert spot.foot[1] == pytest.approx(1.18)
    assert math.sin(spot.heading_rad) == pytest.approx(1.0)
    assert spot.distance_m(0.3, 1.0) == pytest.approx(0.18)
    assert spot.before(stage_m(EPUCK))[1] == pytest.approx(1.18 - 0.062)
    assert max(abs(spot.foot[0]) for spot in found) < 1.48 - 0.11


def test_white_and_black_are_found_on_the_floor_s_picture(tmp_path: Path) -> None:
    experiment = Arena([(0.0, 0.0)]).experiment
    picture = np.full((240, 300, 3), 255, dtype=np.uint8)
    picture[:120, :60] = 0  # the arena's upper left: x < -0.9, y > 0
    cv2.imwrite(str(tmp_path / "floor.png"), picture)
    painted = replace(experiment, floor=FloorSpec("f", "image", tmp_path / "floor.png", 0.0, 1))
    found = ground_places(painted, None, None)
    assert found.black[0] < -0.93 and found.black[1] > 0.03
    assert found.white[0] > -0.87 or found.white[1] < -0.03
    assert ground_places(painted, (0.5, 0.5), None) == replace(found, white=(0.5, 0.5))
    picture[:] = 128
    cv2.imwrite(str(tmp_path / "floor.png"), picture)
    with pytest.raises(UsageError, match="--black X,Y:"):
        ground_places(painted, (0.5, 0.5), None)
    with pytest.raises(UsageError, match="two places"):
        ground_places(painted, (0.5, 0.5), (0.5, 0.505))


def test_readings_are_those_that_a_robot_says_it_knows() -> None:
    readings = OwnReadings()
    world = SimpleNamespace(robots=np.array([(7,), (8,), (9,)], dtype=[("tag", "<i4")]))
    values = np.array([[3, *range(11)], [1, *range(11)], [0, *range(11)]], dtype=np.float64)
    readings.apply(world, np.arange(3), values, values)  # type: ignore[arg-type]
    assert [sorted(readings.newest[tag]) for tag in (7, 8, 9)] == [
        ["ground", "proximity"],
        ["proximity"],
        [],
    ]
    assert readings.newest[7]["proximity"].tolist() == [*range(8)]
    assert readings.newest[7]["ground"].tolist() == [8, 9, 10]
