"""Marker families: the bits, the drawing, the definitions."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vision.markers.texture import draw_texture
from vsense.config.experiment import load, shipped
from vsense.vision.markers.families import (
    FamilyError,
    MarkerFamily,
    confusion,
    known_families,
    load_family,
    ranked_tags,
)

ARROW = load_family("arrow4x4")
THESIS = load_family("arrow4x4-thesis")
families = st.sampled_from([ARROW, THESIS])


@given(families, st.integers(0, 65535))
def test_bits_are_the_tag_in_binary(family: MarkerFamily, tag: int) -> None:
    bits = family.bits(tag)
    assert sum(int(bit) << k for k, bit in enumerate(bits.ravel())) == tag


@given(families, st.integers(0, 65535))
def test_each_cell_is_drawn_where_its_bit_says(family: MarkerFamily, tag: int) -> None:
    white = family.is_white(tag, family.cells_mm)
    assert white.reshape(4, 4).tolist() == family.bits(tag).tolist()


def test_row_zero_is_at_the_tip_and_column_zero_at_the_left() -> None:
    first, last = ARROW.cells_mm[0], ARROW.cells_mm[15]
    assert first == pytest.approx((1.5 * 5.3, 1.5 * 5.3))
    assert last == pytest.approx((-1.5 * 5.3, -1.5 * 5.3))
    assert ARROW.cells_mm[3] == pytest.approx((1.5 * 5.3, -1.5 * 5.3))


def test_the_outline_is_black_inside_and_white_outside() -> None:
    just = 0.05
    inside = np.array([[-3 + just, 0], [6 - just, 0], [0, 3 - just], [3, -3 + just]]) * 5.3
    outside = np.array([[-3 - just, 0], [6 + just, 0], [0, 3 + just], [4.6, 1.5]]) * 5.3
    assert not ARROW.is_white(0, inside).any()
    assert ARROW.is_white(0, outside).all()
    assert ARROW.disc_centre_mm == pytest.approx((1.5 * 5.3, 0.0))


def test_the_texture_shows_the_marker_from_above() -> None:
    drawn = draw_texture(ARROW, 31, 4.0)
    middle = round(drawn.centre_px)

    def ink(x_mm: float, y_mm: float) -> int:
        offset = (np.array([x_mm, y_mm]) - ARROW.disc_centre_mm) * drawn.px_per_mm
        return int(drawn.ink[round(middle - offset[1]), round(middle + offset[0])])

    for cell, bit in zip(ARROW.cells_mm, ARROW.bits(31).ravel(), strict=True):
        assert ink(*cell) == (255 if bit else 0)
    assert ink(4.5 * 5.3, 0.0) == 0
    assert drawn.coverage[middle, middle] == 255 and drawn.coverage[0, 0] == 0
    share = drawn.coverage.mean() / 255.0 * drawn.coverage.size / drawn.px_per_mm**2
    assert share == pytest.approx(np.pi * 35.0**2, rel=2e-3)


@pytest.mark.parametrize("tag", [-1, 65536])
def test_a_tag_that_the_family_does_not_have_is_refused(tag: int) -> None:
    with pytest.raises(FamilyError, match="0 to 65535"):
        ARROW.bits(tag)


def test_an_unknown_family_lists_the_known_ones() -> None:
    assert known_families() == ("apriltag_36h11", "arrow4x4", "arrow4x4-thesis", "aruco_4x4_50")
    with pytest.raises(FamilyError, match="'arrow4x4'"):
        load_family("arow")
    with pytest.raises(FamilyError, match=r"nowhere\.json"):
        load_family("nowhere.json")


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"unit_mm": 0}, "positive"),
        ({"disc_diameter_mm": "nan"}, "positive"),
        ({"grid": 9}, "grid"),
        ({"cell_mm": "big"}, "big"),
        ({"polygon_u": [[-3, -3], [-3, 3], [6, 0]]}, "counter-clockwise"),
        ({"polygon_u": [[-3, -3], [3, -3], [30, 0], [3, 3], [-3, 3]]}, "rim"),
        ({"disc_centre_u": []}, "list index"),
        ({"name": None, "unit_mm": None}, "NoneType"),
        ({"polygon_u": [[-3, -3], [1e308, -3], [3, 3]]}, "too large"),
        ({"disc_centre_u": [1e308, 0]}, "too large"),
    ],
)
def test_a_broken_definition_is_named(
    tmp_path: Path, change: dict[str, object], complaint: str
) -> None:
    good = {
        "name": "mine",
        "unit_mm": 5.3,
        "cell_mm": 5.3,
        "grid": 4,
        "polygon_u": [[-3, -3], [3, -3], [6, 0], [3, 3], [-3, 3]],
        "disc_diameter_mm": 70.0,
        "disc_centre_u": [1.5, 0],
    }
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(good))
    assert load_family(str(file)).name == "mine"
    file.write_text(json.dumps(good | change))
    with pytest.raises(FamilyError, match=complaint):
        load_family(str(file))
    file.write_bytes(b"\xc8{}")
    with pytest.raises(FamilyError, match="is no text"):
        load_family(str(file))
    file.write_text("{\n\n!")
    with pytest.raises(FamilyError, match=r"mine\.json:3"):
        load_family(str(file))


@pytest.mark.parametrize(
    ("tags", "words"),
    [
        ([30, 4096, 31], "tags 30 and 31 differ in one cell:"),
        ([1, 1 << 15], "tags 1 and 32768 differ in one cell:"),  # half a turn
        ([1, 3 << 14], "tags 1 and 49152 differ in one cell:"),
        ([1, 2, 3], "tags 1 and 3 differ in one cell (2 such pairs):"),
        ([7, 8], ""),
        ([12, 12], ""),
    ],
)
def test_tags_that_differ_in_one_cell_are_named(tags: list[int], words: str) -> None:
    said = confusion(load_family("arrow4x4"), tags)
    assert said.startswith(words) and bool(said) == bool(words)


def test_chosen_and_shipped_tags_differ_in_more() -> None:
    arrows = load_family("arrow4x4")
    assert confusion(arrows, ranked_tags(arrows, 128)) == ""
    assert confusion(load_family("aruco_4x4_50"), range(50)) == ""
    for name in shipped():
        experiment = load(name)
        tags = [body.tag for body in (*experiment.robots, *experiment.objects)]
        assert confusion(arrows, tags) == "", name
