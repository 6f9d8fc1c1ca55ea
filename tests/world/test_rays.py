"""Lines of light and sight: the C kernel against brute force, and the arena's symmetries."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.rigs.lines import NOBODY, blocked, in_sight, nearest
from vsense.base.native import WireError
from vsense.world.entities import Box, Cylinder
from vsense.world.rays import BODY, Bodies, disc_rows, entity_rows

Floats = NDArray[np.float64]
Rows = NDArray[np.void]

MARGIN_M = 1e-7
"""Bodies larger or smaller by this decide what is too close to call."""


def brute_force(starts: Floats, ends: Floats, rows: Rows, skip: NDArray[np.int32]) -> Floats:
    """Share of each line up to its first touch, by every pair of line and body."""
    found = np.full(len(starts), np.inf)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for number, body in enumerate(rows):
            enter, leave = np.zeros(len(starts)), np.ones(len(starts))
            slabs = [(starts[:, 2], ends[:, 2], body["z_low_m"], body["z_high_m"])]
            x, y = starts[:, 0] - body["x_m"], starts[:, 1] - body["y_m"]
            far_x, far_y = ends[:, 0] - body["x_m"], ends[:, 1] - body["y_m"]
            if body["radius_m"] > 0.0:
                first, last = chord(x, y, far_x - x, far_y - y, float(body["radius_m"]))
                enter, leave = np.maximum(enter, first), np.minimum(leave, last)
            else:
                c, s = body["cosine"], body["sine"]
                half_x, half_y = body["half_x_m"], body["half_y_m"]
                slabs.append((x * c + y * s, far_x * c + far_y * s, -half_x, half_x))
                slabs.append((y * c - x * s, far_y * c - far_x * s, -half_y, half_y))
            for start, end, low, high in slabs:
                one, other = (low - start) / (end - start), (high - start) / (end - start)
                inside = (start >= low) & (start <= high)
                still = start == end
                first = np.where(still, np.where(inside, -np.inf, np.inf), np.minimum(one, other))
                last = np.where(still, np.where(inside, np.inf, -np.inf), np.maximum(one, other))
                enter, leave = np.maximum(enter, first), np.minimum(leave, last)
            there = body["z_high_m"] >= body["z_low_m"]
            met = there & (enter <= leave) & ~(skip == number).any(axis=1)
            found = np.where(met, np.minimum(found, enter), found)
    return found


def chord(x: Floats, y: Floats, dx: Floats, dy: Floats, radius: float) -> tuple[Floats, Floats]:
    """Where lines, without ends, are in a circle round the origin: the quadratic's two roots."""
    a, b, c = dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - radius * radius
    root = np.sqrt(b * b - a * c)
    upright = np.where(c <= 0.0, np.inf, -np.inf)
    met = b * b - a * c >= 0.0
    first = np.where(a == 0.0, -upright, np.where(met, (-b - root) / a, np.inf))
    last = np.where(a == 0.0, upright, np.where(met, (-b + root) / a, -np.inf))
    return first, last


def grown(rows: Rows, by_m: float) -> Rows:
    """The same bodies, a little larger or smaller to all sides."""
    other = rows.copy()
    there = rows["z_high_m"] >= rows["z_low_m"]
    other["z_low_m"][there] -= by_m
    other["z_high_m"][there] += by_m
    round_ = rows["radius_m"] > 0.0
    other["radius_m"][round_] += by_m
    for name in ("half_x_m", "half_y_m"):
        other[name][~round_] += by_m
    return other


def agree(starts: Floats, ends: Floats, rows: Rows, skip: NDArray[np.int32]) -> int:
    """Holds the kernel between bodies a little larger and a little smaller; counts what is hit."""
    bodies = Bodies(rows)
    shares = nearest(starts, ends, bodies, skip)
    early = brute_force(starts, ends, grown(rows, MARGIN_M), skip)
    late = brute_force(starts, ends, grown(rows, -MARGIN_M), skip)
    assert (shares >= early - 1e-12).all() and (shares <= late + 1e-12).all()
    hit = blocked(starts, ends, bodies, skip)
    assert np.array_equal(hit, np.isfinite(shares))
    return int(hit.sum())


PLACE = st.floats(-3, 3)
BODIES = st.lists(
    st.tuples(
        st.booleans(), PLACE, PLACE, st.floats(-0.1, 0.3), st.floats(0.01, 1.0), st.floats(0.01, 2),
        st.floats(0.01, 1), st.floats(-4, 4), st.booleans(),
    ),
    max_size=12,
)  # fmt: skip
POINT = st.tuples(PLACE, PLACE, st.floats(-0.2, 0.6))
LINES = st.lists(
    st.tuples(POINT, POINT, st.integers(-1, 12), st.integers(-1, 12)), min_size=1, max_size=30
)


def rows_of(
    bodies: list[tuple[bool, float, float, float, float, float, float, float, bool]],
) -> Rows:
    rows = np.zeros(len(bodies), dtype=BODY)
    for row, (is_round, x, y, low, tall, half_x, half_y, yaw, there) in zip(rows, bodies):
        row["x_m"], row["y_m"], row["z_low_m"] = x, y, low
        row["z_high_m"] = low + tall if there else low - 1.0
        if is_round:
            row["radius_m"] = half_y
        else:
            row["half_x_m"], row["half_y_m"] = half_x, half_y
            row["cosine"], row["sine"] = math.cos(yaw), math.sin(yaw)
    return rows


@given(BODIES, LINES)
def test_the_kernel_finds_what_brute_force_finds(bodies, lines) -> None:  # type: ignore[no-untyped-def]
    starts = np.array([line[0] for line in lines])
    ends = np.array([line[1] for line in lines])
    skip = np.array([line[2:] for line in lines], dtype=np.int32)
    agree(starts, ends, rows_of(bodies), skip)


EIGHTHS = st.integers(-16, 16).map(lambda n: n / 8.0)
FEW_EIGHTHS = st.integers(1, 6).map(lambda n: n / 8.0)
EXACT_BODIES = st.lists(
    st.tuples(st.booleans(), EIGHTHS, EIGHTHS, EIGHTHS, FEW_EIGHTHS, FEW_EIGHTHS, FEW_EIGHTHS),
    min_size=1,
    max_size=6,
)
EXACT_POINT = st.tuples(EIGHTHS, EIGHTHS, EIGHTHS)


@given(EXACT_BODIES, st.lists(st.tuples(EXACT_POINT, EXACT_POINT), min_size=1, max_size=20))
def test_lines_that_graze_touch(bodies, lines) -> None:  # type: ignore[no-untyped-def]
    """On a lattice of eighths nothing is rounded: tangents, edges and corners are exact."""
    rows = rows_of([(*body[:4], *body[4:], 0.0, True) for body in bodies])
    starts, ends = (np.array([line[k] for line in lines]) for k in (0, 1))
    nobody = np.full((len(lines), 1), NOBODY, dtype=np.int32)
    expected = brute_force(starts, ends, rows, nobody)
    assert np.array_equal(blocked(starts, ends, Bodies(rows)), np.isfinite(expected))


def test_a_line_of_no_length_is_a_point() -> None:
    rows = entity_rows([Cylinder("c", (0, 0, 0), 1.0, 1.0), Box("b", (5, 0, 0), (2, 2, 2))])
    points = np.array([(0, 0, 0.5), (0.99, 0, 1), (0, 0, 1.01), (2, 0, 0), (6, 1, 2), (5, 0, 2.1)])
    shares = nearest(points, points, Bodies(rows))
    assert shares.tolist() == [0.0, 0.0, np.inf, np.inf, 0.0, np.inf]


def test_upright_lines() -> None:
    rows = disc_rows([0.0], [0.0], radius_m=0.5, height_m=1.0)
    starts = np.array([(0.0, 0.0, 3.0), (0.4, 0.0, 3.0), (0.6, 0.0, 3.0), (0.0, 0.0, 0.5)])
    ends = starts * [1, 1, 0] + [0, 0, -1.0]
    shares = nearest(starts, ends, Bodies(rows))
    assert shares.tolist() == pytest.approx([0.5, 0.5, np.inf, 0.0])


def test_nothing_stands_in_an_empty_world() -> None:
    bodies = Bodies(np.zeros(0, dtype=BODY))
    assert not blocked([(0, 0, 0)], [(1, 1, 1)], bodies).any()
    absent = Bodies(disc_rows([0.5], [0.5], there=False))
    assert not blocked([(0, 0, 0)], [(1, 1, 0)], absent).any()
    assert nearest(np.zeros((0, 3)), np.zeros((0, 3)), bodies).shape == (0,)


def crowd(count: int, seed: int) -> tuple[Rows, Floats, Floats]:
    """Robots, walls and pillars, and lines between random points."""
    random = np.random.default_rng(seed)
    side = math.sqrt(count / 4.0)
    x, y = random.uniform(-side, side, (2, count))
    walls = [
        Box(
            f"w{k}",
            (*random.uniform(-side, side, 2), 0.0),
            (side, 0.02, 0.08),
            random.uniform(-3, 3),
        )
        for k in range(count // 20)
    ]
    pillars = [
        Cylinder(f"p{k}", (*random.uniform(-side, side, 2), 0.0), 0.2, 0.5)
        for k in range(count // 20)
    ]
    rows = np.concatenate([disc_rows(x, y), entity_rows([*walls, *pillars])])
    starts, ends = random.uniform((-side, -side, 0), (side, side, 0.2), (2, 1500, 3))
    return rows, starts, ends


@pytest.mark.parametrize("count", [10, 40, 400])
def test_a_crowd_agrees_with_brute_force(count: int) -> None:
    rows, starts, ends = crowd(count, count)
    skip = np.random.default_rng(1).integers(-1, len(rows), (len(starts), 2), dtype=np.int32)
    hits = agree(starts, ends, rows, skip)
    assert 20 < hits < 1480, "the lines try both answers"


MOVES = {
    "turned": lambda p: p @ np.array([(0.6, 0.8, 0), (-0.8, 0.6, 0), (0, 0, 1)]),
    "mirrored": lambda p: p * [1, -1, 1],
    "shifted": lambda p: p + np.array([123.4, -567.8, 0.0]),
}


@pytest.mark.parametrize("move", MOVES)
def test_an_arena_moved_as_a_whole_keeps_its_lines(move: str) -> None:
    rows, starts, ends = crowd(60, 5)
    moved, place = rows.copy(), MOVES[move]
    middles = place(np.stack((rows["x_m"], rows["y_m"], 0 * rows["x_m"]), axis=1))
    axes = np.stack((rows["cosine"], rows["sine"], 0 * rows["sine"]), axis=1)
    axes = axes if move == "shifted" else place(axes)
    moved["x_m"], moved["y_m"] = middles[:, 0], middles[:, 1]
    moved["cosine"], moved["sine"] = axes[:, 0], axes[:, 1]
    before = nearest(starts, ends, Bodies(rows))
    after = nearest(place(starts), place(ends), Bodies(moved))
    clear = np.isfinite(nearest(starts, ends, Bodies(grown(rows, MARGIN_M)))) == np.isfinite(before)
    assert clear.mean() > 0.99
    assert after[clear] == pytest.approx(before[clear], abs=1e-9)


def test_a_line_is_as_free_backwards() -> None:
    rows, starts, ends = crowd(100, 8)
    bodies = Bodies(rows)
    assert np.array_equal(blocked(starts, ends, bodies), blocked(ends, starts, bodies))


def test_a_robot_is_no_hindrance_to_itself() -> None:
    bodies = Bodies(disc_rows([0.0, 1.0, 2.0], [0.0, 0.0, 0.0]))
    starts, ends = np.array([(0.0, 0.0, 0.03)] * 4), np.array([(2.0, 0.0, 0.03)] * 4)
    skip = [(0, 2), (0, 1), (1, 2), (NOBODY, NOBODY)]
    assert blocked(starts, ends, bodies, skip).tolist() == [True, True, True, True]
    assert not blocked(starts[:1], [(0.9, 0.0, 0.03)], bodies, 0).any()
    assert blocked(starts[:1], [(0.9, 0.0, 0.03)], bodies, 1).all()
    without = Bodies(disc_rows([0.0, 1.0, 2.0], [0.0, 0.0, 0.0], there=[True, False, True]))
    assert not blocked(starts[:1], ends[:1], without, [(0, 2)]).any()


def test_seen_is_every_pair() -> None:
    rows, points, goals = crowd(80, 11)
    points, goals = points[:200], goals[:7]
    bodies, skip = Bodies(rows), np.arange(200) % 80
    seen = in_sight(points, goals, bodies, skip)
    for k, goal in enumerate(goals):
        ends = np.broadcast_to(goal, points.shape)
        assert np.array_equal(seen[:, k], ~blocked(points, ends, bodies, skip))


@given(st.integers(0, 10**6), st.sampled_from([0.0, 0.03, 0.3, 3.0]))
def test_points_close_together_see_what_each_alone_sees(seed: int, width_m: float) -> None:
    random = np.random.default_rng(seed)
    rows, places, goals = crowd(40, seed)
    points = np.repeat(places[:20], 24, axis=0) + random.uniform(0, width_m, (480, 3)) * [1, 1, 0.2]
    bodies, skip = Bodies(rows), random.integers(-1, len(rows), (480, 2))
    seen = in_sight(points, goals[:4], bodies, skip)
    for k, goal in enumerate(goals[:4]):
        ends = np.broadcast_to(goal, points.shape)
        assert np.array_equal(seen[:, k], ~blocked(points, ends, bodies, skip))


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e6])
def test_no_line_leaves_what_an_arena_can_hold(wrong: float) -> None:
    bodies = Bodies(disc_rows([0.0], [0.0]))
    point, bad = np.zeros((1, 3)), np.array([(0.0, wrong, 0.0)])
    for starts, ends in ((point, bad), (bad, point)):
        with pytest.raises(WireError, match="sight"):
            blocked(starts, ends, bodies)
        with pytest.raises(WireError, match="sight"):
            nearest(starts, ends, bodies)
        with pytest.raises(WireError, match="sight"):
            in_sight(starts, ends, bodies)
    with pytest.raises(WireError, match="bodies"):
        Bodies(disc_rows([wrong], [0.0]))


def test_as_many_starts_as_ends() -> None:
    with pytest.raises(ValueError, match=r"2 starts.*1 ends"):
        blocked(np.zeros((2, 3)), np.zeros((1, 3)), Bodies(disc_rows([0.0], [0.0])))


def test_a_turned_box_is_as_wide_as_it_is() -> None:
    box = Box("b", (0, 0, 0), (2.0, 0.2, 1.0), math.pi / 4)
    starts, ends = np.array([(0.0, 2.0, 0.5)]), np.array([(0.0, -2.0, 0.5)])
    share = nearest(starts, ends, Bodies(entity_rows([box])))[0]
    assert 2.0 - 4.0 * share == pytest.approx(0.1 * math.sqrt(2.0))
    over = replace(box, position_m=(0, 0, 0.51))
    assert nearest(starts, ends, Bodies(entity_rows([over])))[0] == np.inf


def test_a_wall_has_no_gap_along_its_whole_length() -> None:
    """Short lines across turned walls: each meets its wall in one cell only."""
    random = np.random.default_rng(3)
    walls = [
        Box(f"w{k}", (*random.uniform(-3, 3, 2), 0.0), (4.0, 0.001, 0.1), random.uniform(-3, 3))
        for k in range(40)
    ]
    along = np.linspace(-1.999, 1.999, 2000)
    bodies = Bodies(entity_rows(walls))
    for wall in walls:
        axis = np.array([math.cos(wall.yaw_rad), math.sin(wall.yaw_rad), 0.0])
        across = 0.002 * np.array([-axis[1], axis[0], 0.0])
        middle = np.array(wall.position_m) + [0, 0, 0.05] + along[:, None] * axis
        assert blocked(middle - across, middle + across, bodies).all()


@pytest.mark.parametrize("yaw_rad", np.linspace(-3.0, 3.0, 13))
def test_a_line_that_ends_at_a_body_touches_it(yaw_rad: float) -> None:
    rows = np.concatenate([disc_rows([0.0], [0.0], radius_m=0.5, height_m=1.0)] * 2)
    rows["x_m"][1] = 20.0
    way = np.array([math.cos(yaw_rad), math.sin(yaw_rad), 0.0])
    start = np.array([2.0 * way])
    for reach, touches in ((0.5 + 1e-9, False), (0.5 - 1e-9, True)):
        end = np.array([reach * way])
        assert blocked(start, end, Bodies(rows))[0] == touches
        assert blocked(end, start, Bodies(rows))[0] == touches
    assert nearest(start, [0.0 * way], Bodies(rows))[0] == pytest.approx(0.75)
    flat = np.array([(1.0, 0.0, 0.5)]), np.array([(0.5, 0.0, 0.5)])
    assert blocked(*flat, Bodies(rows)).all()
