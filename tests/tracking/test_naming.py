"""Names along the tracks: one bad picture changes nothing, and no wrong name comes of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.arena import UNNAMED
from vsense.markers.codes import cell_blur
from vsense.markers.families import load_family
from vsense.tracking.decoder import DecodedTag, Decoder
from vsense.tracking.naming import carry_names, gather_evidence
from vsense.tracking.prediction import EXPECTED, Prediction

ARROW = load_family("arrow4x4")
ROSTER = np.array([31, 1843, 4334], dtype=np.int32)
NOBODY = np.array([UNNAMED], dtype=np.int32)
HERE = np.array([(0.0, 0.0)])


def reading(*distance: float) -> DecodedTag:
    rows = np.array([distance])
    return DecodedTag(NOBODY, rows.min(axis=1), np.ones(1), rows)


def expected(*robots: tuple[int, float, bool]) -> np.ndarray:
    rows = [(tag, x_m, 0.0, 0.0, sure, 0.06) for tag, x_m, sure in robots]
    return np.array(rows, dtype=EXPECTED)


def carry(tags: np.ndarray, read: DecodedTag, robots: np.ndarray) -> list[int]:
    return carry_names(tags, read, ROSTER, HERE, robots).tolist()


def test_a_blurred_marker_keeps_its_name() -> None:
    assert carry(NOBODY, reading(0.2, 0.18, 0.5), expected((31, 0.01, True))) == [31]


def test_not_where_the_cells_speak_against_it() -> None:
    assert carry(NOBODY, reading(0.5, 0.1, 0.5), expected((31, 0.01, True))) == [UNNAMED]


def test_not_where_the_robot_is_not_sure_to_be() -> None:
    assert carry(NOBODY, reading(0.1, 0.2, 0.5), expected((31, 0.01, False))) == [UNNAMED]
    assert carry(NOBODY, reading(0.1, 0.2, 0.5), expected((31, 0.04, True))) == [UNNAMED]


def test_not_where_two_robots_may_be_meant() -> None:
    two = expected((31, 0.01, True), (1843, -0.01, True))
    assert carry(NOBODY, reading(0.1, 0.2, 0.5), two) == [UNNAMED]


def test_not_twice_in_one_picture() -> None:
    tags = np.array([31, UNNAMED], dtype=np.int32)
    read = DecodedTag(tags, np.zeros(2), np.ones(2), np.full((2, 3), 0.1))
    places = np.array([(0.5, 0.0), (0.0, 0.0)])
    named = carry_names(tags, read, ROSTER, places, expected((31, 0.0, True)))
    assert named.tolist() == [31, UNNAMED]


def test_another_name_than_that_of_the_robot_that_must_be_there_is_not_believed() -> None:
    wrong = np.array([1843], dtype=np.int32)
    assert carry(wrong, reading(0.3, 0.1, 0.5), expected((31, 0.0, True))) == [UNNAMED]
    assert carry(wrong, reading(0.3, 0.1, 0.5), expected((31, 0.0, False))) == [1843]


@given(st.sampled_from([31, 1843, 4334]), st.integers(0, 2**32 - 1))
def test_evidence_over_pictures_names_what_no_single_one_does(tag: int, seed: int) -> None:
    decoder, known = Decoder(ARROW, ROSTER.tolist()), Prediction()
    word = ARROW.bits(tag).ravel().astype(float) @ cell_blur(ARROW, 1.2).T
    rng = np.random.default_rng(seed)
    sharp = np.array([0.75])
    named = UNNAMED
    for step in range(40):
        known.capture_ns = step * 66_000_000
        cells = (word + rng.normal(0.0, 0.3, 16))[np.newaxis]
        tags = gather_evidence(
            NOBODY, cells, (sharp, sharp), HERE + 0.005 * step, "a", known, decoder
        )
        assert tags[0] in (UNNAMED, tag)
        named = tags[0]
    assert named == tag


def test_evidence_is_not_carried_over_a_gap_or_a_jump() -> None:
    decoder, known = Decoder(ARROW, ROSTER.tolist()), Prediction()
    cells, sharp = np.full((1, 16), 0.5), np.array([0.75])
    for step, (time_ns, x_m) in enumerate([(0, 0.0), (66, 0.0), (132, 0.2), (932, 0.2)]):
        known.capture_ns = time_ns * 1_000_000
        gather_evidence(NOBODY, cells, (sharp, sharp), HERE + x_m, "a", known, decoder)
        assert known.anonymous["a"].pictures.tolist() == [2 if step == 1 else 1]


@pytest.mark.parametrize("count", [0, 2])
def test_nothing_expected_changes_nothing(count: int) -> None:
    tags = np.arange(count, dtype=np.int32)
    read = DecodedTag(tags, np.zeros(count), np.ones(count), np.zeros((count, 3)))
    named = carry_names(tags, read, ROSTER, np.zeros((count, 2)), expected())
    assert named.tolist() == tags.tolist()
