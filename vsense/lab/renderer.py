"""The lab's pictures: the empty arena, and on it every body at its true place.

A picture is made in two steps. `prepare` needs no poses and is done before the exposure; `expose`
draws the bodies into the windows they cover. Both take the sensor's noise from the same place of
the bank, so that the windows do not show.

`Studio` holds all cameras. It is built on two threads and makes its pictures on one: with small
OpenCV calls a second thread costs a third more processor time, for Python's lock, and gains
nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.lab.backdrop import Backdrop
from vsense.lab.bodies import EMISSION_DN, TEXTURE_PX_PER_M, BodySprites, Effect, Sprite
from vsense.lab.camera_spec import LabCameraSpec
from vsense.lab.optics import Floats, Image8, Image32, RayMap, Sensor, Window, to_levels
from vsense.lab.scene import Scene
from vsense.markers.families import load_family

Leds = NDArray[np.uint16]

_MARGIN_PX = 1
_SAME_HEIGHT_M = 0.001
_STILL_M = 1e-5
"""Motion during the exposure that is not worth drawing: 0.007 px."""
_CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
_EVERYTHING: Window = (slice(None), slice(None))


@dataclass(frozen=True, slots=True)
class _Placed:
    """A sprite with the pixels that it may cover, and its poses during the exposure.

    `overtopped`: something in that window stands higher.
    """

    sprite: Sprite
    window: Window
    poses: list[list[float]]
    overtopped: bool


class CameraRenderer:
    """Makes the pictures of one camera; `bodies` come in the order of the poses."""

    def __init__(
        self,
        number: int,
        rays: RayMap,
        backdrop: Backdrop,
        sensor: Sensor,
        bodies: Sequence[BodySprites],
    ) -> None:
        self._number = number
        self._rays = rays
        self._backdrop = backdrop
        self._sensor = sensor
        self._bodies = bodies
        self._empty = to_levels(backdrop.grey)
        self._canvas = backdrop.grey.copy()

    def prepare(self, timestep: int, image: Image8) -> None:
        """Writes the empty arena, with the timestep's noise, into `image` (h, w) uint8."""
        noise = self._sensor.noise(self._number, timestep)
        self._sensor.read(self._empty, noise, _EVERYTHING, image)

    def expose(self, timestep: int, poses: Floats, leds: Leds, image: Image8) -> None:
        """Adds the bodies to a picture of `prepare`; `leds` (n,) are LED bits.

        `poses` (samples, n, 3) are x [m], y [m], yaw [rad] at an odd number of moments that are
        evenly spread over the exposure.
        """
        bodies = self._place(poses, leds)
        for window, _ in bodies:
            self._canvas[window] = self._backdrop.grey[window]
        for item in sorted((i for _, placed in bodies for i in placed), key=_height_m):
            self._draw(item)
        noise = self._sensor.noise(self._number, timestep)
        for window, _ in bodies:
            self._sensor.read(to_levels(self._canvas[window]), noise, window, image)

    def _place(self, poses: Floats, leds: Leds) -> list[tuple[Window, list[_Placed]]]:
        """The sprites of every visible body, and the window around them."""
        middle = poses[poses.shape[0] // 2]
        still = np.ptp(poses, axis=0).max(axis=1) < _STILL_M
        looks = [body.sprites(int(bits)) for body, bits in zip(self._bodies, leds)]
        owners = np.repeat(np.arange(len(looks)), [len(look) for look in looks])
        windows = iter(self._windows([s for look in looks for s in look], middle[owners]))
        bodies = []
        for number, look in enumerate(looks):
            seen = [(s, w) for s, w in [(s, next(windows)) for s in look] if w is not None]
            if not seen:
                continue
            hull = _hull([window for _, window in seen])
            tallest_m = float(self._backdrop.top_m[hull].max())
            now, through = [middle[number].tolist()], poses[:, number].tolist()
            placed = [
                _Placed(
                    s, w, through if s.moving and not still[number] else now, tallest_m > s.height_m
                )
                for s, w in seen
            ]
            bodies.append((hull, placed))
        return bodies

    def _windows(self, sprites: Sequence[Sprite], poses: Floats) -> list[Window | None]:
        """The window that each sprite covers at its pose; None where it is out of sight."""
        camera = self._rays.camera
        corners = np.empty((len(sprites), 4, 3))
        radii = np.array([sprite.radius_m for sprite in sprites])
        corners[..., :2] = poses[:, np.newaxis, :2] + radii[:, np.newaxis, np.newaxis] * _CORNERS
        corners[..., 2] = np.array([[sprite.height_m] for sprite in sprites])
        pixels = camera.project(corners)
        size = (camera.width_px, camera.height_px)
        low = np.clip(np.floor(pixels.min(axis=1)) - _MARGIN_PX, 0, size).astype(int)
        high = np.clip(np.ceil(pixels.max(axis=1)) + _MARGIN_PX + 1, 0, size).astype(int)
        return [
            (slice(top, bottom), slice(left, right)) if left < right and top < bottom else None
            for (left, top), (right, bottom) in zip(low.tolist(), high.tolist())
        ]

    def _draw(self, item: _Placed) -> None:
        """Lays one sprite over the canvas, averaged over its poses."""
        sprite, window = item.sprite, item.window
        layer = self._sample(sprite, window, item.poses[0])
        for pose in item.poses[1:]:
            cv2.add(layer, self._sample(sprite, window, pose), dst=layer)
        if len(item.poses) > 1:
            layer *= 1.0 / len(item.poses)
        if item.overtopped:
            layer[self._backdrop.top_m[window] > sprite.height_m + _SAME_HEIGHT_M] = 0.0
        canvas = self._canvas[window]
        if sprite.effect is Effect.GLOW:
            canvas += layer * EMISSION_DN
        elif sprite.effect is Effect.COVER:
            canvas += layer * (sprite.reflectance * self._backdrop.light[window] - canvas)
        else:
            colour, cover = cv2.split(layer)
            canvas += colour * self._backdrop.light[window] - cover * canvas

    def _sample(self, sprite: Sprite, window: Window, pose: list[float]) -> Image32:
        """The sprite as the window's pixels see it, (h, w) or (h, w, 2)."""
        x, y, yaw = pose
        cos, sin = math.cos(yaw) * TEXTURE_PX_PER_M, math.sin(yaw) * TEXTURE_PX_PER_M
        middle = sprite.texture.shape[0] / 2.0 - 0.5
        column = (cos, sin, middle - cos * x - sin * y)
        row = (sin, -cos, middle - sin * x + cos * y)
        u, v = self._rays.affine(window, sprite.height_m, (column, row))
        return cv2.remap(sprite.texture, u, v, cv2.INTER_LINEAR)  # type: ignore[return-value]


def _height_m(item: _Placed) -> float:
    return item.sprite.height_m


def _hull(windows: Sequence[Window]) -> Window:
    """The smallest window around some windows."""
    rows, columns = zip(*windows)
    return (
        slice(min(r.start for r in rows), max(r.stop for r in rows)),
        slice(min(c.start for c in columns), max(c.stop for c in columns)),
    )


_BUILDERS = 2


class Studio:
    """Makes one timestep's pictures of all cameras."""

    def __init__(self, spec: LabCameraSpec) -> None:
        """Builds the scene in about a second, and ends OpenCV's own threads in this process.

        Raises:
            FamilyError: there is no such marker family, or it has not all the tags.
        """
        cv2.setNumThreads(1)
        family = load_family(spec.family)
        with ThreadPoolExecutor(_BUILDERS) as builders:
            rays = list(builders.map(RayMap, spec.cameras))
            scene = builders.submit(Scene, rays, spec.seed, spec.litter)
            # Cameras of one kind share their sprites: only a body's first camera has work to do.
            looks = builders.map(
                lambda body: [BodySprites(body, family, c) for c in spec.cameras], spec.bodies
            )
            sensor = Sensor(*spec.shape[1:], spec.seed)
            by_camera = list(zip(*looks)) or [()] * len(rays)
            floor = scene.result()

            def renderer(number: int) -> CameraRenderer:
                backdrop = Backdrop(rays[number], floor, spec.boxes)
                return CameraRenderer(number, rays[number], backdrop, sensor, by_camera[number])

            self._renderers = list(builders.map(renderer, range(len(rays))))

    def prepare(self, timestep: int, images: Image8) -> None:
        """Draws the empty arena into images (cameras, h, w) uint8."""
        for renderer, image in zip(self._renderers, images):
            renderer.prepare(timestep, image)

    def expose(self, timestep: int, poses: Floats, leds: Leds, images: Image8) -> None:
        """Draws the bodies into prepared images; see `CameraRenderer.expose`."""
        for renderer, image in zip(self._renderers, images):
            renderer.expose(timestep, poses, leds, image)
