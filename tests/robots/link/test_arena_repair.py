"""Repair with the tag list: misreadings, losses and duplicates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.arena import ArenaState
from vsense.robots.link.trackers._repair import FORGET_NS, REPAIRED, Repair
from vsense.robots.link.trackers.protocol import TrackerReport

TICK_NS = 100_000_000
TAGS = (1, 2, 3)


class Story:
    """States at a pace of one in 100 ms."""

    def __init__(self, *first: TrackerReport) -> None:
        self.repair = Repair(TAGS)
        self.tick = 0
        if first:
            self.see(*first)

    def see(self, *reports: TrackerReport, after: int = 1) -> ArenaState:
        self.tick += after
        return self.repair.update(reports, self.tick, self.tick * TICK_NS)


def at(tag: int, x_m: float, y_m: float = 0.0) -> TrackerReport:
    return TrackerReport(tag, x_m, y_m, 0.5)


def test_reports_become_poses_sorted_by_tag() -> None:
    state = Story().see(at(3, 0.3), at(1, 0.1, -1.0))
    assert state.robots["tag"].tolist() == [1, 3]
    assert state.robots["x_m"].tolist() == [0.1, 0.3]
    assert state.robots["y_m"].tolist() == [-1.0, 0.0]
    assert state.robots["yaw_rad"].tolist() == [0.5, 0.5]
    assert state.robots["seen"].all() and (state.robots["confidence"] == 1.0).all()
    assert state.sightings.tolist() == [(3, 0.3, 0.0, 0.5), (1, 0.1, -1.0, 0.5)]
    assert (state.timestep, state.capture_ns, state.detected, state.unnamed) == (1, TICK_NS, 2, 0)


def test_defect_12_a_lost_robot_ages_fades_and_is_left_out() -> None:
    story = Story(at(1, 0.1), at(2, 0.5))
    ages, confidences = [], []
    while len((state := story.see(at(2, 0.5))).robots) == 2:
        lost = state.robots[0]
        assert (lost["tag"], lost["x_m"], bool(lost["seen"]), lost["cameras"]) == (1, 0.1, False, 0)
        ages.append(int(lost["age_ns"]))
        confidences.append(float(lost["confidence"]))
    assert ages == [k * TICK_NS for k in range(1, FORGET_NS // TICK_NS + 1)]
    assert confidences == sorted(confidences, reverse=True) and confidences[-1] < 0.01


def test_a_misread_tag_near_one_lost_robot_is_that_robot() -> None:
    story = Story(at(1, 0.0), at(2, 0.5))
    state = story.see(at(99, 0.01), at(2, 0.5))
    assert state.robots["x_m"].tolist() == [0.01, 0.5] and state.robots["seen"].all()
    assert state.robots["confidence"].tolist() == [REPAIRED, 1.0]
    assert (state.unnamed, story.repair.counters.repaired, story.repair.counters.unknown) == (
        0,
        1,
        0,
    )


@pytest.mark.parametrize(
    "reports",
    [
        (at(99, 0.2),),  # out of reach
        (at(99, 0.01), at(98, -0.01)),  # two could be it
        (at(99, 0.01), at(1, 0.0)),  # the robot is not lost
    ],
)
def test_where_there_is_doubt_an_unknown_tag_is_dropped_and_counted(reports: tuple) -> None:
    story = Story(at(1, 0.0))
    state = story.see(*reports)
    unlisted = sum(report.tag > 3 for report in reports)
    assert state.unnamed == story.repair.counters.unknown == unlisted
    assert story.repair.counters.repaired == 0
    assert state.robots["tag"].tolist() == [1] and state.robots["x_m"].tolist() == [0.0]


def test_one_unknown_tag_between_two_lost_robots_is_neither() -> None:
    story = Story(at(1, 0.0), at(2, 0.03))
    assert story.see(at(99, 0.015)).unnamed == 1


def test_a_lost_robot_may_have_come_farther_the_longer_it_is_lost() -> None:
    story = Story(at(1, 0.0))
    assert not story.see(at(99, 0.2), after=2).robots["seen"][0]
    assert story.see(at(99, 0.2), after=8).robots["seen"][0]


def test_of_a_tag_that_is_there_twice_only_one_within_reach_is_believed() -> None:
    story = Story(at(1, 0.0))
    state = story.see(at(1, 0.01), at(1, 1.0))
    assert state.duplicates == (1,) and state.detected == 1
    assert state.robots["x_m"].tolist() == [0.01] and state.robots["seen"].all()
    assert state.robots["confidence"].tolist() == [REPAIRED]
    state = story.see(at(1, 0.02), at(1, 0.0))
    assert state.duplicates == (1,) and not state.robots["seen"].any()
    assert len(Story().see(at(1, 0.02), at(1, 0.0)).robots) == 0


def test_speed_follows_the_robot() -> None:
    story = Story()
    for step in range(10):
        state = story.see(at(1, 0.012 * step))
    assert state.robots["speed_m_s"][0] == pytest.approx(0.12, rel=0.01)


@given(
    st.lists(
        st.lists(
            st.builds(
                TrackerReport,
                st.integers(0, 6),
                st.floats(-1.0, 1.0),
                st.floats(-1.0, 1.0),
                st.floats(-math.pi, math.pi, exclude_min=True),
            ),
            max_size=6,
        ),
        max_size=8,
    )
)
def test_only_the_experiments_tags_ever_appear_and_every_report_is_accounted_for(
    states: list[list[TrackerReport]],
) -> None:
    story = Story()
    for reports in states:
        before = story.repair.counters.repaired
        state = story.see(*reports)
        assert set(state.robots["tag"].tolist()) <= set(TAGS)
        assert (np.diff(state.robots["tag"].astype(int)) > 0).all()
        unlisted = sum(report.tag not in TAGS for report in reports)
        assert state.unnamed + story.repair.counters.repaired - before == unlisted
        assert (state.robots["age_ns"] >= 0).all()
        assert (state.robots["seen"] == (state.robots["age_ns"] == 0)).all()
