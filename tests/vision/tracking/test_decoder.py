"""Naming: without a name is acceptable, a wrong name is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.base.arena import UNNAMED
from vsense.vision.markers.families import cell_blur, load_family, normal_share, outer_light
from vsense.vision.tracking._naming import DecodedTag, Decoder
from vsense.vision.tracking._outlines import nearest_blur

ARROW = load_family("arrow4x4")
ROSTER = [31, 1843, 4334, 7167, 7488, 10084, 12689, 13103]
ROSTER += [16011, 16577, 18425, 29783, 34415, 39011, 40223, 52447]
DECODER = Decoder(ARROW, ROSTER)


blurs = st.floats(0.6, 3.5)


def seen(tags: list[int], along_mm: float, across_mm: float, lost: float = 0.0) -> np.ndarray:
    """Returns what blur makes of tags' cells, between shades that are not quite the true ones."""
    bits = np.array([ARROW.bits(tag).ravel() for tag in tags], dtype=float)
    light = bits @ cell_blur(ARROW, along_mm, across_mm).T + outer_light(ARROW, along_mm, across_mm)
    return (light - lost) / (1.0 - 2.0 * lost)


def lost(sigma_mm: float) -> float:
    """Returns how much of the contrast is not reached 0.6 units away from an edge."""
    return float(normal_share(np.array([-0.6 * ARROW.unit_mm / sigma_mm]))[0])


def sharpness(sigma_mm: float, count: int = 1) -> np.ndarray:
    """Returns what an edge gains within 0.25 units, of what it gains within 0.6."""
    near = normal_share(np.array([-0.25 * ARROW.unit_mm / sigma_mm]))[0]
    return np.full(count, (1.0 - 2.0 * near) / (1.0 - 2.0 * lost(sigma_mm)))


def read(
    tags: list[int], along_mm: float, across_mm: float, noise: np.ndarray | float = 0.0
) -> DecodedTag:
    both = 0.5 * (lost(along_mm) + lost(across_mm))
    cells = seen(tags, along_mm, across_mm, both) + noise
    return DECODER.decode(cells, sharpness(along_mm, len(tags)), sharpness(across_mm, len(tags)))


@given(st.sampled_from(ROSTER), blurs, blurs, st.integers(0, 2**32 - 1))
def test_every_tag_is_read_through_blur_and_noise(
    tag: int, along_mm: float, across_mm: float, seed: int
) -> None:
    noise = np.clip(np.random.default_rng(seed).normal(0.0, 0.03, 16), -0.1, 0.1)
    reading = read([tag], along_mm, across_mm, noise)
    assert reading.tags[0] == tag
    assert reading.error[0] < 0.12 and reading.margin[0] > 1.6
    both = 0.5 * (lost(along_mm) + lost(across_mm))
    words = seen(ROSTER, along_mm, across_mm, both)
    away = (1.0 - 2.0 * both) * np.sqrt(
        ((seen([tag], along_mm, across_mm, both) + noise - words) ** 2).mean(axis=1)
    )
    assert ROSTER[away.argmin()] == tag
    # Words are kept for blurs that are not quite these.
    assert away.min() == pytest.approx(reading.error[0], abs=0.03)


@given(st.integers(0, 65535), st.floats(0.6, 2.2), st.floats(0.6, 2.2))
@settings(max_examples=300)
def test_a_tag_that_is_not_in_the_roster_is_never_given_another_name(
    tag: int, along_mm: float, across_mm: float
) -> None:
    assert read([tag], along_mm, across_mm).tags[0] == (tag if tag in ROSTER else UNNAMED)


@given(st.lists(st.floats(-0.5, 1.5), min_size=16, max_size=16), blurs)
def test_a_name_means_that_every_cell_agrees(cells: list[float], sigma_mm: float) -> None:
    sharp = sharpness(sigma_mm)
    tag = int(DECODER.decode(np.array([cells]), sharp, sharp).tags[0])
    if tag != UNNAMED:
        word = seen([tag], sigma_mm, sigma_mm, lost(sigma_mm))[0]
        assert (np.abs(np.array(cells) - word) < 0.6).all()


@pytest.mark.parametrize("shade", [0.0, 0.3, 0.5, 0.7, 1.0])
@pytest.mark.parametrize("sigma_mm", [0.5, 1.5, 3.0])
def test_a_blank_arrow_has_no_name(shade: float, sigma_mm: float) -> None:
    sharp = sharpness(sigma_mm)
    assert DECODER.decode(np.full((1, 16), shade), sharp, sharp).tags.tolist() == [UNNAMED]


@given(st.floats(0.6, 4.0))
def test_the_blur_is_told_by_the_edges(sigma_mm: float) -> None:
    step_u = 0.04
    kept = 0.10 + step_u * nearest_blur(sharpness(sigma_mm))[0]
    assert kept == pytest.approx(sigma_mm / ARROW.unit_mm, abs=0.6 * step_u)


def test_one_tag_or_none_in_the_roster() -> None:
    cells, sharp = seen([31, 1843], 1.0, 1.0), sharpness(1.0, 2)
    assert Decoder(ARROW, [31]).decode(cells, sharp, sharp).tags.tolist() == [31, UNNAMED]
    nobody = Decoder(ARROW, []).decode(cells, sharp, sharp)
    assert nobody.tags.tolist() == [UNNAMED, UNNAMED] and nobody.error.tolist() == [1.0, 1.0]
    none = np.zeros(0)
    assert DECODER.decode(np.zeros((0, 16)), none, none).tags.shape == (0,)


@pytest.mark.parametrize("tag", [1000, 1007, 1014, 35845])
@pytest.mark.parametrize("across", [True, False])
@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("shade", [0.0, 1.0])
def test_what_lies_on_a_strange_marker_seldom_makes_it_one_of_the_roster(
    tag: int, across: bool, place: int, shade: float
) -> None:
    """A cable hides a row of cells: the nearest word explains little, and that is said."""
    family = load_family("arrow4x4-thesis")
    roster = [40152, 63846, 7764, 20600, 3206]
    decoder, sigma_mm = Decoder(family, roster), 2.4
    bits = family.bits(tag).astype(float)
    bits[place if across else slice(None), slice(None) if across else place] = shade
    light = bits.ravel() @ cell_blur(family, sigma_mm).T + outer_light(family, sigma_mm, sigma_mm)
    part = lost(sigma_mm)
    cells = (light - part) / (1.0 - 2.0 * part)
    reading = decoder.decode(cells[np.newaxis], sharpness(sigma_mm), sharpness(sigma_mm))
    if reading.tags[0] != UNNAMED:
        near = [(family.bits(known) != (bits > 0.5)).sum() for known in roster]
        assert min(near) <= 2, "so near that nobody could tell"
