"""The way home: its judge, and once all of it in the lab, over a network that loses packets."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from tests.bench.homing import ContactTimes, HomingRow, report_of, row_of, table
from tests.conftest import require_own_network
from tests.rigs.places import ROOT
from vsense.world.physics.motion import TICK_NS
from vsense.world.robot_models import EPUCK

APART, TOUCHING = 2.0 * EPUCK.radius_m + 0.002, 2.0 * EPUCK.radius_m
TICK_S = TICK_NS / 1e9


def pair(apart_m: float) -> np.ndarray:
    return np.array([(0.0, 0.0, 0.0), (0.0, apart_m, 1.0), (1.0, 1.0, 0.0)])


def test_the_longest_contact_counts_also_one_that_lasts() -> None:
    contacts = ContactTimes()
    for apart_m in (APART, TOUCHING, TOUCHING, TOUCHING, APART, TOUCHING):
        contacts.tick(pair(apart_m))
    assert contacts.longest_s == pytest.approx(3 * TICK_S)
    for _ in range(3):
        contacts.tick(pair(TOUCHING))
    assert contacts.longest_s == pytest.approx(4 * TICK_S), "it goes on"


def judged(x_m: float, yaw_rad: float, contacts: ContactTimes | None = None) -> HomingRow:
    homes = np.array([(0.0, 0.0, np.pi - 0.01), (1.0, 0.0, 0.0)])
    poses = np.array([(x_m, 0.0, -np.pi + yaw_rad), (1.0, 0.001, 0.0)])
    return row_of(1, 20.0, homes, poses, contacts or ContactTimes(), [2.0, 3.0, 9.0])


def test_a_row_is_good_within_30_mm_and_10_degrees() -> None:
    row = judged(0.029, 0.16)
    assert row.is_good and (row.home, row.able) == (2, 2)
    assert row.worst_mm == pytest.approx(29.0)
    assert row.worst_deg == pytest.approx(np.degrees(0.17))
    assert (row.step_ms, row.most_ms) == (3.0, 9.0)
    assert not judged(0.031, 0.0).is_good and not judged(0.0, 0.17).is_good
    contacts = ContactTimes()
    for _ in range(51):
        contacts.tick(pair(TOUCHING))
    assert not judged(0.0, 0.0, contacts).is_good
    text = table(report_of([row, judged(0.031, 0.0)]))
    assert "1 of 2 seeds" in text and "1/2" in text


@pytest.mark.campaign
def test_robots_come_home_in_the_lab() -> None:
    require_own_network()
    words = [sys.executable, "-m", "tests.bench.homing_lab", "--seeds", "1", "--json"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["good"] == 1 and report["rows"][0]["able"] == 14
    for line in ("stands on the way home: no link", "no longer 'not seen'"):
        assert line in done.stderr
