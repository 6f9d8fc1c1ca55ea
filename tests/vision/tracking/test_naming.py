"""Names along the tracks: one bad picture changes nothing, and no wrong name comes of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.arena import UNNAMED
from vsense.vision.markers.families import cell_blur, load_family
from vsense.vision.tracking._kernel import MARKER
from vsense.vision.tracking._naming import Decoder, carry_names, gather_evidence
from vsense.vision.tracking._prediction import EXPECTED, Prediction
from vsense.vision.tracking._rows import (
    SAME_ROBOT_M,
    Rows,
    are_near,
    gather,
    join,
    near_pairs,
    single_pairs,
)

ARROW = load_family("arrow4x4")
ROSTER = np.array([31, 1843, 4334], dtype=np.int32)
NOBODY = np.array([UNNAMED], dtype=np.int32)


def at(
    *places: tuple[float, float], picture: int = 0, guess: int = 31, error: float = 0.15
) -> Rows:
    rows = np.zeros(len(places), dtype=MARKER)
    rows["sharp_ahead"] = rows["sharp_left"] = 0.75
    rows["guess"], rows["error"] = guess, error
    for row, place in zip(rows, places):
        row["x_m"], row["y_m"] = place
    return Rows(rows, np.full(len(rows), picture, dtype=np.intp))


HERE = at((0.0, 0.0))


def expected(*robots: tuple[int, float, bool]) -> Rows:
    rows = [(tag, x_m, 0.0, 0.0, sure, 0.06) for tag, x_m, sure in robots]
    return gather([np.array(rows, dtype=EXPECTED)])


def carry(tags: np.ndarray, robots: Rows, guess: int = 31, error: float = 0.15) -> list[int]:
    """Names one marker, whose cells suggest a tag."""
    return carry_names(tags, at((0.0, 0.0), guess=guess, error=error), robots).tolist()


def test_a_blurred_marker_keeps_its_name() -> None:
    assert carry(NOBODY, expected((31, 0.01, True))) == [31]


def test_not_where_the_cells_suggest_another_or_nothing() -> None:
    assert carry(NOBODY, expected((31, 0.01, True)), guess=1843) == [UNNAMED]
    assert carry(NOBODY, expected((31, 0.01, True)), guess=UNNAMED) == [UNNAMED]
    assert carry(NOBODY, expected((31, 0.01, True)), error=0.25) == [UNNAMED]


def test_not_where_the_robot_is_not_sure_to_be() -> None:
    assert carry(NOBODY, expected((31, 0.01, False))) == [UNNAMED]
    assert carry(NOBODY, expected((31, 0.04, True))) == [UNNAMED]


def test_not_where_two_robots_may_be_meant() -> None:
    assert carry(NOBODY, expected((31, 0.01, True), (1843, -0.01, True))) == [UNNAMED]


def test_not_twice_in_one_picture() -> None:
    tags = np.array([31, UNNAMED], dtype=np.int32)
    robots = expected((31, 0.0, True))
    assert carry_names(tags, at((0.5, 0.0), (0.0, 0.0)), robots).tolist() == [31, UNNAMED]
    other = Rows(at((0.5, 0.0), (0.0, 0.0)).values, np.array([1, 0]))
    assert carry_names(tags, other, robots).tolist() == [31, 31], "in another one it may be"


def test_another_picture_s_robot_names_nothing() -> None:
    robots = expected((31, 0.0, True))
    assert carry_names(NOBODY, at((0.0, 0.0), picture=1), robots).tolist() == [UNNAMED]


def test_another_name_than_that_of_the_robot_that_must_be_there_is_not_believed() -> None:
    wrong = np.array([1843], dtype=np.int32)
    assert carry(wrong, expected((31, 0.0, True))) == [UNNAMED]
    assert carry(wrong, expected((31, 0.0, False))) == [1843]


@given(st.sampled_from([31, 1843, 4334]), st.integers(0, 2**32 - 1))
def test_evidence_over_pictures_names_what_no_single_one_does(tag: int, seed: int) -> None:
    decoder, known = Decoder(ARROW, ROSTER.tolist()), Prediction()
    word = ARROW.bits(tag).ravel().astype(float) @ cell_blur(ARROW, 1.2).T
    rng = np.random.default_rng(seed)
    named = UNNAMED
    for step in range(40):
        known.capture_ns = step * 66_000_000
        cells = (word + rng.normal(0.0, 0.3, 16))[np.newaxis]
        here = at((0.005 * step, 0.005 * step))
        tags = gather_evidence(NOBODY, here, cells, ["a"], known, decoder)
        assert tags[0] in (UNNAMED, tag)
        named = tags[0]
    assert named == tag


def test_evidence_is_not_carried_over_a_gap_or_a_jump() -> None:
    decoder, known = Decoder(ARROW, ROSTER.tolist()), Prediction()
    cells = np.full((1, 16), 0.5)
    for step, (time_ns, x_m) in enumerate([(0, 0.0), (66, 0.0), (132, 0.2), (932, 0.2)]):
        known.capture_ns = time_ns * 1_000_000
        gather_evidence(NOBODY, at((x_m, x_m)), cells, ["a"], known, decoder)
        assert known.anonymous["a"].pictures.tolist() == [2 if step == 1 else 1]


@pytest.mark.parametrize("count", [0, 2])
def test_nothing_expected_changes_nothing(count: int) -> None:
    tags = np.arange(count, dtype=np.int32)
    markers = at(*[(0.0, 0.0)] * count)
    assert carry_names(tags, markers, expected()).tolist() == tags.tolist()


@given(st.integers(0, 2**32 - 1), st.integers(0, 40), st.integers(0, 40))
def test_near_rows_are_those_that_all_pairs_give(seed: int, some: int, others: int) -> None:
    rng = np.random.default_rng(seed)
    rows = [Rows(at(*rng.uniform(-0.1, 0.1, (n, 2))).values, rng.integers(0, 3, n))
            for n in (some, others)]  # fmt: skip
    apart = rows[0].places()[:, np.newaxis] - rows[1].places()
    near = np.hypot(apart[..., 0], apart[..., 1]) < SAME_ROBOT_M
    near &= rows[0].picture[:, np.newaxis] == rows[1].picture
    assert np.transpose(near_pairs(*rows)).tolist() == np.argwhere(near).tolist()
    single = near & (near.sum(axis=0) == 1) & (near.sum(axis=1) == 1)[:, np.newaxis]
    assert np.transpose(single_pairs(*rows)).tolist() == np.argwhere(single).tolist()
    assert are_near(*rows).tolist() == near.any(axis=1).tolist()
    assert len(join(*rows).picture) == some + (~near.any(axis=0)).sum()
