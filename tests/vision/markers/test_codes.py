"""Code words under blur, and the choice of tags."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vision.markers.texture import draw_texture
from vsense.vision.markers.families import (
    FamilyError,
    MarkerFamily,
    cell_blur,
    choose_tags,
    load_family,
)

ARROW = load_family("arrow4x4")
assert isinstance(ARROW, MarkerFamily)


def code_words(tags: Iterable[int], sigma_mm: float) -> np.ndarray:
    """Returns the blurred cells of tags, (tags, cells), see `cell_blur`."""
    bits = np.array([ARROW.bits(tag).ravel() for tag in tags], dtype=float)
    return bits @ cell_blur(ARROW, sigma_mm).T


def separation(tags: Iterable[int], sigma_mm: float) -> float:
    """Returns the least squared distance between two of the tags' code words."""
    words = code_words(tags, sigma_mm)
    apart = ((words[:, np.newaxis] - words[np.newaxis]) ** 2).sum(axis=2)
    apart[np.diag_indices(len(words))] = np.inf
    return float(apart.min())


def test_without_blur_a_code_word_is_the_tag() -> None:
    words = code_words([31, 52447], 1e-3)
    bits = np.array([ARROW.bits(tag).ravel() for tag in (31, 52447)], dtype=float)
    assert words == pytest.approx(bits, abs=1e-6)


@given(st.floats(0.3, 4.0))
@settings(max_examples=20)
def test_blur_spreads_light_and_makes_none(sigma_mm: float) -> None:
    blur = cell_blur(ARROW, sigma_mm)
    assert (blur >= 0.0).all() and (blur.sum(axis=1) <= 1.0 + 1e-9).all()
    assert blur[5, 5] == blur[5].max()
    assert blur == pytest.approx(blur[::-1, ::-1])


def test_blur_agrees_with_a_blurred_drawing() -> None:
    import cv2

    tag, sigma_mm, px_per_mm = 18425, 1.5, 8.0
    drawn = draw_texture(ARROW, tag, px_per_mm)
    blurred = cv2.GaussianBlur(drawn.ink.astype(np.float32), (0, 0), sigma_mm * px_per_mm) / 255.0
    spots = (ARROW.cells_mm - ARROW.disc_centre_mm) * px_per_mm * (1, -1) + drawn.centre_px
    half = round(0.25 * ARROW.cell_mm * px_per_mm)
    seen = [
        blurred[round(y) - half : round(y) + half, round(x) - half : round(x) + half].mean()
        for x, y in spots
    ]
    assert code_words([tag], sigma_mm)[0] == pytest.approx(seen, abs=0.06)


def test_chosen_tags_are_far_apart_and_neither_dark_nor_light() -> None:
    tags = choose_tags(ARROW, 16, 2.2, seed=14)
    assert tags == sorted(set(tags)) and len(tags) == 16
    assert all(4 <= int(tag).bit_count() <= 12 for tag in tags)
    assert separation(tags, 2.2) > 6 * separation(range(1, 17), 2.2)
    turned = [int(f"{tag:016b}"[::-1], 2) for tag in tags]
    assert not set(tags) & set(turned)


def test_more_tags_than_there_are_is_an_error() -> None:
    with pytest.raises(FamilyError, match="usable"):
        choose_tags(ARROW, 65000, 2.2)
