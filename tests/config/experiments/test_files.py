"""The shipped experiments as files: complete, supported, documented."""

from __future__ import annotations

import re
from importlib import resources
from itertools import pairwise
from pathlib import Path

import pytest

from tests.conftest import States
from vsense.config.experiment import load, shipped
from vsense.config.placement import settle
from vsense.run.environment import Environment
from vsense.world.robot_models import EPUCK

FOLDER = Path(str(resources.files("vsense") / "config/experiments"))


@pytest.mark.parametrize("name", shipped())
def test_experiment_loads_without_any_warning(name: str) -> None:
    experiment = load(name)
    experiment.refuse_warnings()
    assert 10 <= len(experiment.robots) <= 20
    assert 0.0 < experiment.length_s <= 120.0
    assert experiment.arena.size_m[:2] == (3.0, 2.4), "four cameras of the lab see this arena"


@pytest.mark.parametrize("name", shipped())
def test_experiment_says_how_to_start_it_and_what_it_measures(name: str, state: States) -> None:
    environment = Environment(settle(load(name), 1), 1)
    environment.step(state({}, 1_000_000_000), 0, {})
    text = (FOLDER / f"{name}.argos").read_text()
    assert f"vsense lab {name}\n" in text
    for measure in environment.end():
        assert re.search(rf"\b{measure}\b", text), measure
        assert f"`{measure}`" in (FOLDER / "README.md").read_text().replace("*", ""), measure


def test_every_experiment_is_in_the_list() -> None:
    listed = re.findall(
        r"^\| \[`([\w-]+)`\]\(([\w-]+)\.argos\)", (FOLDER / "README.md").read_text(), re.M
    )
    assert sorted(name for name, _ in listed) == sorted(shipped())
    assert all(name == file for name, file in listed)


def test_labyrinth_begins_with_all_robots_in_the_west_and_no_way_out() -> None:
    experiment = load("labyrinth")
    virtual = [box for box in experiment.entities if box.id.startswith(("maze", "door"))]
    assert not any(box.physical for box in virtual)
    for x_m in (-0.5, 0.5):
        spans = sorted(
            (box.position_m[1] - box.size_m[1] / 2, box.position_m[1] + box.size_m[1] / 2)
            for box in virtual
            if box.position_m[0] == x_m
        )
        assert spans[0][0] <= -1.2 + EPUCK.radius_m and spans[-1][1] >= 1.2 - EPUCK.radius_m
        assert all(low[1] >= high[0] - 1e-9 for low, high in pairwise(spans)), "no gap"
    for robot in experiment.robots:
        assert robot.distribution is not None
        assert robot.distribution.position_m.second[0] < -0.5 - EPUCK.radius_m
