"""Who joins the roster, and who does not: evidence that adds up, and a word to the contrary."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from vsense.vision.markers.families import load_family
from vsense.vision.tracking._joining import Joining, Newcomer, UnlistedTags
from vsense.vision.tracking._views import VIEW

STEP_NS = 100_000_000
ARROW, TAG36 = load_family("arrow4x4"), load_family("apriltag_36h11")
ROSTER = [31, 1843]
KNOWN = {31, 1843, 77}
NEW = 0b0101_1010_1100_0011
READ = 11
"""Readings that it takes: at 10 Hz a second has passed with the eleventh."""

Reads = Sequence[tuple[int, float, float]]


def strangers(*reads: tuple[int, float, float], family: object = ARROW) -> UnlistedTags:
    tags = np.array([tag for tag, _, _ in reads], dtype=np.int32)
    places = np.array([(x, y) for _, x, y in reads]).reshape(-1, 2)
    return UnlistedTags(family, ROSTER, 0.06, tags, places)  # type: ignore[arg-type]


def sightings(*robots: tuple[int, float, float]) -> NDArray[np.void]:
    seen = np.zeros(len(robots), dtype=VIEW)
    seen["tag"], seen["x_m"], seen["y_m"] = zip(*robots, strict=True)
    return seen


NOBODY = np.zeros(0, dtype=VIEW)
EVERYBODY = sightings((31, -0.5, 0.0), (1843, -0.5, 0.5))


def play(
    joining: Joining,
    steps: Sequence[Reads],
    seen: NDArray[np.void] = EVERYBODY,
    period_ns: int = STEP_NS,
) -> list[tuple[int, Newcomer]]:
    """Plays one camera's readings; returns who joined, and in which timestep."""
    joined: list[tuple[int, Newcomer]] = []
    for step, reads in enumerate(steps):
        known = KNOWN | {new.tag for _, new in joined}
        news = joining.update(step * period_ns, {"a": strangers(*reads)}, seen, known)
        joined += [(step, new) for new in news]
    return joined


def test_a_second_of_one_reading_joins_once_read_often_enough() -> None:
    steps = [[(NEW, 0.01 * step, 0.0)] for step in range(READ)]
    assert play(Joining(), steps) == [(READ - 1, Newcomer("arrow4x4", NEW, 0.06))]


@pytest.mark.parametrize(("period_ns", "last"), [(STEP_NS // 5, 50), (3 * STEP_NS, 9)])
def test_neither_many_readings_in_no_time_nor_few_over_long_are_enough(
    period_ns: int, last: int
) -> None:
    steps = [[(NEW, 0.0, 0.0)]] * (last + 3)
    joined = play(Joining(), steps, period_ns=period_ns)
    assert [step for step, _ in joined] == [last]


@given(st.integers(1, READ - 2), st.sampled_from(["jump", "gap", "twice", "other", "roster"]))
def test_one_word_to_the_contrary_and_it_begins_anew(at: int, what: str) -> None:
    steps: list[Reads] = [[(NEW, 0.0, 0.0)]] * (2 * READ + 8)
    seen: NDArray[np.void] = EVERYBODY
    joining, joined = Joining(), []
    for step, reads in enumerate(steps):
        seen = EVERYBODY
        if step == at:
            match what:
                case "jump":
                    reads = [(NEW, 0.5, 0.5)]
                case "twice":
                    reads = [*reads, (NEW, 0.5, 0.5)]
                case "other":
                    reads = [*reads, (NEW ^ 0xFF, 0.01, 0.0)]
                case "roster":
                    seen = sightings((31, 0.01, 0.0), (1843, -0.5, 0.5))
        if what == "gap" and at <= step < at + 6:
            reads = []
        joined += joining.update(step * STEP_NS, {"a": strangers(*reads)}, seen, KNOWN)
        if step == at + READ - 2:
            assert joined == []
    assert [new.tag for new in joined][:1] == [NEW]


def test_cameras_that_see_it_at_one_place_agree_and_at_two_do_not() -> None:
    for apart_m, count in ((0.01, 1), (0.2, 0)):
        joining, joined = Joining(), []
        for step in range(READ):
            seen = {"a": strangers((NEW, 0.0, 0.0)), "b": strangers((NEW, apart_m, 0.0))}
            joined += joining.update(step * STEP_NS, seen, EVERYBODY, KNOWN)
        assert len(joined) == count


def test_a_tag_that_is_known_to_somebody_does_not_join() -> None:
    assert play(Joining(), [[(77, 0.0, 0.0)]] * (2 * READ)) == []


def test_what_may_be_a_missing_robot_with_a_cable_across_waits_until_that_one_is_seen() -> None:
    covered = 1843 & 0b0000_1111_1111_1111 | 0b1111_0000_0000_0000
    steps = [[(covered, 0.0, 0.0)]] * (2 * READ)
    assert play(Joining(), steps, sightings((31, -0.5, 0.0))) == []
    assert len(play(Joining(), steps)) == 1
    # A robot that looks altogether different may be missing.
    assert len(play(Joining(), [[(NEW, 0.0, 0.0)]] * READ, NOBODY)) == 1


def test_a_square_marker_is_no_other_one() -> None:
    joining = Joining()
    seen = {"a": strangers((5, 0.0, 0.0), family=TAG36)}
    joined = [joining.update(step * STEP_NS, seen, NOBODY, KNOWN) for step in range(READ)]
    assert joined[-1] == [Newcomer("apriltag_36h11", 5, 0.06)]
