"""Robots of very different heights below one camera, in every way to search for them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.vision.tracking.synthetic import HARD, Look, Robot, render
from vsense.base.arena import Frame
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, SquareFamily, load_family
from vsense.vision.tracking._kernel import MARKER, Kernel
from vsense.vision.tracking._prediction import SearchPlan
from vsense.vision.tracking._rows import gather, join
from vsense.vision.tracking._workers import LayeredKernel
from vsense.vision.tracking.arena_tracker import ArenaTracker

LENS = (-0.12, 0.02, 0.0, 0.0, 0.0)
CAMERA = Camera.looking_down("top", 0.0, 0.0, 2.43, 1620.0, (800, 600), LENS)
HEIGHTS = {31: 0.06, 1843: 0.06, 7167: 0.06, 52447: 0.22, 4334: 0.50, 28662: 0.90}
SQUARE_TAGS = {31: 1, 1843: 2, 7167: 3, 52447: 4, 4334: 5, 28662: 6}
STEPS = 7


def robots(step: int) -> dict[int, Robot]:
    """Returns the robots of a timestep, apart in the picture."""
    way = 0.01 * step
    places = {31: (-0.4, -0.25), 1843: (-0.1, 0.2), 7167: (0.4, 0.2), 52447: (0.35, -0.2)}
    places |= {4334: (-0.3, 0.1), 28662: (0.0, -0.15)}
    return {
        tag: Robot(tag, x + way * np.cos(tag), y + way * np.sin(tag), float(tag % 6))
        for tag, (x, y) in places.items()
    }


def picture(family: MarkerFamily | SquareFamily, step: int) -> np.ndarray:
    """Draws every robot at its own height."""
    look = Look(litter=3, noise=0.0)
    floor = render(CAMERA, family, [], look, 5).astype(float)
    image = floor.copy()
    for tag, robot in robots(step).items():
        if isinstance(family, SquareFamily):
            robot = Robot(SQUARE_TAGS[tag], robot.x_m, robot.y_m, robot.yaw_rad)
        image += render(CAMERA, family, [robot], look, 5, HEIGHTS[tag]) - floor
    image += np.random.default_rng(step).normal(0.0, 2.0, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module", params=["arrow4x4", "apriltag_36h11"])
def sequence(request: pytest.FixtureRequest) -> tuple[str, list[np.ndarray]]:
    family = load_family(request.param)
    return request.param, [picture(family, step) for step in range(STEPS)]


@pytest.mark.parametrize("plan", [(1, 0.11, False), (3, 0.14, False), (3, 0.14, True)])
def test_every_robot_is_where_it_is_whatever_its_height(
    sequence: tuple[str, list[np.ndarray]], plan: tuple[int, float, bool]
) -> None:
    name, images = sequence
    names = SQUARE_TAGS if name.startswith("april") else {tag: tag for tag in HEIGHTS}
    heights = {names[tag]: height for tag, height in HEIGHTS.items()}
    plan_ = SearchPlan(*plan)
    arena = ArenaTracker.for_family([CAMERA], load_family(name), heights, plan=plan_)
    for step, image in enumerate(images):
        state = arena.update([Frame("top", image, step, step * 100_000_000, 0)])
        assert state.detected == len(HEIGHTS) and state.duplicates == () and state.unnamed == 0
        for tag, robot in robots(step).items():
            (row,) = state.robots[state.robots["tag"] == names[tag]]
            assert row["seen"]
            assert (row["x_m"], row["y_m"]) == pytest.approx((robot.x_m, robot.y_m), abs=1.5e-3)
            turn = np.angle(np.exp(1j * (row["yaw_rad"] - robot.yaw_rad)))
            assert abs(turn) < 0.02
    arena.close()


def test_one_search_does_for_heights_that_are_not_far_apart() -> None:
    family = load_family("arrow4x4")
    assert isinstance(family, MarkerFamily)
    near = LayeredKernel(family, 0.06, (0.06, 0.12, 0.2))
    far = LayeredKernel(family, 0.06, HEIGHTS.values())
    assert near._layers_of(CAMERA) == [0.06]
    layers = far._layers_of(CAMERA)
    assert 1 < len(layers) <= 4 and layers == sorted(layers)
    for height_m in HEIGHTS.values():
        scale = [(2.43 - layer) / (2.43 - height_m) for layer in layers]
        assert min(abs(value - 1.0) for value in scale) < 0.1


def test_what_one_layer_reads_is_not_hidden_by_another_that_cannot() -> None:
    camera = Camera.looking_down("top", 0.0, 0.0, 2.43, 700.0, (1000, 760), LENS)
    family, turns = load_family("apriltag_36h11"), np.random.default_rng(1)
    spots = [(x, y) for x in np.linspace(-0.34, 0.36, 6) for y in np.linspace(-0.245, 0.245, 4)]
    crowd = [Robot(n, x, y, float(turns.uniform(-3, 3))) for n, (x, y) in enumerate(spots, 1)]
    image = render(camera, family, crowd, HARD, 1, 0.5)
    layered = LayeredKernel(family, 0.06, (0.06, 0.5))
    below, above = (Kernel(family).search(image, camera, h) for h in layered._layers_of(camera))
    assert (below["tag"] < 0.0).any() and 4.0 in below["tag"]
    found = layered.search(image, camera)
    assert set(above["tag"]) <= set(found["tag"]) and len(found) == len(above)
    right, kept = (rows[rows["tag"] == 4.0] for rows in (above, found))
    assert kept["x_px"] == right["x_px"] and kept["y_px"] == right["y_px"]


def test_what_is_at_one_place_is_one_marker() -> None:
    first, second = np.zeros(2, dtype=MARKER), np.zeros(2, dtype=MARKER)
    first["x_m"], second["x_m"] = (0.0, 1.0), (0.01, 0.5)
    one, other, none = gather([first]), gather([second]), gather([first[:0]])
    assert join(one, other).values["x_m"].tolist() == [0.0, 1.0, 0.5]
    assert len(join(none, other).picture) == len(join(other, none).picture) == 2
