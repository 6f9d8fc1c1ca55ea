"""Sprites drawn in C are those that OpenCV's own functions draw, one small call after the other."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.modes.lab.test_renderer import FAMILY, HEIGHT_M, TAG, corner_camera
from vsense.modes.lab.backdrop import Backdrop, Block
from vsense.modes.lab.bodies import EMISSION_DN, TEXTURE_PX_PER_M, Body, BodySprites, Effect, Sprite
from vsense.modes.lab.optics import RayMap, Sensor, to_levels
from vsense.modes.lab.scene import Scene
from vsense.modes.lab.sprites import SpritePainter, gather, look_of

Image32 = NDArray[np.float32]
CAMERA = corner_camera()
RAYS = RayMap(CAMERA)
BOX = Block(0.16, -1.2, 0.4, 0.05, 0.1, 0.15)


def sample(sprite: Sprite, rays: RayMap, pose: NDArray[np.float64]) -> Image32:
    """A sprite as all pixels see it, (h, w) or (h, w, 2)."""
    x, y, yaw = pose
    cos, sin = math.cos(yaw) * TEXTURE_PX_PER_M, math.sin(yaw) * TEXTURE_PX_PER_M
    middle = sprite.texture.shape[0] / 2.0 - 0.5
    column = (cos, sin, middle - cos * x - sin * y)
    row = (sin, -cos, middle - sin * x + cos * y)
    everything = (slice(None), slice(None))
    u, v = rays.affine(everything, sprite.height_m, (column, row))
    return np.asarray(cv2.remap(sprite.texture, u, v, cv2.INTER_LINEAR), dtype=np.float32)


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
