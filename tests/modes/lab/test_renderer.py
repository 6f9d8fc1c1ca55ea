"""The rendered picture is what the camera model says: places, light, noise, what hides what.

Sprites drawn in C are those that OpenCV's own functions draw, one small call after the other.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from vsense.base.shared import LabError
from vsense.modes.lab._backdrop import FULL_DN, Backdrop, Block
from vsense.modes.lab._bodies import (
    EMISSION_DN,
    INK_REFLECTANCE,
    OBJECT,
    PAPER_REFLECTANCE,
    ROBOT,
    SPRITE_PX_PER_M,
    Body,
    BodySprites,
    Effect,
    Sprite,
)
from vsense.modes.lab._camera_spec import rig
from vsense.modes.lab._optics import (
    READ_NOISE,
    SHOT_NOISE,
    RayMap,
    Sensor,
    sample_times_ns,
    to_levels,
)
from vsense.modes.lab._renderer import CameraRenderer, SpritePainter, gather, look_of
from vsense.modes.lab._scene import LIGHT_SWING, Scene
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.world.entities import Arena

ARENA = Arena((3.0, 2.4, 1.0), (0.0, 0.0, 0.5))
FAMILY = load_family("arrow4x4")
HEIGHT_M = 0.06
TAG = 18425
CORNER = (1050, 760)
"""First column and row of a part of the picture where the lens bends most."""
SIZE = (560, 450)


def corner_camera() -> Camera:
    """The lower right part of a camera's picture, as a camera of its own."""
    whole = rig(ARENA)[0]
    return replace(
        whole,
        width_px=SIZE[0],
        height_px=SIZE[1],
        cx_px=whole.cx_px - CORNER[0],
        cy_px=whole.cy_px - CORNER[1],
    )


class Shot:
    """One small camera with one body, and the pictures it takes."""

    def __init__(self, boxes: tuple[Block, ...] = (), kind: str = ROBOT, seed: int = 3) -> None:
        self.camera = corner_camera()
        self.rays = RayMap(self.camera)
        self.scene = Scene([self.rays], seed, 25)
        self.backdrop = Backdrop(self.rays, self.scene, boxes)
        self.sensor = Sensor(self.camera.height_px, self.camera.width_px, seed)
        body = BodySprites(Body(TAG, HEIGHT_M, kind), FAMILY, self.camera)
        self.renderer = CameraRenderer(0, self.rays, self.backdrop, self.sensor, [body])

    def take(
        self, *poses: tuple[float, float, float], leds: int = 0, timestep: int = 0
    ) -> NDArray[np.uint8]:
        image = self.empty(timestep)
        samples = np.array(poses)[:, np.newaxis]
        self.renderer.expose(timestep, samples, np.array([leds], dtype=np.uint16), image)
        return image

    def calm(self, *poses: tuple[float, float, float]) -> NDArray[np.float64]:
        """The mean of some pictures: their noise differs."""
        return np.mean([self.take(*poses, timestep=k) for k in range(4)], axis=0)

    def empty(self, timestep: int = 0) -> NDArray[np.uint8]:
        image = np.empty((self.camera.height_px, self.camera.width_px), dtype=np.uint8)
        self.renderer.prepare(timestep, image)
        return image

    def ink(self, image: NDArray[Any], at_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Centre of gravity of the black on the marker whose disc is at `at_m`, in px."""
        column, row = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
        pixels = np.stack((column, row), axis=-1).astype(float)
        place = self.camera.to_plane(pixels, HEIGHT_M)
        on_disc = np.hypot(*np.moveaxis(place - at_m, -1, 0)) < 0.0315
        black = (PAPER_REFLECTANCE - image / self.backdrop.light)[on_disc]
        return (pixels[on_disc] * black[:, np.newaxis]).sum(axis=0) / black.sum()


@lru_cache(maxsize=4)
def shot(boxes: tuple[Block, ...] = (), kind: str = ROBOT) -> Shot:
    return Shot(boxes, kind)


def expected_ink(camera: Camera, pose: tuple[float, float, float]) -> NDArray[np.float64]:
    """The same centre of gravity by the camera model alone."""
    x, y, yaw = pose
    steps = (np.arange(-35.0, 35.0, 0.25) + 0.125) / 1000.0
    offset = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    offset = offset[np.hypot(*offset.T) < 0.0315]
    black = offset[~FAMILY.is_white(TAG, offset * 1000.0 + FAMILY.disc_centre_mm)]
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    points = black @ turn + (x, y)
    heights = np.full((len(points), 1), HEIGHT_M)
    return camera.project(np.hstack((points, heights))).mean(axis=0)


def floor_places() -> st.SearchStrategy[tuple[float, float, float]]:
    """Poses whose marker is entirely in the corner camera's picture."""
    camera = corner_camera()
    corners = np.array([(45.0, 45.0), (SIZE[0] - 46.0, SIZE[1] - 46.0)])
    (left, top), (right, bottom) = camera.to_plane(corners, HEIGHT_M)
    return st.tuples(st.floats(left, right), st.floats(bottom, top), st.floats(-3.14, 3.14))


@given(
    column=st.integers(0, SIZE[0] - 1), row=st.integers(0, SIZE[1] - 1), height=st.floats(0, 0.3)
)
def test_rays_are_the_inverse_of_the_lens(column: int, row: int, height: float) -> None:
    rays = shot().rays
    window = (slice(row, row + 1), slice(column, column + 1))
    x, y = rays.affine(window, height, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    seen = rays.camera.project(np.array([x[0, 0], y[0, 0], height]))
    assert np.abs(seen - (column, row)).max() < 0.005


@settings(max_examples=30, deadline=None)
@given(pose=floor_places())
def test_marker_lies_where_the_camera_model_says(pose: tuple[float, float, float]) -> None:
    found = shot().ink(shot().calm(pose), np.array(pose[:2]))
    assert np.hypot(*(found - expected_ink(shot().camera, pose))) < 0.1


@settings(max_examples=15, deadline=None)
@given(pose=floor_places(), way=st.floats(-3.14, 3.14))
def test_motion_blurs_evenly_around_the_capture_time(pose, way: float) -> None:
    step = 0.002 * np.array((np.cos(way), np.sin(way)))
    before = (pose[0] - step[0], pose[1] - step[1], pose[2])
    after = (pose[0] + step[0], pose[1] + step[1], pose[2])
    still, moving = shot().take(pose, pose, pose), shot().take(before, pose, after)
    assert np.abs(still.astype(int) - moving).max() > 10
    found = shot().ink(shot().calm(before, pose, after), np.array(pose[:2]))
    assert np.hypot(*(found - expected_ink(shot().camera, pose))) < 0.1


def test_exposure_is_sampled_evenly_around_the_capture_time() -> None:
    times = sample_times_ns(1_000_000_000, 3)
    assert times == [996_666_667, 1_000_000_000, 1_003_333_333]


@pytest.mark.parametrize("kind", [ROBOT, OBJECT])
def test_perspective_shows_the_side_that_faces_the_picture_centre(kind: str) -> None:
    it = shot(kind=kind)
    away = np.array((0.35, -0.25))
    place = np.array(it.camera.position_m[:2]) + 2.2 * away
    dark = it.take((*place, 0.0)) / it.backdrop.light
    outwards = away / np.hypot(*away)
    sides = np.array([place - 0.042 * outwards, place + 0.042 * outwards])
    pixels = it.camera.project(np.column_stack((sides, (HEIGHT_M, HEIGHT_M)))).round().astype(int)
    inner, outer = (
        dark[row - 1 : row + 2, column - 1 : column + 2].mean() for column, row in pixels
    )
    assert inner < 0.8 * outer


def test_noise_grows_with_the_light() -> None:
    sensor = Sensor(300, 300, 1)
    image = np.empty((300, 300), dtype=np.uint8)
    everything = (slice(None), slice(None))
    ratios = []
    for light_dn in np.arange(10.0, 250.0, 3.7):
        levels = to_levels(np.full(image.shape, light_dn, dtype=np.float32))
        sensor.read(levels, sensor.noise(0, 0), everything, image)
        assert image.mean() == pytest.approx(light_dn, abs=1.0)
        ratios.append(image.std() / np.sqrt(READ_NOISE**2 + SHOT_NOISE * light_dn))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.02)
    assert np.ptp(ratios) < 0.35


def test_noise_differs_from_picture_to_picture_and_not_from_run_to_run() -> None:
    parts = [
        Sensor(50, 60, seed).noise(*which) for seed in (1, 2) for which in ((0, 0), (1, 0), (0, 1))
    ]
    again = Sensor(50, 60, 1).noise(0, 1)
    assert np.array_equal(parts[2], again)
    likeness = [
        np.corrcoef(a.ravel(), b.ravel())[0, 1] for k, a in enumerate(parts) for b in parts[:k]
    ]
    assert np.abs(likeness).max() < 0.1


def test_pictures_follow_from_the_seed() -> None:
    pose = (*shot().camera.to_plane(np.array([250.0, 200.0]), 0.0), 1.0)
    one, same, other = (Shot(seed=seed).take(pose) for seed in (7, 7, 8))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_bodies_change_only_what_they_cover() -> None:
    pose = (*shot().camera.to_plane(np.array([250.0, 200.0]), 0.0), 1.0)
    changed = np.argwhere(shot().take(pose) != shot().empty())
    assert len(changed) > 2000
    assert np.ptp(changed, axis=0).max() < 130
    assert np.abs(changed.mean(axis=0) - (200, 250)).max() < 15


@settings(max_examples=30, deadline=None)
@given(x=st.floats(-3, 3), y=st.floats(-3, 3), yaw=st.floats(-3.14, 3.14))
def test_bodies_at_the_border_and_beyond_are_cut(x: float, y: float, yaw: float) -> None:
    image = shot().take((x, y, yaw))
    centre = shot().camera.project(np.array([x, y, 0.0]))
    if not shot().camera.contains(centre, -150.0):
        assert np.array_equal(image, shot().empty())


def test_a_wall_hides_what_is_lower_and_behind() -> None:
    camera = corner_camera()
    x, y = camera.to_plane(np.array([280.0, 220.0]), HEIGHT_M)
    in_front = Block(x, y, 0.3, 0.2, 0.2, 0.1)
    assert np.array_equal(shot((in_front,)).take((x, y, 0.0)), shot((in_front,)).empty())
    lower = Block(x, y, 0.3, 0.2, 0.2, 0.05)
    found = shot((lower,)).ink(shot((lower,)).take((x, y, 0.0)), np.array((x, y)))
    assert np.hypot(*(found - expected_ink(camera, (x, y, 0.0)))) < 0.1


def test_lit_leds_brighten_the_rim_and_nothing_else() -> None:
    x, y = corner_camera().to_plane(np.array([280.0, 220.0]), HEIGHT_M)
    dark, lit = (shot().take((x, y, 0.5), leds=leds).astype(int) for leds in (0, 0xFF))
    assert (lit >= dark).all()
    brighter = np.argwhere(lit > dark + 10)
    assert len(brighter) > 100
    centre = corner_camera().project(np.array([x, y, HEIGHT_M]))[::-1]
    distance = np.hypot(*(brighter - centre).T)
    assert distance.min() > 20
    assert distance.max() < 45


def test_light_is_uneven_by_what_was_promised() -> None:
    rays = [RayMap(camera) for camera in rig(ARENA)]
    scene = Scene(rays, 1, 0)
    light = np.array([scene.light(ray) for ray in rays])
    assert light.min() == pytest.approx(1 - LIGHT_SWING, abs=0.03)
    assert light.max() == pytest.approx(1 + LIGHT_SWING, abs=0.03)
    assert light.max() * PAPER_REFLECTANCE * FULL_DN < 255 and light.min() * INK_REFLECTANCE > 0


def test_bodies_that_cannot_be_are_refused() -> None:
    with pytest.raises(LabError, match="kind 'ghost' is neither robot nor object"):
        Body(1, 0.06, "ghost")
    with pytest.raises(LabError, match="height_m: 0"):
        Body(1, 0.0)
    with pytest.raises(LabError, match="sizes must be positive"):
        Block(0, 0, 0, 1, 1, 0)


Image32 = NDArray[np.float32]
CAMERA = corner_camera()
RAYS = RayMap(CAMERA)
BOX = Block(0.16, -1.2, 0.4, 0.05, 0.1, 0.15)


def sample(sprite: Sprite, rays: RayMap, pose: NDArray[np.float64]) -> Image32:
    """A sprite as all pixels see it, (h, w) or (h, w, 2)."""
    x, y, yaw = pose
    cos, sin = math.cos(yaw) * SPRITE_PX_PER_M, math.sin(yaw) * SPRITE_PX_PER_M
    middle = sprite.texture.shape[0] / 2.0 - 0.5
    column = (cos, sin, middle - cos * x - sin * y)
    row = (sin, -cos, middle - sin * x + cos * y)
    everything = (slice(None), slice(None))
    u, v = rays.affine(everything, sprite.height_m, (column, row))
    texture = sprite.texture
    if sprite.effect is Effect.PRINT:
        texture = np.dstack((texture, sprite.cover))
    return np.asarray(cv2.remap(texture, u, v, cv2.INTER_LINEAR), dtype=np.float32)


def draw(backdrop: Backdrop, sprites: list[Sprite], poses: NDArray[np.float64]) -> Image32:
    """One body over the empty arena; `poses` are (samples, 3)."""
    canvas = backdrop.grey.copy()
    for sprite in sprites:
        through = poses if sprite.moving else poses[len(poses) // 2][np.newaxis]
        layer = sum(sample(sprite, RAYS, pose) for pose in through)
        layer = np.asarray(layer * np.float32(1.0 / len(through)), dtype=np.float32)
        layer[backdrop.top_m > sprite.height_m + 0.001] = 0.0
        if sprite.effect is Effect.GLOW:
            canvas += layer * np.float32(EMISSION_DN)
        elif sprite.effect is Effect.COVER:
            canvas += layer * (np.float32(sprite.reflectance) * backdrop.light - canvas)
        else:
            canvas += layer[..., 0] * backdrop.light - layer[..., 1] * canvas
    return canvas


@pytest.mark.parametrize("leds", [0, 0b101, 0xFF])
@pytest.mark.parametrize("way_m", [0.0, 0.001])
@pytest.mark.parametrize("aside", [(0.0, 0.0), (0.12, -0.03), (1.6, 0.4)])
def test_a_body_is_what_opencv_draws(leds: int, way_m: float, aside: tuple[float, float]) -> None:
    scene = Scene([RAYS], 3, 25)
    backdrop = Backdrop(RAYS, scene, (BOX,))
    middle = CAMERA.to_plane(np.array((CAMERA.width_px / 2, CAMERA.height_px / 2)), HEIGHT_M)
    x, y = middle + aside
    poses = np.array([(x + k * way_m, y, 0.7) for k in (-1, 0, 1)])
    sprites = BodySprites(Body(TAG, HEIGHT_M), FAMILY, CAMERA).sprites(leds)
    look, painter = gather([look_of(sprites)]), SpritePainter(RAYS, backdrop)
    patches = painter.draw(look, poses[:, np.newaxis])
    expected = draw(backdrop, list(sprites), poses if way_m else poses[1:2])
    assert len(patches) == (0 if aside == (1.6, 0.4) else 1)
    if not len(patches):
        assert expected.tobytes() == backdrop.grey.tobytes(), "it is out of sight"
        return
    sensor = Sensor(CAMERA.height_px, CAMERA.width_px, 1)
    image = np.zeros((CAMERA.height_px, CAMERA.width_px), np.uint8)
    sensor.read(to_levels(backdrop.grey), sensor.noise(0, 1), (slice(None), slice(None)), image)
    theirs = image.copy()
    sensor.read(to_levels(expected), sensor.noise(0, 1), (slice(None), slice(None)), theirs)
    painter.read(patches, sensor, sensor.noise(0, 1), image)
    differs = np.abs(theirs.astype(int) - image)
    # OpenCV fuses multiplications where the processor can: elsewhere a rounding may differ.
    assert differs.max() <= 3 and (differs > 0).mean() < 1e-4
    assert (np.abs(expected - backdrop.grey) > 1.0).mean() > 0.005, "there is something to see"
