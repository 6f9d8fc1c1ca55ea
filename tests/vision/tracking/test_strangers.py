"""Markers read without a roster: right or not at all."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.arena import UNNAMED
from vsense.vision.markers.families import (
    BLURS_U,
    MarkerFamily,
    cell_blur,
    load_family,
    outer_light,
)
from vsense.vision.tracking._joining import could_be, unlisted_tag_reader

ARROW = load_family("arrow4x4")
THESIS = load_family("arrow4x4-thesis")
CELLS = 16


def cells_of(family: MarkerFamily, tag: int, ahead: int, left: int) -> np.ndarray:
    """Returns what a camera would see of a tag's cells."""
    a, b = family.unit_mm * BLURS_U[[ahead, left]]
    white = family.bits(tag).ravel().astype(float)
    return white @ cell_blur(family, a, b).T + outer_light(family, a, b)


def read(family: MarkerFamily, cells: np.ndarray, ahead: int, left: int) -> int:
    rows = np.array([ahead]), np.array([left])
    return int(unlisted_tag_reader(family).read(cells[np.newaxis], *rows)[0])


@given(st.integers(0, 65535), st.integers(0, 5), st.integers(0, 5))
def test_every_usable_tag_is_read_and_no_other(tag: int, ahead: int, left: int) -> None:
    usable = CELLS // 4 <= bin(tag).count("1") <= 3 * CELLS // 4
    found = read(ARROW, cells_of(ARROW, tag, ahead, left), ahead, left)
    assert found == (tag if usable else UNNAMED)


@given(
    st.sampled_from([ARROW, THESIS]),
    st.integers(0, 65535),
    st.integers(0, len(BLURS_U) - 1),
    st.floats(0.0, 0.12),
    st.integers(0, 2**32 - 1),
)
def test_noise_makes_it_silent_and_never_wrong(
    family: MarkerFamily, tag: int, blur: int, noise: float, seed: int
) -> None:
    error = np.random.default_rng(seed).normal(0.0, noise, CELLS)
    assert read(family, cells_of(family, tag, blur, blur) + error, blur, blur) in (UNNAMED, tag)


def test_the_wrong_blur_makes_it_silent_and_never_wrong() -> None:
    silent = 0
    for tag in range(4321, 65536, 977):
        for taken in (2, 6, 10):
            found = read(ARROW, cells_of(ARROW, tag, 6, 6), taken, taken)
            assert found in (UNNAMED, tag)
            silent += found == UNNAMED
    assert silent > 0


@pytest.mark.parametrize(
    ("true", "seen", "may"),
    [
        (0b1111_0000_1111_0000, 0b0000_0000_1111_0000, True),  # a dark cable across a row
        (0b1111_0000_1111_0000, 0b1111_1111_1111_0000, True),  # a light one
        (0b1111_0000_1111_0000, 0b1111_0000_1110_0001, True),  # two cells, one of each
        (0b1111_0000_1111_0000, 0b0011_0011_1111_0000, False),
        (0b1010_0101_1010_0101, 0b0101_1010_0101_1010, False),
    ],
)
def test_what_may_be_a_roster_robot_with_something_on_it(true: int, seen: int, may: bool) -> None:
    assert could_be(ARROW, true, seen) is may
