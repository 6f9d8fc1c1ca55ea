"""Fields: nothing is lost or made that should not be, whatever happens to them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.world.entities import Arena, WorldError
from vsense.world.fields import MAX_CELLS, MAX_CONCENTRATION, Field, by_id

ARENA = Arena((2.0, 1.5, 1.0), (0.5, -0.25, 0.5))
POINTS = st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), min_size=1, max_size=8)
AMOUNTS = st.floats(0, 10)


def field(**settings: float) -> Field:
    return Field("smell", ARENA, 0.05, **settings)


def drop(diffusion_m2_s: float, dt_s: float = 0.1) -> Field:
    """One unit in the middle of a cell."""
    square = Field("smell", Arena((2.05, 2.05, 1), (0, 0, 0)), 0.05, 0.0, diffusion_m2_s)
    square.deposit([(0.0, 0.0)], 1.0)
    return square


@given(POINTS, AMOUNTS, st.floats(0, 0.02))
def test_what_is_deposited_is_there_and_stays_while_it_spreads(
    points: list[tuple[float, float]], amount: float, diffusion: float
) -> None:
    smell = field(diffusion_m2_s=diffusion)
    smell.deposit(points, amount)
    for _ in range(5):
        smell.step(0.1)
        assert smell.total() == pytest.approx(amount * len(points), abs=1e-12)
        assert (smell.concentration >= 0.0).all()


@given(st.floats(0, 5), st.floats(0.01, 3), st.integers(1, 7))
def test_evaporation_is_exponential_whatever_the_step(
    rate: float, seconds: float, steps: int
) -> None:
    smell = field(evaporation_per_s=rate)
    smell.fill(2.0)
    before = smell.total()
    for _ in range(steps):
        smell.step(seconds / steps)
    assert smell.total() == pytest.approx(before * math.exp(-rate * seconds), rel=1e-9)


def test_a_drops_variance_grows_by_twice_the_diffusion() -> None:
    smell = drop(0.002)
    for _ in range(20):
        smell.step(0.1)
    places = 0.05 * (np.arange(41) - 20)
    for axis in (0, 1):
        weights = smell.concentration.sum(axis=axis) / smell.concentration.sum()
        assert (weights * places).sum() == pytest.approx(0.0, abs=1e-12)
        assert (weights * places**2).sum() == pytest.approx(2 * 0.002 * 2.0, rel=1e-6)


def test_fast_diffusion_takes_several_steps_and_too_fast_is_refused() -> None:
    smell = drop(0.05)
    smell.check(0.1)
    smell.step(0.1)
    assert smell.total() == pytest.approx(1.0) and (smell.concentration >= 0.0).all()
    with pytest.raises(WorldError, match=r"'smell':.*5 m\^2/s"):
        drop(5.0).check(0.1)
    with pytest.raises(WorldError, match="too fast"):
        drop(5.0).step(0.1)


def test_in_the_end_it_is_the_same_everywhere() -> None:
    small = Field("smell", Arena((0.3, 0.2, 1), (0, 0, 0)), 0.05, 0.0, 0.02)
    small.deposit([(0.1, 0.05)], 3.0)
    for _ in range(200):
        small.step(0.1)
    assert small.concentration == pytest.approx(3.0 / (0.3 * 0.2), rel=1e-6)


@given(st.integers(0, 3), st.booleans())
def test_a_field_moved_with_everything_in_it_reads_the_same(quarters: int, mirrored: bool) -> None:
    points = np.random.default_rng(5).uniform(-0.9, 0.9, (12, 2))
    amounts = np.random.default_rng(6).uniform(0, 1, 12)
    c, s = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarters]
    place = np.diag([1, -1 if mirrored else 1]) @ np.array([(c, s), (-s, c)])
    shift = np.array([3.0, -4.0])

    def run(centre: tuple[float, float, float], where: np.ndarray) -> Field:  # type: ignore[type-arg]
        smell = Field("smell", Arena((2, 2, 1), centre), 0.05, 0.3, 0.003)
        for _ in range(4):
            smell.deposit(where, amounts)
            smell.step(0.1)
        return smell

    moved = points @ place + shift
    before, after = run((0, 0, 0), points), run((3, -4, 0), moved)
    assert after.value(moved) == pytest.approx(before.value(points), rel=1e-9)
    assert after.gradient(moved) == pytest.approx(before.gradient(points) @ place, abs=1e-6)


@given(POINTS, st.integers(0, 1000))
def test_order_does_not_matter(points: list[tuple[float, float]], seed: int) -> None:
    order = np.random.default_rng(seed).permutation(len(points))
    amounts = np.linspace(0.1, 1.0, len(points))
    one, other = field(), field()
    one.deposit(points, amounts)
    other.deposit(np.array(points)[order], amounts[order])
    assert other.concentration == pytest.approx(one.concentration, rel=1e-12)
    taken = one.take(points, 2 * amounts)
    assert other.take(np.array(points)[order], 2 * amounts[order]) == pytest.approx(taken[order])


def test_a_plane_is_read_as_it_is() -> None:
    smell = field()
    rows, columns = smell.concentration.shape
    x = ARENA.centre_m[0] + 0.05 * (np.arange(columns) - (columns - 1) / 2)
    y = ARENA.centre_m[1] + 0.05 * (np.arange(rows) - (rows - 1) / 2)
    smell.concentration[:] = 10.0 + 2.0 * x[None, :] - 3.0 * y[:, None]
    points = np.random.default_rng(1).uniform((-0.3, -0.8), (1.3, 0.3), (50, 2))
    assert smell.value(points) == pytest.approx(10.0 + points @ [2.0, -3.0])
    assert smell.gradient(points) == pytest.approx(np.broadcast_to([2.0, -3.0], (50, 2)))


def test_the_gradient_points_to_the_drop_and_is_level_across_the_border() -> None:
    smell = field(diffusion_m2_s=0.01)
    smell.deposit([(0.5, -0.25)], 1.0)
    for _ in range(20):
        smell.step(0.1)
    around = np.array([(0.8, -0.25), (0.2, -0.25), (0.5, 0.1), (0.5, -0.5)])
    slopes = smell.gradient(around)
    assert (np.sum(slopes * ([0.5, -0.25] - around), axis=1) > 0.0).all()
    smell.fill(4.0)
    assert smell.gradient([(-0.5, -1.0), (1.5, 0.5)]).tolist() == [[0.0, 0.0], [0.0, 0.0]]


@given(POINTS, AMOUNTS, AMOUNTS)
def test_no_more_is_taken_than_there_is(
    points: list[tuple[float, float]], there: float, wanted: float
) -> None:
    smell = field()
    smell.deposit(points, there)
    before = smell.total()
    taken = smell.take(points, wanted)
    assert (taken >= 0.0).all() and (taken <= wanted * (1 + 1e-12)).all()
    assert (smell.concentration >= 0.0).all()
    assert smell.total() == pytest.approx(before - taken.sum(), abs=1e-9)
    if len(points) == 1:
        assert taken[0] == pytest.approx(min(wanted, there), abs=1e-12)


def test_two_who_take_from_one_place_share_it() -> None:
    smell = field()
    smell.deposit([(0.5, -0.25)], 3.0)
    taken = smell.take([(0.5, -0.25), (0.5, -0.25)], [2.0, 4.0])
    assert taken == pytest.approx([1.0, 2.0])
    assert smell.total() == pytest.approx(0.0, abs=1e-12)


def test_points_outside_are_the_nearest_ones_inside() -> None:
    smell = field()
    smell.deposit([(99.0, 99.0)], 1.0)
    assert smell.total() == pytest.approx(1.0)
    assert smell.value([(1.5, 0.5)])[0] == smell.value([(99.0, 99.0)])[0] > 0.0


@pytest.mark.parametrize("amount", [-0.1, math.nan, math.inf, 1e300])
def test_no_amount_is_negative_or_endless(amount: float) -> None:
    for act in (field().deposit, field().take):
        with pytest.raises(WorldError, match=r"'smell':.*amount"):
            act([(0.0, 0.0)], amount)


def test_concentrations_saturate() -> None:
    smell = field()
    for _ in range(5):
        smell.deposit([(0.5, -0.25)], MAX_CONCENTRATION)
    assert smell.concentration.max() == MAX_CONCENTRATION


@pytest.mark.parametrize("name", ["cell_m", "evaporation_per_s", "diffusion_m2_s", "initial"])
@pytest.mark.parametrize("wrong", [-1.0, math.nan, math.inf, "1"])
def test_settings_out_of_range_are_refused(name: str, wrong: float) -> None:
    with pytest.raises(WorldError, match=f"field 'smell': {name} is"):
        Field("smell", ARENA, **({"cell_m": 0.05} | {name: wrong}))


def test_too_many_cells_are_refused() -> None:
    with pytest.raises(
        WorldError, match=f"20000 x 15000 in this arena, expected at most {MAX_CELLS}"
    ):
        Field("smell", ARENA, 0.0001)


def test_reset_goes_back_to_the_start() -> None:
    smell = field(initial=1.5)
    assert smell.total() == pytest.approx(1.5 * 2.0 * 1.5)
    smell.deposit([(0.0, 0.0)], 1.0)
    smell.reset()
    assert (smell.concentration == 1.5).all()


def test_an_arena_smaller_than_a_cell_has_one() -> None:
    dot = Field("smell", Arena((0.01, 0.01, 1), (0, 0, 0)), 0.05)
    dot.deposit([(0.0, 0.0)], 1.0)
    assert dot.concentration.tolist() == [[pytest.approx(400.0)]]
    assert dot.value([(9.0, 9.0)])[0] == pytest.approx(400.0)
    assert dot.gradient([(0.0, 0.0)]).tolist() == [[0.0, 0.0]]


def test_ids_are_unique() -> None:
    assert list(by_id([field()], 0.1)) == ["smell"]
    with pytest.raises(WorldError, match="called 'smell'"):
        by_id([field(), field()], 0.1)
