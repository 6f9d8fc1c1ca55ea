"""Boards: what the user types, what it means, and that the drawn board is that board."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import UsageError
from vsense.vision.calibration.board import (
    CHARUCO,
    CHESSBOARD,
    Board,
    CornerFinder,
    dark_cells,
    page,
    raster,
)
from vsense.vision.markers._dictionary import dictionary_name

boards = st.builds(
    lambda kind, columns, rows, mm, flags, share: Board.parse(
        ":".join(
            [kind, f"{columns}x{rows}", f"{mm}mm"]
            + (["4X4_1000", f"marker=0.{share}"] if kind == CHARUCO else [])
            + sorted(flags)
        )
    ),
    st.sampled_from((CHESSBOARD, CHARUCO)),
    st.integers(3, 12),
    st.integers(3, 12),
    st.integers(5, 500),
    st.sets(st.sampled_from(("inverted", "legacy"))),
    st.integers(50, 90),
)


@given(boards)
def test_text_of_a_board_is_that_board(board: Board) -> None:
    assert Board.parse(str(board)) == board


@given(boards)
def test_corners_are_inside_row_by_row_from_the_upper_left(board: Board) -> None:
    points = board.points_m
    assert len(points) == (board.columns - 1) * (board.rows - 1)
    grid = points.reshape(board.rows - 1, board.columns - 1, 3)
    np.testing.assert_allclose(np.diff(grid[..., 0], axis=1), board.square_m)
    np.testing.assert_allclose(np.diff(grid[..., 1], axis=0), -board.square_m)
    np.testing.assert_allclose(points.min(axis=0)[:2], board.square_m)
    np.testing.assert_allclose(points.max(axis=0)[:2], np.array(board.size_m) - board.square_m)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("chess:7x5:30mm", "expected chessboard"),
        ("chessboard:7x5", "expected chessboard"),
        ("chessboard:7:30mm", "size '7'"),
        ("chessboard:2x5:30mm", "size '2x5'"),
        ("chessboard:7x5:30", "square '30'"),
        ("chessboard:7x5:0mm", "square '0mm'"),
        ("charuco:4x5:54mm", "expected chessboard"),
        ("charuco:4x5:54mm:9X9_50", "dictionary '9X9_50'"),
        ("charuco:40x50:54mm:4X4_50", "has 50 markers"),
        ("charuco:4x5:54mm:4X4_50:upside", "'upside'"),
        ("charuco:4x5:54mm:4X4_50:marker=2", "'marker=2'"),
    ],
)
def test_wrong_text_is_refused_with_what_was_expected(text: str, said: str) -> None:
    with pytest.raises(UsageError, match=r"expected|needs") as refusal:
        Board.parse(text)
    assert said in str(refusal.value)


def test_dictionaries_have_short_names() -> None:
    assert dictionary_name("36h11") == "APRILTAG_36h11"
    assert dictionary_name("DICT_4X4_50") == "4X4_50"


@pytest.mark.parametrize(
    "text",
    [
        "charuco:7x5:40mm:4X4_50",
        "charuco:5x4:40mm:4X4_50",
        "charuco:5x4:40mm:4X4_50:legacy",
        "charuco:4x5:40mm:4X4_1000:inverted",
        "charuco:6x5:40mm:36h11:marker=0.8",
        "chessboard:7x6:30mm",
        "chessboard:7x5:30mm:inverted",
    ],
)
@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_drawn_board_is_found_where_it_was_drawn(text: str, turns: int) -> None:
    board = Board.parse(text)
    px_per_m, margin_m = 1500.0, 0.04
    image = raster(board, px_per_m, margin_m)
    height, width = image.shape
    column = (board.points_m[:, 0] + margin_m) * px_per_m - 0.5
    row = height - (board.points_m[:, 1] + margin_m) * px_per_m - 0.5
    for _ in range(turns):
        image = np.ascontiguousarray(np.rot90(image))
        column, row, width = row, width - 1.0 - column, image.shape[1]
    found = CornerFinder(board).find(image)
    assert found is not None
    ids, pixels = found
    truth = np.column_stack((column, row))[ids]
    if board.symmetric:
        half = np.column_stack((column, row))[::-1][ids]
        truth = min(truth, half, key=lambda t: float(np.abs(t - pixels).max()))
    assert len(ids) == len(board.points_m)
    assert np.abs(truth - pixels).max() < 0.1


@given(boards)
def test_half_of_a_chessboard_is_dark_and_nothing_leaves_the_board(board: Board) -> None:
    cells = dark_cells(board)
    area = (cells[:, 2] * cells[:, 3]).sum() / (board.size_m[0] * board.size_m[1])
    assert area > 0.45 if board.kind == CHESSBOARD else area > 0.4
    assert (cells[:, :2] > -1e-9).all()
    assert (cells[:, :2] + cells[:, 2:] < np.array(board.size_m) + 1e-9).all()


@given(boards)
def test_page_holds_the_board_in_its_true_size(board: Board) -> None:
    sheet = page(board)
    dark = dark_cells(board)
    extent = (dark[:, :2] + dark[:, 2:]).max(axis=0) - dark[:, :2].min(axis=0)
    corners = np.concatenate(sheet.items[-5].polygons)
    np.testing.assert_allclose(np.ptp(corners, axis=0), 1e3 * extent)
    assert (corners > 0.0).all() and (corners < (sheet.width_mm, sheet.height_mm)).all()


def test_print_on_a4_is_found_again() -> None:
    from vsense.vision.markers import _paper

    board = Board.parse("charuco:5x7:36mm:4X4_50")
    sheet = page(board)
    assert (sheet.width_mm, sheet.height_mm) == (210.0, 297.0)
    found = CornerFinder(board).find(_paper.draw(sheet, 150.0))
    assert found is not None and len(found[0]) == len(board.points_m)
    apart = np.linalg.norm(found[1][1] - found[1][0])
    assert apart == pytest.approx(36.0 / 25.4 * 150.0, abs=0.1)


def test_empty_picture_has_no_board() -> None:
    grey = np.full((240, 320), 128, np.uint8)
    for text in ("charuco:5x4:40mm:4X4_50", "chessboard:7x6:30mm"):
        assert CornerFinder(Board.parse(text)).find(grey) is None
    noise = cv2.randu(grey, 0, 255)
    assert CornerFinder(Board.parse("charuco:5x4:40mm:4X4_50")).find(noise) is None
