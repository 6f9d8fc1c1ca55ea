"""The judge of a long run: what is a name, what is a wrong one, and what is a swap."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.bench import main
from tests.bench.identity import FAMILIES, ROBOTS, IdentityScore
from vsense.base.arena import POSE, SIGHTING, ArenaState

TRUTH = {1: np.array((0.0, 0.0)), 2: np.array((1.0, 0.0)), 3: np.array((2.0, 0.0))}


def state(
    *robots: tuple[int, float, bool], readings: tuple[tuple[int, float], ...] = ()
) -> ArenaState:
    poses = np.zeros(len(robots), dtype=POSE)
    for row, (tag, x_m, seen) in zip(poses, robots, strict=True):
        row["tag"], row["x_m"], row["seen"] = tag, x_m, seen
    sightings = np.array([(tag, x, 0.0, 0.0) for tag, x in readings], dtype=SIGHTING)
    return ArenaState(0, 0, poses, len(poses), sightings=sightings)


def test_a_robot_that_is_only_remembered_is_not_named() -> None:
    tally = IdentityScore("arrow4x4")
    tally.judge(state((1, 0.003, True), (2, 1.0, False)), TRUTH)
    report = tally.report()
    assert (report["robot_frames"], report["named"], report["wrong_ids"]) == (3, 1, 0)
    assert report["named_share"] == pytest.approx(1 / 3)
    assert report["position_rms_mm"] == pytest.approx(3.0)


def test_a_name_elsewhere_is_wrong_and_at_another_robot_s_place_a_swap() -> None:
    tally = IdentityScore("arrow4x4")
    tally.judge(state((1, 1.01, True), (2, 0.5, True), (9, 2.0, True)), TRUTH)
    assert (tally.named, tally.wrong_ids, tally.swaps) == (0, 3, 2)


def test_readings_are_judged_whatever_the_tracker_made_of_them() -> None:
    tally = IdentityScore("arrow4x4")
    tally.judge(state(readings=((1, 0.01), (1, 0.5), (7, 0.0))), TRUTH)
    assert tally.wrong_readings == 2 and tally.wrong_ids == 0


def test_the_report_is_as_promised(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["identity", "--timesteps", "6", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [row["family"] for row in rows] == list(FAMILIES)
    for row in rows:
        assert row["robot_frames"] == 6 * ROBOTS
        assert row["named_share"] == 1.0 and row["position_rms_mm"] < 0.2
        assert row["wrong_ids"] == row["swaps"] == row["wrong_readings"] == row["joined"] == 0
