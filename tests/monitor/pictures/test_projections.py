"""Places are in a camera's picture where OpenCV projects them, and nowhere where it cannot be."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.monitor.pictures._projections import FromAbove, ThroughLens
from vsense.vision.cameras.camera import Camera

MIDDLE = np.array([0.3, -0.2])
WIDTH = 800


def camera(lens: tuple[float, ...] = (-0.25, 0.07, 1e-3, -2e-3, 0.01)) -> Camera:
    """One that looks askew at the arena's middle."""
    turn = cv2.Rodrigues(np.array([np.pi - 0.12, 0.05, 0.3]))[0]
    return Camera("c", 1600, 1200, 1300.0, 1320.0, 805.0, 590.0, lens, tuple(turn.ravel()),
                  (0.4, -0.3, 2.4))  # fmt: skip


def by_opencv(points: np.ndarray, seen_by: Camera) -> np.ndarray:
    """Pixels of a picture of WIDTH columns, of places around the arena's middle."""
    turn = np.reshape(seen_by.rotation, (3, 3))
    move = -turn @ np.array(seen_by.position_m)
    matrix = np.array([[seen_by.fx_px, 0, seen_by.cx_px], [0, seen_by.fy_px, seen_by.cy_px],
                       [0, 0, 1.0]])  # fmt: skip
    places = np.asarray(points, float) + np.array([*MIDDLE, 0.0])
    lens = np.array(seen_by.distortion)
    pixels = cv2.projectPoints(places, cv2.Rodrigues(turn)[0], move, matrix, lens)[0][:, 0]
    return np.asarray((pixels + 0.5) * WIDTH / seen_by.width_px - 0.5)


def edge(corners: np.ndarray) -> np.ndarray:
    """Many points along the outline of an area."""
    ends = np.roll(corners, -1, axis=0)
    return np.concatenate([np.linspace(a, b, 400, endpoint=False) for a, b in zip(corners, ends)])


@settings(max_examples=30)
@given(st.tuples(st.floats(-0.5, 0.5), st.floats(-0.4, 0.4), st.floats(0.0, 0.4)))
def test_a_spot_is_where_opencv_projects_it(place: tuple[float, float, float]) -> None:
    found = ThroughLens(camera(), WIDTH, MIDDLE).spot(np.array(place))
    assert found is not None
    wanted = by_opencv(np.array([place]), camera())[0]
    assert found[0] == pytest.approx(wanted, abs=1e-9)
    beside = by_opencv(np.array(place) + 0.001 * np.eye(3)[:2], camera()) - wanted
    area = abs(np.linalg.det(beside)) ** 0.5 / 0.001
    assert found[1] == pytest.approx(area, rel=0.01)


def test_an_area_is_bent_with_the_lens_and_cut_where_the_picture_ends() -> None:
    view = ThroughLens(camera(), WIDTH, MIDDLE)
    inside = np.array([[-0.5, -0.3, 0.0], [0.4, -0.4, 0.0], [0.45, 0.35, 0.1], [-0.4, 0.3, 0.1]])
    across = np.array([[-0.2, -0.1, 0.0], [2.0, -0.1, 0.0], [2.0, 0.4, 0.0], [-0.2, 0.4, 0.0]])
    for corners in (inside, across):
        masks = []
        for outline in (view.area(corners), by_opencv(edge(corners), camera())):
            mask = np.zeros((600, WIDTH), np.uint8)
            cv2.fillPoly(mask, [np.rint(outline * 16).astype(np.int32)], 1, shift=4)
            masks.append(mask.astype(bool))
        assert masks[0].sum() > 20_000
        assert (masks[0] ^ masks[1]).sum() < 0.003 * masks[0].sum()


def test_the_pieces_of_a_line_lie_on_it_and_end_beyond_the_border() -> None:
    view = ThroughLens(camera(), WIDTH, MIDDLE)
    ends = np.array([[-3.0, 0.2, 0.0], [3.0, 0.3, 0.0]])
    (piece,) = view.line(ends)
    curve = by_opencv(np.linspace(*ends, 8000), camera())
    visible = piece[(piece[:, 0] > 0) & (piece[:, 0] < WIDTH)]
    assert len(visible) > 100
    assert max(np.hypot(*(curve - point).T).min() for point in visible) < 0.5
    assert piece[:, 0].min() < -1 and piece[:, 0].max() > WIDTH
    assert np.abs(piece).max() < 3 * WIDTH, "and not far outside"


def test_nothing_behind_a_camera_is_seen() -> None:
    view = ThroughLens(camera(), WIDTH, MIDDLE)
    above = np.array([[-0.3, -0.3, 4.0], [0.3, -0.3, 4.0], [0.0, 0.3, 4.0]])
    assert view.spot(above[0]) is None
    assert len(view.area(above)) == 0 and view.line(above, closed=True) == []
    # A tall box goes from the floor to behind the camera: its post has an end.
    (post,) = view.line(np.array([[0.2, 0.1, 0.0], [0.2, 0.1, 9.0]]))
    assert np.isfinite(post).all()


def test_a_lens_that_folds_back_shows_nothing_twice() -> None:
    folding = camera((-0.5, 0.0, 0.0, 0.0, 0.0))
    # r (1 - 0.5 r^2) rises up to r = sqrt(2 / 3).
    assert folding.window_radius() == pytest.approx((2.0 / 3.0) ** 0.5, abs=0.011)
    view = ThroughLens(folding, WIDTH, MIDDLE)
    far = np.array([3.2, -0.1, 0.0])
    back = by_opencv(far[None], folding)[0]
    assert 0 < back[0] < WIDTH and 0 < back[1] < 600, "OpenCV's model shows it inside"
    assert view.spot(far) is None and view.line(np.stack((far, far + 0.1))) == []


@pytest.mark.parametrize("scale", [1, 2])
def test_what_is_spread_on_the_floor_lies_where_it_is(scale: int) -> None:
    view = ThroughLens(camera(), WIDTH, MIDDLE)
    raster = np.zeros((240, 300, 4), np.uint8)
    raster[60:64, 198:202] = 255  # around x = 0.5, y = 0.58 of an arena of 3 x 2.4 m
    laid = view.spread(raster, np.array([3.0, 2.4]), True, scale)
    assert laid.shape == (600 * scale, WIDTH * scale, 4)
    rows, columns = np.nonzero(laid[..., 3] > 127)
    wanted = by_opencv(np.array([[0.5, 0.58, 0.0]]), camera())[0]
    found = np.array([columns.mean(), rows.mean()])
    assert (found + 0.5) / scale - 0.5 == pytest.approx(wanted, abs=0.7)


def test_from_above_y_points_up() -> None:
    view = FromAbove(np.array([3.0, 2.0]), 600)
    assert view.size_px == (600, 400)
    assert view.spot(np.array([1.5, 1.0, 0.3]))[0].tolist() == [600.0, 0.0]
    assert view.area(np.zeros((1, 3))).tolist() == [[300.0, 200.0]]
