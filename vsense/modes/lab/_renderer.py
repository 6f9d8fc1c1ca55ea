"""The lab's pictures: the empty arena, and on it every body at its true place.

A picture is made in two steps. `prepare` needs no poses and is done before the exposure; `expose`
draws the bodies into the windows they cover. Both take the sensor's noise from the same place of
the bank, so that the windows do not show.

`Studio` holds all cameras. It is built on two threads, and draws the bodies on two: what takes
longest there is one call into C for each camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import cv2
import numpy as np

from vsense.base.arena import Floats, Image
from vsense.modes.lab._backdrop import Backdrop
from vsense.modes.lab._bodies import Body, BodySprites
from vsense.modes.lab._camera_spec import LabCameraSpec
from vsense.modes.lab._optics import RayMap, Sensor, Window, to_levels
from vsense.modes.lab._scene import Scene
from vsense.modes.lab._sprites import Look, SpritePainter, gather, look_of
from vsense.modes.lab.truth import LedStates
from vsense.vision.markers.families import load_family

_EVERYTHING: Window = (slice(None), slice(None))


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
        self._sensor = sensor
        self._bodies = list(bodies)
        self._empty = to_levels(backdrop.grey)
        self._painter = SpritePainter(rays, backdrop)
        self._lit: tuple[bytes, Look] | None = None

    def prepare(self, timestep: int, image: Image) -> None:
        """Writes the empty arena, with the timestep's noise, into `image` (h, w) uint8."""
        noise = self._sensor.noise(self._number, timestep)
        self._sensor.read(self._empty, noise, _EVERYTHING, image)

    def expose(self, timestep: int, poses: Floats, leds: LedStates, image: Image) -> None:
        """Adds the bodies to a picture of `prepare`; `leds` (n,) are LED bits.

        `poses` (samples, n, 3) are x [m], y [m], yaw [rad] at one or three moments that are
        evenly spread over the exposure.
        """
        noise = self._sensor.noise(self._number, timestep)
        self._painter.read(self._painter.draw(self._look(leds), poses), self._sensor, noise, image)

    def dress(self, row: int, body: BodySprites) -> None:
        """Has a body look otherwise from the next picture on."""
        self._bodies[row] = body
        self._lit = None

    def get_ready(self, leds: LedStates) -> None:
        """Makes what the first picture of bodies with these LED bits needs."""
        self._look(leds)

    def _look(self, leds: LedStates) -> Look:
        """The bodies' sprites with these LED bits; they are kept for the next picture."""
        lit = leds.tobytes()
        if self._lit is None or self._lit[0] != lit:
            lit_bodies = zip(self._bodies, leds.tolist())
            self._lit = lit, gather([_look_of(body, bits) for body, bits in lit_bodies])
        return self._lit[1]


@lru_cache(maxsize=4096)
def _look_of(body: BodySprites, leds: int) -> Look:
    """One body's look; robots blink with the same LEDs again and again."""
    return look_of(body.sprites(leds))


_THREADS = 2


class Studio:
    """Makes one timestep's pictures of all cameras."""

    def __init__(self, spec: LabCameraSpec) -> None:
        """Builds the scene in about a second, and ends OpenCV's own threads in this process.

        Raises:
            FamilyError: there is no such marker family, or it has not all the tags.
        """
        cv2.setNumThreads(1)
        family = load_family(spec.family)
        with ThreadPoolExecutor(_THREADS) as builders:
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
            # Bodies are drawn here for the first time: in the first picture it would take too long.
            dark = np.zeros(len(spec.bodies), dtype=np.uint16)
            list(builders.map(lambda renderer: renderer.get_ready(dark), self._renderers))
        self._painters = ThreadPoolExecutor(_THREADS)
        self._spec, self._family = spec, family

    def dress(self, row: int, body: Body) -> None:
        """Has a body look otherwise from the next timestep on; IndexError: there is none."""
        for camera, renderer in zip(self._spec.cameras, self._renderers):
            renderer.dress(row, BodySprites(body, self._family, camera))

    def prepare(self, timestep: int, images: Image) -> None:
        """Draws the empty arena into images (cameras, h, w) uint8."""
        for renderer, image in zip(self._renderers, images):
            renderer.prepare(timestep, image)

    def expose(self, timestep: int, poses: Floats, leds: LedStates, images: Image) -> None:
        """Draws the bodies into prepared images; see `CameraRenderer.expose`."""

        def draw(renderer: CameraRenderer, image: Image) -> None:
            renderer.expose(timestep, poses, leds, image)

        list(self._painters.map(draw, self._renderers, images))
