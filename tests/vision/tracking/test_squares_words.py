"""Reading cells: every word in every turn, under blur, light and noise; and nothing by chance.

The same in C runs under the sanitizers: `tests/c/test_words.c`.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.vision.markers._dictionary import Codes, FamilyError, load_codes
from vsense.vision.tracking._squares_words import WordReader, _under_blur, project_squares

CODES = load_codes("DICT_4X4_50")
READER = WordReader(CODES)
CELL_PX, EDGE = 12, 3


def picture(tag: int) -> np.ndarray:
    """Returns an upright marker, black 40 on white 200, with three cells of white around it."""
    framed = np.pad(np.pad(CODES.bits()[tag], 1), EDGE, constant_values=True)
    fine = np.kron(framed, np.ones((CELL_PX, CELL_PX)))
    return (40.0 + 160.0 * fine).astype(np.uint8)


def corners(turn: int) -> np.ndarray:
    low, high = EDGE * CELL_PX - 0.5, (EDGE + 6) * CELL_PX - 0.5
    quad = np.array([[low, low], [high, low], [high, high], [low, high]])
    return np.roll(quad, -turn, axis=0)[np.newaxis]


@given(
    st.integers(0, 49), st.integers(0, 3), st.floats(0.05, 0.6), st.floats(-0.4, 0.4), st.booleans()
)
@settings(max_examples=60)
def test_every_marker_is_read_in_every_turn(
    tag: int, turn: int, blur: float, slope: float, covered: bool
) -> None:
    image = cv2.GaussianBlur(picture(tag), (0, 0), blur * CELL_PX).astype(float)
    light = 1.0 + slope * np.linspace(-0.5, 0.5, image.shape[1])
    cells = READER.cells(np.clip(image * light, 0, 255).astype(np.uint8), corners(turn))
    if covered:
        cells.reshape(8, 8)[[0, -1]] = 40.0  # the white around it is not needed
    read = READER.read(cells, np.array([[blur, blur]]))
    assert read["sure"][0] and read["tag"][0] == tag
    assert (turn - read["turn"][0]) % 4 == 0 or (turn + read["turn"][0]) % 4 == 0
    upright = corners(turn)[0][(np.arange(4) - read["turn"][0]) % 4]
    assert upright.tolist() == corners(0)[0].tolist()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_chance_is_not_believed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = READER.cells(picture(0), corners(0)).shape[1]
    cells = 120.0 + 80.0 * rng.standard_normal((40, count))
    assert not READER.read(cells, rng.uniform(0.0, 1.5, (40, 2)))["sure"].any()


@pytest.mark.parametrize(
    "dictionary", ["DICT_APRILTAG_16h5", "DICT_5X5_1000", "DICT_APRILTAG_36h11", "DICT_7X7_50"]
)
def test_dictionaries_of_every_size_are_read(dictionary: str) -> None:
    codes = load_codes(dictionary)
    reader = WordReader(codes)
    for tag in range(0, len(codes.words), 7):
        framed = np.pad(np.pad(codes.bits()[tag], 1), 1, constant_values=True)
        cells = 40.0 + 160.0 * np.rot90(framed, tag % 4)
        read = reader.read(cells.reshape(1, -1), np.array([[0.1, 0.1]]))
        assert read["sure"][0] and read["tag"][0] == tag and read["turn"][0] == tag % 4
        assert read["error"][0] < 0.05 and read["margin"][0] > 5.0


def test_markers_with_more_cells_than_a_word_has_bits_are_refused() -> None:
    large = Codes("large", 9, (5, 6), 0)
    with pytest.raises(FamilyError, match=r"large: 9 x 9.*8 x 8"):
        WordReader(large)


def test_even_cells_are_not_read() -> None:
    cells = np.full((3, READER.cells(picture(0), corners(0)).shape[1]), 90.0)
    assert not READER.read(cells, np.zeros((3, 2)))["sure"].any()


@given(st.integers(0, 2**32 - 1))
def test_the_unit_square_is_mapped_as_opencv_maps_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    quad = 100.0 * square + rng.uniform(-25.0, 25.0, (4, 2))
    points = rng.uniform(0.0, 1.0, (7, 2))
    matrix = cv2.getPerspectiveTransform(square.astype(np.float32), quad.astype(np.float32))
    expected = cv2.perspectiveTransform(points[np.newaxis], matrix)[0]
    assert project_squares(quad[np.newaxis], points)[0] == pytest.approx(expected, abs=1e-3)
    assert project_squares(quad[np.newaxis], square)[0] == pytest.approx(quad, abs=1e-9)


@pytest.mark.parametrize("around", [True, False])
def test_lengths_of_words_are_those_of_their_blurred_pictures_without_a_slope(around: bool) -> None:
    """By the definition, a picture at a time: of all cells but the four corners, or of the inner
    ones, what no plane of light explains."""
    random, side, span = np.random.default_rng(3), 4, 6
    dark = -random.integers(0, 2, (4 * 3, side, side)).astype(np.float32)
    lines = [random.uniform(0.0, 1.0, (span, side)) for _ in range(2)]
    per_length, _ = _under_blur(dark, lines, around)
    at_edge = np.isin(np.arange(span), (0, span - 1)).astype(int)
    at_edges = np.add.outer(at_edge, at_edge)
    used = (at_edges < 2) if around else (at_edges == 0)
    rows, columns = np.nonzero(used)
    plane = np.stack((np.ones(len(rows)), rows, columns), axis=1)
    expected = []
    for u in range(2):
        for v in range(2):
            for word in dark[::4]:
                seen = (lines[v] @ word @ lines[u].T)[used]
                fit = plane @ np.linalg.lstsq(plane, seen, rcond=None)[0]
                expected.append(1.0 / np.linalg.norm(seen - fit))
    assert per_length.ravel().tolist() == pytest.approx(expected, rel=1e-4)
