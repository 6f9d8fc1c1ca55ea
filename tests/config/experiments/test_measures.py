"""Every shipped experiment shows what it is for: its measure tells seeing robots from blind ones.

The quick tests are short runs with five seeds; the campaigns (`-m campaign`) are the experiments
as they are shipped, with ten, and print a table.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

import pytest

from tests.config.experiments.permutation import p_value
from tests.conftest import require_tool
from vsense.config.experiment import shipped
from vsense.modes.sim.job import Job, Setup
from vsense.modes.sim.outcome import Task, libraries_of
from vsense.modes.sim.watch import simulate_all

LIMIT_S = 60.0


@dataclass(frozen=True)
class Case:
    """What an experiment's measure has to show.

    Attributes:
        measure: its name.
        factor: so many times as large it is at least with sight (smaller: below 1), in medians.
        quick_s: length of a run that shows it with five seeds.
        quick: what is set for that, beside the length.
    """

    measure: str
    factor: float
    quick_s: float
    quick: dict[str, str] = field(default_factory=dict)


CASES = {
    "aggregation": Case("robots_on_green_mean", 4.0, 30.0),
    "foraging": Case("items_home", 4.0, 35.0, {"food.radius": "0.35", "nest.radius": "0.4"}),
    "labyrinth": Case("robots_in_east", 2.0, 36.0, {"first.time_s": "2", "second.time_s": "15"}),
    "phototaxis": Case("light_distance_mean_m", 0.5, 20.0),
    "pollutant": Case("in_cone_after_turn", 2.0, 60.0),
    "pollutant-cleaning": Case("pollution_left", 0.2, 20.0),
    "pollutant-moving": Case("robots_in_cone_mean", 4.0, 30.0),
    "predator_prey": Case("prey_caught", 2.0, 40.0),
}


def runs(setups: Sequence[Setup], seeds: Sequence[int]) -> list[list[dict[str, Any]]]:
    """Runs every setup with every seed; gives the measures by setup, in the order of the seeds."""
    require_tool("cc", "build-essential")
    tasks = []
    for setup in setups:
        experiment = setup.load()
        libraries = libraries_of(experiment)
        tasks += [Task(Job(setup, seed, libraries), experiment) for seed in seeds]
    going = simulate_all(
        tasks, os.cpu_count() or 1, threading.Event(), lambda workers: None, LIMIT_S
    )
    found = {id(task): {**result["swarm"], **result["measures"]} for task, result in going}
    return [
        [found[id(task)] for task in tasks[first : first + len(seeds)]]
        for first in range(0, len(tasks), len(seeds))
    ]


def compare(
    name: str, seeds: Sequence[int], length_s: float | None, settings: dict[str, str]
) -> tuple[float, float, float]:
    """Gives the measure's medians, seeing and blind, and how likely they are by chance."""
    setups = [Setup(name, length_s, None, blind, settings) for blind in (False, True)]
    measure = CASES[name].measure
    seeing, blind = ([float(run[measure]) for run in of_setup] for of_setup in runs(setups, seeds))
    return median(seeing), median(blind), p_value(seeing, blind)


def test_every_shipped_experiment_has_a_case() -> None:
    assert set(CASES) == set(shipped())


@pytest.mark.parametrize(("name", "case"), CASES.items(), ids=CASES)
def test_measure_differs_from_blind_in_short_runs(name: str, case: Case) -> None:
    _, _, p = compare(name, range(1, 6), case.quick_s, case.quick)
    assert p < 0.05


@pytest.mark.campaign
@pytest.mark.parametrize(("name", "case"), CASES.items(), ids=CASES)
def test_measure_differs_from_blind(
    name: str, case: Case, capsys: pytest.CaptureFixture[str]
) -> None:
    seeing, blind, p = compare(name, range(1, 11), None, {})
    with capsys.disabled():
        print(f"\n{name:20}{case.measure:24}{seeing:8.3f}{blind:8.3f}  p = {p:.2g}", end=" ")
    assert p < 0.01
    if case.factor > 1.0:
        assert seeing >= case.factor * blind
    else:
        assert seeing <= case.factor * blind


def test_a_seed_repeats_loop_functions_and_controllers() -> None:
    names = ("aggregation", "foraging", "pollutant-moving")
    first, again = (runs([Setup(name, 8.0) for name in names], [3]) for _ in range(2))
    assert first == again


def test_virtual_walls_are_crossed_by_the_blind_only() -> None:
    setups = [Setup("labyrinth", 20.0, blind=blind) for blind in (False, True)]
    (seeing,), (blind,) = runs(setups, [1])
    assert seeing["walls_crossed"] == 0.0 < blind["walls_crossed"]


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ([1, 2, 3], [4, 5, 6], 2 / 20),
        ([1, 2, 3, 4, 5], [6, 7, 8, 9, 10], 2 / 252),
        ([1.0, 1.0, 1.0], [1.0, 1.0, 1.0], 1.0),
        ([1, 2, 6], [3, 4, 5], 14 / 20),
        ([0.1, 0.2], [0.3, 0.3], 2 / 6),
    ],
)
def test_permutation_test(first: list[float], second: list[float], expected: float) -> None:
    assert p_value(first, second) == pytest.approx(expected)
    assert p_value(second, first) == pytest.approx(expected)
