"""The figures of a run can fail: every kind of fault shows in the figure that it belongs to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from vsense.base.arena import SIGHTING
from vsense.modes.lab import _metrics, _report
from vsense.modes.lab._metrics import SwarmTruth
from vsense.modes.lab._microcontrollers import ACTUATION
from vsense.modes.lab._swarm import TRACE
from vsense.modes.lab.session import no_link
from vsense.run.figures import link_row

DT_NS = 100_000_000
RENDER_NS = 12_000_000
TIMESTEPS = 10
TAGS = (7, 9)
TURN = 6
FIRST = 40


SEEN = np.array([(7, 0.001, 0.0, 0.0), (9, 1.0, 0.0, 0.0)], SIGHTING)
"""What the cameras read of the two robots in every timestep."""


def tally(poses: np.ndarray, sightings: Sequence[np.ndarray]) -> dict:
    """Judges the sightings of a run by the true poses (timesteps, 2, 3)."""
    found = _metrics.TrackingTally(TAGS)
    for truth, seen in zip(poses, sightings, strict=True):
        found.add(seen, truth)
    return found.figures()


def make_run() -> _metrics.MeasuredRun:
    """Two robots, the first in the cone, everything as it should be."""
    steps = np.zeros(TIMESTEPS, _metrics.TIMESTEP)
    steps["run_timestep"] = np.arange(TIMESTEPS)
    steps["timestep"] = FIRST + steps["run_timestep"]
    steps["capture_ns"] = 1_000_000_000 + DT_NS * steps["run_timestep"]
    steps["render_ns"] = RENDER_NS
    steps["arena_ns"] = steps["capture_ns"] + RENDER_NS + 15_000_000
    steps["sent_ns"] = steps["arena_ns"] + 1_000_000
    poses = np.zeros((TIMESTEPS, 2, 3))
    poses[:, 1, 0] = 1.0
    depth_m = np.tile([0.1, -0.1], (TIMESTEPS, 1))
    lit = np.tile([True, False], (TIMESTEPS, 1))
    return _metrics.MeasuredRun(
        timesteps=steps,
        wanted=TIMESTEPS,
        lived=TIMESTEPS,
        dt_ns=DT_NS,
        tags=TAGS,
        tracking=tally(poses, [SEEN] * TIMESTEPS),
        truth=SwarmTruth(poses, depth_m, lit),
        object_poses=np.zeros((TIMESTEPS, 0, 3)),
        traces=[make_trace(steps, 1.0), make_trace(steps, 0.0)],
        sensing=[True, True],
        judged=[True, True],
        actuated=[make_actuations(steps)] * 2,
        turn=TURN,
        lateness_ms=[0.1, 0.2],
        link={"sent": 5, "received": 5, "dropped": 0, "reconnects": 0},
    )


def make_trace(steps: np.ndarray, value: float) -> np.ndarray:
    trace = np.zeros(len(steps), TRACE)
    trace["timestep"] = steps["timestep"]
    trace["newest_ns"] = trace["capture_ns"] = steps["capture_ns"]
    trace["rx_ns"] = steps["capture_ns"] + RENDER_NS + 17_000_000
    trace["now_ns"] = trace["rx_ns"] + 8_000_000
    trace["age_ns"] = trace["now_ns"] - trace["capture_ns"]
    trace["known"] = True
    trace["value"] = value
    trace["left"] = 300
    return trace


def make_actuations(steps: np.ndarray) -> np.ndarray:
    """In every timestep the base senses, the guard holds the wheels, and the new command comes."""
    rows = np.zeros((len(steps), 3), ACTUATION)
    after_ns = np.array([18_000_000, 25_500_000, 26_000_000])
    rows["time_ns"] = steps["capture_ns"][:, None] + RENDER_NS + after_ns
    rows["left_steps_s"] = [0, 0, 300]
    return rows.reshape(-1)


def without(run: _metrics.MeasuredRun, row: int) -> _metrics.MeasuredRun:
    """The same run, in which the host missed one timestep and the robots with it."""
    keep = np.arange(TIMESTEPS) != row
    truth = run.truth
    assert truth.depth_m is not None
    return replace(
        run,
        lived=run.lived - 1,
        timesteps=run.timesteps[keep],
        truth=SwarmTruth(truth.poses[keep], truth.depth_m[keep], truth.lit[keep]),
        traces=[trace[keep] for trace in run.traces],
    )


def test_perfect_run_is_perfect() -> None:
    figures = _metrics.figures(make_run())
    assert (figures["timesteps"], figures["late_timesteps"]) == (TIMESTEPS, 0)
    assert figures["duration_s"] == pytest.approx(1.0)
    assert figures["tracking"]["detected_mean"] == 2
    assert figures["tracking"]["position_rmse_mm"] == pytest.approx(0.707, abs=1e-3)
    sensing = figures["sensing"]
    assert (sensing["readings"], sensing["expected"]) == (20, 20)
    assert (sensing["agreement_in"], sensing["agreement_out"], sensing["fresh_share"]) == (1, 1, 1)
    latency = {name: spread["p50"] for name, spread in figures["latency_ms"].items()}
    assert latency == {
        "capture_to_arena": 15,
        "arena_to_sent": 1,
        "capture_to_sent": 16,
        "capture_to_robot": 17,
        "capture_to_control": 25,
        "capture_to_wheels": 26,
        "render": 12,
        "canary": 0.15,
    }
    assert figures["clock"]["age_error_ms_p99"] == 0
    assert set(figures["swarm"].values()) == {1}


def test_a_tag_that_nobody_carries_is_a_wrong_id() -> None:
    strange = np.array([(7, 0.001, 0.0, 0.0), (4321, 0.5, 0.5, 0.0)], SIGHTING)
    tracking = tally(make_run().truth.poses, [strange] + [SEEN] * (TIMESTEPS - 1))
    assert tracking["wrong_ids"] == 1 and tracking["detected_mean"] == pytest.approx(1.9)
    assert tracking["position_rmse_mm"] < 1.0


@pytest.mark.parametrize("row", [0, 3, TURN - 1, TURN, TIMESTEPS - 1])
def test_missed_timestep_is_late_and_its_readings_are_wrong(row: int) -> None:
    run = make_run()
    if row == 0:
        # A run begins with the first timestep that the host lived of it.
        run = replace(run, timesteps=run.timesteps.copy())
    figures = _metrics.figures(without(run, row))
    assert (figures["timesteps"], figures["late_timesteps"]) == (TIMESTEPS - 1, 1)
    assert (figures["sensing"]["readings"], figures["sensing"]["expected"]) == (18, 20)
    assert figures["sensing"]["fresh_share"] == pytest.approx(0.9)
    assert figures["sensing"]["agreement_in"] == pytest.approx(0.9)
    assert figures["sensing"]["agreement_out"] == pytest.approx(0.9)
    assert set(figures["swarm"].values()) == {1}, "both phases are still there"


def test_slow_timestep_is_late() -> None:
    run = make_run()
    run.timesteps["sent_ns"][4] = run.timesteps["capture_ns"][4] + DT_NS + 1
    assert _metrics.figures(run)["late_timesteps"] == 1


@pytest.mark.parametrize(
    ("field", "value"),
    [("value", 0.0), ("stale", True), ("known", False), ("capture_ns", 1)],
)
def test_wrong_stale_missing_or_foreign_value_does_not_agree(field: str, value: object) -> None:
    run = make_run()
    run.traces[0][field][2] = value
    sensing = _metrics.sensing(run)
    assert sensing["agreement_in"] == pytest.approx(0.9)
    assert sensing["agreement_out"] == 1


def test_value_is_judged_by_the_truth_of_its_own_capture_time() -> None:
    run = make_run()
    assert run.truth.depth_m is not None
    run.truth.depth_m[5, 1] = 0.1  # the second robot is in the cone for one timestep
    late = run.traces[1]
    late["value"][6], late["capture_ns"][6] = 1.0, run.timesteps["capture_ns"][5]
    late["value"][5] = 1.0
    assert _metrics.sensing(run)["agreement_in"] == 1
    late["value"][6] = 0.0
    assert _metrics.sensing(run)["agreement_in"] < 1


def test_places_near_the_edge_are_not_judged() -> None:
    run = make_run()
    assert run.truth.depth_m is not None
    run.truth.depth_m[:, 0] = 0.9 * _metrics.EDGE_MARGIN_M
    run.traces[0]["value"] = 0.0
    assert _metrics.sensing(run)["agreement_in"] is None


def test_swapped_ids_are_wrong_and_not_detected() -> None:
    swapped = SEEN.copy()
    swapped["tag"] = [9, 7]
    found = tally(make_run().truth.poses, [swapped] + [SEEN] * (TIMESTEPS - 1))
    assert found["wrong_ids"] == 2
    assert found["detected_mean"] == pytest.approx(1.8)


def test_second_place_of_a_tag_is_a_wrong_id() -> None:
    twice = np.append(SEEN, np.array([(7, 0.5, 0.5, 0.0)], SIGHTING))
    found = tally(make_run().truth.poses, [SEEN] * (TIMESTEPS - 1) + [twice])
    assert (found["wrong_ids"], found["detected_mean"]) == (1, 2)


def test_wrong_heading_across_half_a_turn_is_small() -> None:
    poses, turned = make_run().truth.poses, SEEN.copy()
    poses[:, :, 2], turned["yaw_rad"] = np.pi - 0.001, -np.pi + 0.001
    found = tally(poses, [turned] * TIMESTEPS)
    assert found["heading_rmse_deg"] == pytest.approx(np.degrees(0.002), abs=1e-3)


def test_wrong_age_shows() -> None:
    run = make_run()
    run.traces[0]["age_ns"] += 7_000_000
    assert _metrics.figures(run)["clock"]["age_error_ms_p99"] == pytest.approx(7)


def test_experiment_without_a_cone_has_no_cone_figures() -> None:
    run = make_run()
    figures = _metrics.figures(
        replace(run, truth=SwarmTruth(run.truth.poses, None, run.truth.lit), turn=None)
    )
    assert figures["sensing"]["agreement_in"] is None
    assert set(figures["swarm"].values()) == {None}


def test_wheels_that_never_took_the_command_do_not_count() -> None:
    run = make_run()
    for rows in run.actuated:
        rows["left_steps_s"] = 0
    assert _metrics.latencies(run)["capture_to_wheels"]["p50"] is None


def test_a_later_steps_command_is_not_taken_for_this_ones() -> None:
    """A base that is only told changes has no frame for a step that changes nothing."""
    run = make_run()
    assert _metrics.latencies(run)["capture_to_wheels"]["max"] == 26
    run = replace(run, actuated=[rows[len(rows) // 2 :] for rows in run.actuated])
    assert _metrics.latencies(run)["capture_to_wheels"]["max"] == 26


def test_nothing_seen_is_no_figure() -> None:
    empty = np.zeros(0, SIGHTING)
    found = tally(make_run().truth.poses, [empty] * TIMESTEPS)
    assert (found["detected_mean"], found["wrong_ids"]) == (0, 0)
    assert found["position_rmse_mm"] is None and found["heading_rmse_deg"] is None
    assert _metrics.TrackingTally(TAGS).figures()["detected_mean"] is None


def test_a_link_that_failed_before_it_was_asked_has_its_row() -> None:
    """A lab reports what it has, and then the failure."""
    assert link_row(no_link())[1].startswith("0 of 0 datagrams received")


def test_a_table_without_readings_says_so_in_words() -> None:
    summary = {
        **_metrics.figures(make_run()),
        "timesteps": 9, "late_timesteps": 0, "left_out_timesteps": 0,
        "unlogged_timesteps": 0, "pace": 1.0, "calibration": None, "robots": 2, "measures": {},
        "vision": dict.fromkeys(("left_out", "old_pictures", "overflows", "camera_events"), 0),
        "clock": {"age_error_ms_p99": None}, "why": "", "note": "",
    }  # fmt: skip
    text = _report.table(summary)
    assert "None" not in text and "no reading came" in text
    assert "canary" not in text and "a timer of 10 ms, late by" in text
