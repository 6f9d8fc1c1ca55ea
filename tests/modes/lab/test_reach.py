"""The part of an arena that robots can get to, which the lab's cameras have to see."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from vsense.config.experiment import load
from vsense.config.placement import settle
from vsense.config.specs import Experiment, Stage
from vsense.modes.lab._camera_spec import spec_for
from vsense.modes.lab._reach import drawn, reachable
from vsense.world.world import World

FILE = """<argos-configuration>
<framework><experiment length="10" ticks_per_second="10" random_seed="1" /></framework>
<controllers><c id="c" library="stand_still">
<actuators><epuck_wheels implementation="default" /></actuators><sensors /></c></controllers>
<arena size="10,10,1" center="0,0,0.5">{walls}
<e-puck id="a"><body position="0.4,0.3,0" orientation="0,0,0" /><controller config="c" /></e-puck>
{more}</arena>
</argos-configuration>"""
WALL = '<box id="{}" size="0.01,{:.4f},0.1" movable="false">{}</box>'
BODY = '<body position="{:.4f},{:.4f},{}" orientation="{:.4f},0,0" />'


def ring(count: int, apothem_m: float, gap_m: float = 0.0, height_m: float = 0.0) -> str:
    """Walls around the origin; between any two neighbours is a gap."""
    side_m = 2.0 * apothem_m * math.tan(math.pi / count) - gap_m
    walls = ""
    for i in range(count):
        deg = 360.0 * i / count
        at = apothem_m * math.cos(math.radians(deg)), apothem_m * math.sin(math.radians(deg))
        walls += WALL.format(f"wall_{i}", side_m, BODY.format(*at, height_m, deg))
    return walls


def experiment(folder: Path, walls: str, more: str = "") -> Experiment:
    path = folder / "x.argos"
    path.write_text(FILE.format(walls=walls, more=more))
    return settle(load(path, stage=Stage.LAB), 1)


@pytest.mark.parametrize("gap_m", [0.0, 0.04])
def test_a_ring_of_walls_is_all_that_cameras_see(tmp_path: Path, gap_m: float) -> None:
    inside = reachable(experiment(tmp_path, ring(12, 1.23, gap_m)))
    assert inside.centre_m[:2] == pytest.approx((0.0, 0.0), abs=0.02)
    assert inside.size_m[:2] == pytest.approx((2.46, 2.46), abs=0.08)
    cameras = spec_for(experiment(tmp_path, ring(12, 1.23, gap_m)), "truth", 1, Path("log")).cameras
    assert len(cameras) == 4


@pytest.mark.parametrize(
    "walls",
    ["", ring(12, 1.23, gap_m=0.12), ring(4, 1.0, height_m=0.5)],
    ids=["none", "doors", "overhead"],
)
def test_where_a_robot_can_get_out_the_whole_arena_counts(tmp_path: Path, walls: str) -> None:
    whole = experiment(tmp_path, walls)
    assert reachable(whole).size_m[:2] == pytest.approx((10.0, 10.0), abs=0.02)
    assert len(spec_for(whole, "truth", 1, Path("log")).cameras) == 35


def test_robots_on_both_sides_of_a_wall_are_both_seen(tmp_path: Path) -> None:
    outside = (
        '<e-puck id="b"><body position="2,0,0" orientation="0,0,0" />'
        '<controller config="c" /></e-puck>'
    )
    assert reachable(experiment(tmp_path, ring(12, 1.23), outside)).size_m[0] > 9.9


def test_a_robot_that_touches_its_wall_is_on_its_own_side(tmp_path: Path) -> None:
    touching = (
        '<e-puck id="b"><body position="1.189,0,0" orientation="0,0,0" />'
        '<controller config="c" /></e-puck>'
    )
    assert reachable(experiment(tmp_path, ring(12, 1.23), touching)).size_m[0] < 2.6


def test_pictures_show_what_is_reached_with_its_walls_and_where_anybody_was(tmp_path: Path) -> None:
    whole = experiment(tmp_path, ring(12, 1.23))
    world = World([1], entities=whole.entities, arena=whole.arena)
    poses = np.full((3, 1, 3), 0.4)
    part = drawn(world, whole.arena, poses)
    assert part.centre_m[:2] == pytest.approx((0.0, 0.0), abs=0.02)
    assert part.size_m[:2] == pytest.approx((2.66, 2.66), abs=0.08)
    poses[2, 0, 0] = 3.0  # loop functions have put it there
    far = drawn(world, whole.arena, poses)
    assert far.centre_m[0] + far.size_m[0] / 2.0 == pytest.approx(3.0 + 0.035 + 0.1, abs=0.01)
    assert far.size_m[1] == part.size_m[1]
    assert drawn(world, whole.arena, poses[:0]) == whole.arena


def test_the_shipped_arenas_are_seen_whole() -> None:
    for name in ("pollutant", "foraging", "aggregation"):
        shipped = load(name, stage=Stage.LAB)
        assert reachable(settle(shipped, 1)).size_m[:2] == pytest.approx(
            shipped.arena.size_m[:2], abs=0.08
        )
