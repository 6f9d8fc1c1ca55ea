"""Masks: distances by hand, nothing outside, and inside the same bits as without."""

from __future__ import annotations

import numpy as np
import pytest

from tests.vision.tracking.synthetic import Look, Robot, render
from vsense.base.arena import Frame
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._prediction import MarkerSearch, SearchPlan
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.mask import Mask, MaskError, blocks_of, outlines_px
from vsense.world.entities import Arena

SQUARE = Mask(((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)), 0.1)
ANGLE = Mask(((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)), 0.0)


@pytest.mark.parametrize(
    ("mask", "place", "away_m"),
    [
        (SQUARE, (1.0, 0.5), 0.0),
        (SQUARE, (2.3, 0.5), 0.3),
        (SQUARE, (2.3, 1.4), 0.5),
        (SQUARE, (-0.05, 0.5), 0.05),
        (ANGLE, (1.5, 1.5), 0.5),
        (ANGLE, (0.5, 1.5), 0.0),
        (ANGLE, (1.25, 1.5), 0.25),
        (SQUARE, (np.nan, 0.5), np.inf),
    ],
)
def test_distance_to_an_outline(mask: Mask, place: tuple[float, float], away_m: float) -> None:
    assert mask.distance_m(np.array([place]))[0] == pytest.approx(away_m)
    turned = Mask(mask.outline_m[::-1], mask.margin_m)
    assert turned.distance_m(np.array([place]))[0] == pytest.approx(away_m)


def test_the_margin_counts() -> None:
    places = np.array([(2.09, 0.5), (2.11, 0.5), (2.08, 1.08)])
    assert SQUARE.keeps(places).tolist() == [True, False, False]


def test_an_arena_is_an_outline() -> None:
    corners = Arena((3.0, 2.0, 1.0), (1.0, -1.0, 0.5)).corners_m
    assert corners == ((-0.5, -2.0), (2.5, -2.0), (2.5, 0.0), (-0.5, 0.0))
    assert Mask(corners).keeps(np.array([(2.54, 0.0), (2.56, 0.0)])).tolist() == [True, False]


def test_what_is_drawn_is_what_is_kept() -> None:
    camera = Camera.looking_down("c", 0.3, 0.1, 2.4, 500.0, (500, 380))
    (polygon,) = outlines_px(SQUARE, camera, 0.0)
    places = camera.to_plane(np.array(polygon), 0.0)
    # Within a step of drawing, the polygon lies on the margin or on the picture's border.
    on_border = ~camera.contains(np.array(polygon), 4.0)
    assert SQUARE.distance_m(places)[~on_border] == pytest.approx(0.09, abs=0.025)
    (triangle,) = outlines_px(Mask(((0.3, 0.1), (0.4, 0.1), (0.35, 0.2)), 0.0), camera, 0.0)
    assert len(triangle) >= 3
    assert outlines_px(Mask(((9.0, 9.0), (9.5, 9.0), (9.5, 9.5))), camera, 0.0) == []


@pytest.mark.parametrize(
    ("outline", "margin_m", "said"),
    [
        (((0.0, 0.0), (1.0, 0.0)), 0.1, "2 corners.*3"),
        (((0.0, 0.0), (1.0, 0.0), (2.0, 0.0)), 0.1, "enclose nothing"),
        (((0.0, 0.0), (1.0, 0.0), (np.nan, 1.0)), 0.1, "not a number"),
        (((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), -0.1, "not a number"),
    ],
)
def test_what_is_no_outline(
    outline: tuple[tuple[float, float], ...], margin_m: float, said: str
) -> None:
    with pytest.raises(MaskError, match=said):
        Mask(outline, margin_m)


def test_no_block_with_a_piece_of_a_marker_that_counts_is_skipped() -> None:
    camera = Camera.looking_down(
        "c", 0.3, 0.1, 2.4, 500.0, (500, 380), (-0.12, 0.02, 0.0, 0.0, 0.0)
    )
    mask, reach_m = Mask(((0.0, 0.0), (0.6, 0.1), (0.5, 0.5), (0.1, 0.4)), 0.05), 0.04
    outside, inside = blocks_of(mask, camera, 0.06, reach_m)
    assert outside.shape == (24, 32) and 0.2 < outside.mean() < 0.95
    assert 0.0 < inside.mean() < 0.5
    rows, columns = np.indices((380, 500))
    pixels = np.stack((columns, rows), axis=-1).reshape(-1, 2).astype(float)
    kept = mask.keeps(camera.to_plane(pixels, 0.06)).reshape(380, 500)
    assert kept[np.kron(inside, np.ones((16, 16), dtype=bool))[:380, :500] != 0].all()
    rng = np.random.default_rng(3)
    places = rng.uniform((-0.2, -0.2), (0.8, 0.8), (4000, 2))
    places = places[mask.keeps(places)]
    for angle in np.linspace(0.0, 2.0 * np.pi, 9):
        rim = places + reach_m * np.array((np.cos(angle), np.sin(angle)))
        at_px = camera.project(np.column_stack((rim, np.full(len(rim), 0.06))))
        column, row = (np.rint(at_px[camera.contains(at_px)]).astype(int) // 16).T
        assert not outside[row, column].any()


FAMILY = load_family("arrow4x4")
TAGS = (31, 1843, 7167, 52447)
TOP = Camera.looking_down("top", 0.0, 0.0, 2.43, 1620.0, (800, 600), (-0.12, 0.02, 0.0, 0.0, 0.0))
HEIGHT_M = 0.06
ROBOTS = [
    Robot(31, -0.2, 0.1, 0.3), Robot(1843, 0.1, -0.1, 2.0), Robot(7167, 0.42, 0.3, 1.0),
    Robot(52447, -0.45, -0.3, 4.0),
]  # fmt: skip
MASK = Mask(((-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)), 0.05)


@pytest.mark.parametrize("plan", [SearchPlan(), SearchPlan(3, 0.14), SearchPlan(3, 0.14, True)])
def test_nothing_is_detected_outside_and_inside_the_bits_are_the_same(plan: SearchPlan) -> None:
    frames = []
    for step in range(4):
        image = render(TOP, FAMILY, ROBOTS, Look(litter=4), step, HEIGHT_M)
        frames.append(Frame("top", image, step, 10**8 * step, 10**8 * step))
    heights = dict.fromkeys(TAGS, HEIGHT_M)
    found = {}
    for mask in (None, MASK):
        search = MarkerSearch(FAMILY, heights, open_roster=False, mask=mask)
        tracker = ArenaTracker.of_searches([TOP], [search], plan=plan, workers=1)
        found[mask] = [tracker.update([frame]).robots for frame in frames]
        tracker.close()
    for everywhere, inside in zip(found[None], found[MASK]):
        assert everywhere["tag"].tolist() == sorted(TAGS) and inside["tag"].tolist() == [31, 1843]
        same = everywhere[np.isin(everywhere["tag"], inside["tag"])]
        assert same.tobytes() == inside.tobytes()


def test_a_robot_that_leaves_is_followed_no_farther() -> None:
    search = MarkerSearch(FAMILY, {31: HEIGHT_M}, open_roster=False, mask=MASK)
    tracker = ArenaTracker.of_searches([TOP], [search], workers=1)
    seen = []
    for step in range(8):
        robot = Robot(31, 0.3 + 0.012 * step, 0.0, 0.0)
        image = render(TOP, FAMILY, [robot], Look(litter=0), 1, HEIGHT_M)
        state = tracker.update([Frame("top", image, step, 10**8 * step, 10**8 * step)])
        seen.append(state.detected)
    tracker.close()
    # Its place is up to 0.35, 0.05 beyond the outline, in the first five.
    assert seen == [1, 1, 1, 1, 1, 0, 0, 0]
