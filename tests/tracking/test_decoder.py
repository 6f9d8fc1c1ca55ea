"""Naming: without a name is acceptable, a wrong name is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.arena import UNNAMED
from vsense.tracking.codes import code_words
from vsense.tracking.decoder import Decoder
from vsense.tracking.families import load_family

ARROW = load_family("arrow4x4")
ROSTER = [31, 1843, 4334, 7167, 7488, 10084, 12689, 13103]
ROSTER += [16011, 16577, 18425, 29783, 34415, 39011, 40223, 52447]
DECODER = Decoder(ARROW, ROSTER)


@given(st.sampled_from(ROSTER), st.floats(0.1, 2.4), st.integers(0, 2**32 - 1))
def test_every_tag_is_read_through_blur_and_noise(tag: int, sigma_mm: float, seed: int) -> None:
    word = code_words(ARROW, [tag], sigma_mm)
    noise = np.clip(np.random.default_rng(seed).normal(0.0, 0.03, 16), -0.1, 0.1)
    tags, error, margin = DECODER.decode(word + noise)
    assert tags[0] == tag
    assert error[0] < 0.15 < margin[0]


@given(st.integers(0, 65535), st.floats(0.1, 1.6))
@settings(max_examples=300)
def test_a_tag_that_is_not_in_the_roster_is_never_given_another_name(
    tag: int, sigma_mm: float
) -> None:
    tags, _, _ = DECODER.decode(code_words(ARROW, [tag], sigma_mm))
    assert tags[0] == (tag if tag in ROSTER else UNNAMED)


@given(st.lists(st.floats(-0.5, 1.5), min_size=16, max_size=16))
def test_a_name_means_that_every_cell_agrees(cells: list[float]) -> None:
    tags, _, _ = DECODER.decode(np.array([cells]))
    if tags[0] != UNNAMED:
        bits = ARROW.bits(int(tags[0])).ravel()
        assert (np.abs(np.array(cells) - bits) < 0.95).all()


@pytest.mark.parametrize("shade", [0.0, 0.3, 0.5, 0.7, 1.0])
def test_a_blank_arrow_has_no_name(shade: float) -> None:
    assert DECODER.decode(np.full((1, 16), shade))[0].tolist() == [UNNAMED]


def test_one_tag_or_none_in_the_roster() -> None:
    word = code_words(ARROW, [31, 1843], 1.0)
    assert Decoder(ARROW, [31]).decode(word)[0].tolist() == [31, UNNAMED]
    assert Decoder(ARROW, []).decode(word)[0].tolist() == [UNNAMED, UNNAMED]
    assert DECODER.decode(np.zeros((0, 16)))[0].shape == (0,)
