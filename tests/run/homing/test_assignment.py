"""Who drives where, against all assignments that there are."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from vsense.config.specs import Pose
from vsense.run.homing._assignment import assign, bottleneck


@pytest.mark.parametrize("seed", range(40))
def test_no_other_assignment_is_better(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows = int(random.integers(1, 6))
    columns = int(random.integers(rows, 7))
    # Few different costs, so that many assignments have the same largest one.
    costs = random.integers(0, 6, (rows, columns)) / 4.0
    chosen = bottleneck(costs)
    every = itertools.permutations(range(columns), rows)
    found = [[costs[i, c] for i, c in enumerate(one)] for one in every]
    mine = [costs[i, c] for i, c in enumerate(chosen)]
    assert len(set(chosen)) == rows
    assert (max(mine), sum(mine)) == min((max(one), sum(one)) for one in found)


def test_no_way_is_taken_only_where_nothing_else_is_left() -> None:
    inf = math.inf
    assert bottleneck(np.array([[inf, 9.0], [1.0, 1.0]])) == [1, 0]
    assert sorted(bottleneck(np.array([[inf, 2.0], [inf, 1.0]]))) == [0, 1]
    assert bottleneck(np.zeros((0, 3))) == []


def test_only_robots_of_a_kind_exchange_homes() -> None:
    places = {1: Pose(0.0, 0.0, 0.0), 2: Pose(1.0, 0.0, 0.0), 3: Pose(2.0, 0.0, 0.0)}
    homes = {1: Pose(2.0, 0.0, 0.0), 2: Pose(0.0, 0.0, 0.0), 3: Pose(1.0, 0.0, 0.0)}
    assert assign(places, homes, {}) == homes
    all_alike = assign(places, homes, dict.fromkeys(homes, "a"))
    assert all_alike == {1: homes[2], 2: homes[3], 3: homes[1]}
    two = assign(places, homes, {1: "a", 2: "a", 3: "b"})
    assert two == {1: homes[2], 2: homes[1], 3: homes[3]}


def test_who_is_not_seen_gets_its_own_home_if_that_is_left() -> None:
    homes = {1: Pose(0.0, 0.0, 0.0), 2: Pose(1.0, 0.0, 0.0), 3: Pose(2.0, 0.0, 0.0)}
    kinds = dict.fromkeys(homes, "a")
    assert assign({1: homes[1]}, homes, kinds) == homes
    found = assign({1: homes[3]}, homes, kinds)
    assert found[1] == homes[3] and {found[2], found[3]} == {homes[1], homes[2]}
    assert found[2] == homes[2]
