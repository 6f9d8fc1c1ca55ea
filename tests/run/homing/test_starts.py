"""Before a run: who may exchange starts, who cannot be told to drive, and who rests."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.run.stage import status
from vsense.config import roster
from vsense.config.casting import Casting
from vsense.config.experiment import load
from vsense.config.geofence import Geofence, Polygon
from vsense.config.specs import Experiment
from vsense.robots.link._peer import Orders
from vsense.robots.link.wire import StopCause, Telemetry, Wanted
from vsense.run.homing.floor import DrivingFloor
from vsense.run.homing.robots import Trouble
from vsense.run.homing.starts import Starts, hindered
from vsense.world.pollution import PollutantSource

ROSTER = """
[defaults]
base = "argos:/dev/ttyS0"
[[robot]]
tag = 31
[[robot]]
tag = 1843
base = "gctronic:/dev/i2c-4"
[[robot]]
tag = 4334
[[robot]]
tag = 61
spare = true
base = "gctronic:/dev/i2c-4"
"""


@pytest.fixture
def casting(tmp_path: Path) -> Casting:
    path = tmp_path / "robots.toml"
    path.write_text(ROSTER)
    return Casting.of(roster.read(path))


def groups(experiment: Experiment) -> list[list[int]]:
    """Tags of those that exchange their starts."""
    kinds = Starts(experiment).kinds()
    return [[tag for tag in kinds if kinds[tag] == kind] for kind in dict.fromkeys(kinds.values())]


def test_only_robots_with_the_same_controller_exchange_starts() -> None:
    predators, prey = groups(load("predator_prey"))
    assert predators == [31, 1843, 4334, 7167] and len(prey) == 10


def test_only_robots_of_the_same_type_do_and_a_spare_has_its_own(casting: Casting) -> None:
    others = [7167]  # the roster does not know what it is
    played = load("predator_prey", casting=casting)
    assert groups(played)[:3] == [[31, 4334], [1843], others]
    spared = load("predator_prey", casting=replace(casting, replaced=((4334, 61),)))
    assert groups(spared)[:3] == [[31], [1843, 61], others]
    assert Casting.read({"types": [[31, "argos"]]}).types == ((31, "argos"),)


def test_a_robot_that_pollutes_keeps_its_start() -> None:
    experiment = load("aggregation")
    source = PollutantSource(7167, 0.0, 1.0, 1.0)
    alone, others = sorted(groups(replace(experiment, sources=(source,))), key=len)
    assert alone == [7167] and len(others) == 14


def test_a_part_has_the_same_start_whoever_plays_it() -> None:
    spared = load("aggregation", casting=Casting(replaced=((31, 61),)))
    before, after = Starts(load("aggregation")).of(5), Starts(spared).of(5)
    assert before[31] == after[61] and 31 not in after
    assert Starts(spared).of(6)[61] != after[61], "each run has its own"


def test_who_cannot_be_told_to_drive() -> None:
    causes = [StopCause.WANTED, StopCause.BATTERY, StopCause.BASE]
    robots = {
        tag: status(tag, f"epuck_{tag}", drives_home=True, telemetry=Telemetry(stop_cause=cause))
        for tag, cause in enumerate(causes, 1)
    }
    robots[4] = status(4, "epuck_4", connected=False, drives_home=True)
    robots[5] = status(5, "epuck_5")
    robots[6] = status(6, "epuck_6", drives_home=True, held="nearer than 0.5 m to cap")
    held, old, near = Trouble.HELD, Trouble.TOO_OLD, Trouble.NEAR
    assert hindered(robots) == {2: held, 3: held, 4: Trouble.NO_LINK, 5: old, 6: near}


def test_ways_lead_around_forbidden_zones_and_back_inside() -> None:
    zone = Polygon(((-0.2, -0.6), (0.2, -0.6), (0.2, 0.6), (-0.2, 0.6)))
    border = Polygon(((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)))
    arena = load("aggregation").arena
    floor = DrivingFloor(arena, fence=Geofence(border, (zone,)))
    assert not floor.is_open and not floor.is_clear((-0.5, 0.0), (0.5, 0.0), 0.05)
    way = [(-0.5, 0.0), *(floor.way((-0.5, 0.0), (0.5, 0.0), 0.05) or ())]
    line = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(way)])
    assert way[-1] == (0.5, 0.0) and (zone.depth_m(line) < 0.0).all()
    assert (border.depth_m(line) > 0.0).all()
    assert floor.way((1.1, 0.0), (0.5, 0.0), 0.05), "who is outside drives back"


@pytest.mark.parametrize("wanted", list(Wanted))
def test_who_rests_is_told_all_but_to_run(wanted: Wanted) -> None:
    orders = Orders(7, wanted, 3, resting=frozenset({23}))
    assert orders.of(24) == orders
    resting = orders.of(23)
    assert resting.wanted == (Wanted.IDLE if wanted == Wanted.RUN else wanted)
    assert (resting.run, resting.from_timestep) == (7, 3)
