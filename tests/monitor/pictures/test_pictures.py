"""The pictures show what is there, where it is, and the charts what was measured."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.arena import POSE, ArenaState
from vsense.base.canvas import SCALE, Canvas
from vsense.config.experiment import load
from vsense.config.specs import Experiment
from vsense.monitor.pictures import run_figure
from vsense.monitor.pictures._chart import Chart, ChartSeries, draw_chart, ticks
from vsense.monitor.pictures._scene import DARK, LIT, VIRTUAL, ArenaMoment
from vsense.monitor.pictures._views import VIEW_PX, draw_from_above
from vsense.monitor.pictures.run_samples import RunSamples, take_snapshot
from vsense.world.entities import Arena, Box, Cylinder, Light, VirtualRobot, Zone
from vsense.world.fields import Field
from vsense.world.world import World

POSES = np.array([[-1.0, 0.5, 0.0], [0.4, -0.6, 2.0]])


@pytest.fixture(scope="module")
def experiment() -> Experiment:
    return load("pollutant", 10.0)


def make_world(experiment: Experiment, *entities: object, fields: tuple[Field, ...] = ()) -> World:
    world = World(
        [31, 1843],
        experiment.sources,
        entities=entities,  # type: ignore[arg-type]
        fields=fields,
        arena=experiment.arena,
    )
    rows = np.zeros(3, POSE)
    rows["tag"] = [31, 1843, experiment.sources[0].tag]
    rows["x_m"][:2], rows["y_m"][:2], rows["seen"] = POSES[:, 0], POSES[:, 1], True
    rows["capture_ns"] = 1
    world.update(ArenaState(0, 1, rows[np.argsort(rows["tag"])], 3, 0, ()), 0)
    return world


def draw(experiment: Experiment, world: World, lit: tuple[bool, bool] = (False, False)) -> object:
    scene = ArenaMoment(
        "now", "", None, take_snapshot(world, experiment), POSES, np.array(lit), np.empty((0,))
    )
    return draw_from_above(scene)


def colour_at(image: object, experiment: Experiment, x_m: float, y_m: float) -> np.ndarray:
    """Mean colour (BGR) of a few pixels around a place of the arena."""
    picture = np.asarray(image, np.float64)
    zoom = VIEW_PX * SCALE / experiment.arena.size_m[0]
    column = round(picture.shape[1] / 2 + x_m * zoom)
    row = round(picture.shape[0] / 2 - y_m * zoom)
    return picture[row - 2 : row + 3, column - 2 : column + 3].mean(axis=(0, 1))


def test_robots_are_drawn_where_they_are_and_red_when_lit(experiment: Experiment) -> None:
    world = make_world(experiment)
    image = draw(experiment, world, (True, False))
    for pose, colour in zip(POSES, (LIT, DARK), strict=True):
        # The rim across the heading: nothing else is drawn there.
        across = pose[2] + np.pi / 2
        rim = pose[:2] + 0.035 * np.array([np.cos(across), np.sin(across)])
        assert np.abs(colour_at(image, experiment, *rim) - colour).max() < 40


def test_virtual_things_are_tinted_and_the_rest_is_paper(experiment: Experiment) -> None:
    entities = (
        Box("wall", (0.8, 0.7, 0.0), (0.4, 0.2, 0.1), 0.5),
        Cylinder("post", (-0.6, -0.7, 0.0), 0.1, 0.1),
        Light("lamp", (0.0, 0.9, 0.5), 1.0),
        Zone("spot", "circle", -1.2, -0.9, radius_m=0.1, color=(0, 0, 255)),
        VirtualRobot("ghost", 0x10000, 1.2, -0.9, 0.0),
    )
    world = make_world(experiment, *entities)
    bare = draw(experiment, make_world(experiment))
    image = draw(experiment, world)
    for place in ((0.8, 0.7), (-0.6, -0.7), (0.0, 0.9), (-1.2, -0.9), (1.2, -0.9)):
        change = colour_at(image, experiment, *place) - colour_at(bare, experiment, *place)
        assert np.abs(change).max() > 20, place
    tint = colour_at(image, experiment, 0.8, 0.7)
    paper = colour_at(bare, experiment, 0.8, 0.7)
    assert tint == pytest.approx(0.35 * np.array(VIRTUAL) + 0.65 * paper, abs=2)
    assert np.array_equal(
        colour_at(image, experiment, -0.2, -1.0), colour_at(bare, experiment, -0.2, -1.0)
    )
    blue, _, red = colour_at(image, experiment, -1.2, -0.96)
    assert blue > red + 100, "a blue zone is blue: OpenCV's order is blue, green, red"


def test_field_is_darkest_where_it_is_strongest(experiment: Experiment) -> None:
    field = Field("scent", experiment.arena, 0.05)
    world = make_world(experiment, fields=(field,))
    field.deposit(np.array([[0.9, -0.9]]), 1.0)
    image = draw(experiment, world)
    near, far = (colour_at(image, experiment, x, -0.9) for x in (0.9, 0.5))
    assert near.mean() < far.mean() - 30


def test_outline_of_a_turned_box_follows_its_turn(experiment: Experiment) -> None:
    box = Box("wall", (0.5, 0.5, 0.0), (0.4, 0.02, 0.1), np.pi / 2)
    (outline,) = take_snapshot(make_world(experiment, box), experiment).virtual
    assert np.ptp(outline.outline_m, axis=0) == pytest.approx([0.02, 0.4])


@given(
    low=st.floats(-1e3, 0.0),
    high=st.floats(1e-3, 1e4),
    most=st.integers(2, 9),
)
def test_ticks_are_round_rising_and_inside(low: float, high: float, most: int) -> None:
    values = ticks(low, high, most)
    step = np.diff(values)
    assert len(values) >= 1 and len(values) <= most + 1
    assert np.all(step > 0)
    assert values[0] >= low - 1e-6 * (high - low) and values[-1] <= high + 1e-6 * (high - low)
    if len(step):
        mantissa = step[0] / 10.0 ** np.floor(np.log10(step[0]) + 1e-9)
        assert min(abs(mantissa - m) for m in (1, 2, 5, 10)) < 1e-6


def test_chart_draws_a_constant_and_negative_values() -> None:
    canvas = Canvas(800, 400)
    values = np.array([-1.0, -1.0, 0.0])
    series = [ChartSeries("a", values, LIT), ChartSeries("b", np.zeros(3), DARK)]
    draw_chart(canvas, Chart("m", np.arange(4.0), series, 0.0, [(1.0, "here")]), 20, 40, 760)
    reds = (canvas.finished() == np.array(LIT)).all(axis=-1)
    assert reds.any()


def run_samples_of(experiment: Experiment, timesteps: range) -> RunSamples:
    samples, world = RunSamples(experiment), make_world(experiment)
    for timestep in timesteps:
        world.results["half"] = timestep / 2.0
        world.results["always"] = 3.0
        samples.add(timestep, world)
    samples.end(world)
    return samples


def make_run(experiment: Experiment, timesteps: range, turn: int | None) -> run_figure.RunFigure:
    n = len(timesteps)
    return run_figure.RunFigure(
        experiment,
        np.array(timesteps),
        np.tile(POSES, (n, 1, 1)),
        np.zeros((n, 2), bool),
        None if turn is None else np.ones((n, 2), bool),
        turn,
        run_samples_of(experiment, timesteps),
    )


def test_samples_keep_the_moment_before_the_turn_and_the_end(experiment: Experiment) -> None:
    samples = run_samples_of(experiment, range(100))
    assert samples.moment == 50
    assert sorted(samples.snapshots) == [47, 48, 49, 99]
    assert set(samples.measures()) == {"half"}
    assert samples.measures()["half"].tolist() == [t / 2 for t in range(100)]


def test_missed_timestep_shows_the_one_before_and_a_short_run_shows_its_end(
    experiment: Experiment,
) -> None:
    lived = [t for t in range(100) if t != 49]
    samples, world = RunSamples(experiment), make_world(experiment)
    for timestep in lived:
        samples.add(timestep, world)
    samples.end(world)
    assert sorted(samples.snapshots) == [47, 48, 99]
    short = make_run(experiment, range(20), 50)
    assert run_figure.draw(short, "short", "").shape[1] < 1000
    whole = make_run(experiment, range(100), 50)
    assert run_figure.draw(whole, "whole", "").shape[1] > 1800


def test_a_moment_takes_no_more_memory_than_what_is_drawn_of_it(experiment: Experiment) -> None:
    # Of a size that no other test has.
    experiment = replace(experiment, arena=replace(experiment.arena, size_m=(3.1, 2.3, 1.0)))
    world = make_world(experiment)
    tracemalloc.start()
    try:
        snapshot = take_snapshot(world, experiment)
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    rasters = [raster for raster in (snapshot.floor, *snapshot.fields) if raster is not None]
    assert kept < sum(raster.nbytes for raster in rasters) + (100 << 10)


def test_charts_show_the_cone_first_and_the_measures_after(experiment: Experiment) -> None:
    both = run_figure.charts(make_run(experiment, range(100), 50))
    assert [c.unit for c in both] == ["robots", "half"]
    assert both[0].marks == [(5.0, "the wind turns")]
    assert both[0].series[0].values.tolist() == [2.0] * 100
    (own,) = run_figure.charts(make_run(experiment, range(100), None))
    assert own.unit == "half" and own.time_s[-1] == pytest.approx(10.0)


def test_no_picture_of_this_room_knows_the_laboratory() -> None:
    for module in Path(run_figure.__file__).parent.glob("*.py"):
        assert "vsense.modes.lab" not in module.read_text(), module


def test_an_arena_of_hundreds_of_metres_is_drawn_with_as_few_pixels(experiment: Experiment) -> None:
    size_m = (400.0, 100.0, 1.0)
    large = replace(experiment, arena=Arena(size_m, (0.0, 0.0, 0.0)))
    zone = Zone("spot", "circle", 0.0, 0.0, radius_m=60.0, color=(0, 0, 255))
    world = World([], entities=[zone], arena=large.arena)
    floor = take_snapshot(world, large).floor
    assert floor is not None
    rows, columns = floor.shape[:2]
    assert rows * columns <= 1_001_000
    assert columns == pytest.approx(4 * rows, rel=0.01)


def test_a_part_of_an_arena_is_drawn_where_it_is(experiment: Experiment) -> None:
    arena = Arena((10.0, 10.0, 1.0), (0.0, 0.0, 0.0))
    large = replace(experiment, arena=arena)
    zone = Zone("spot", "circle", 2.0, 3.0, radius_m=0.5, color=(0, 0, 255))
    box = Box("box", (2.5, 2.5, 0.0), (0.2, 0.2, 0.1), physical=False)
    robot = VirtualRobot("v", 70_000, 1.5, 3.5, 1.0)
    world = World([], entities=[zone, box, robot, Light("l", (1.0, 2.0, 1.0), 1.0)], arena=arena)
    whole = take_snapshot(world, large)
    part = whole.within(Arena((3.0, 2.0, 1.0), (2.0, 3.0, 0.0)))
    assert part.floor is not None and part.floor.shape[:2] == (200, 300)
    blue = np.argwhere((part.floor[..., :3] == (0, 0, 255)).all(axis=-1))
    assert blue.mean(axis=0) == pytest.approx((99.5, 149.5), abs=1.0)
    assert len(blue) == pytest.approx(np.pi * 50**2, rel=0.05)
    assert part.virtual[0].outline_m.mean(axis=0) == pytest.approx((0.5, -0.5))
    assert part.virtual_robots[0][:3] == pytest.approx((-0.5, 0.5, 1.0))
    assert part.lamps[0].place_m == pytest.approx((-1.0, -1.0))
