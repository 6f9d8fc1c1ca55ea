"""The studio: all cameras of the lab with what they see.

It is built on two threads, and makes its pictures on one: small OpenCV calls hand Python's lock
to and fro so often that a second thread costs a third more processor time and gains nothing.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.lab.backdrop import Backdrop
from vsense.lab.bodies import BodySprites
from vsense.lab.camera_spec import LabCameraSpec
from vsense.lab.optics import RayMap, Sensor
from vsense.lab.renderer import CameraRenderer
from vsense.lab.scene import Scene
from vsense.markers.families import load_family

_BUILDERS = 2


class Studio:
    """Makes one timestep's pictures of all cameras."""

    def __init__(self, spec: LabCameraSpec) -> None:
        """Builds the scene, which takes about a second.

        OpenCV's own threads are switched off for the whole process: they would only get in the
        way of the studio's.

        Raises:
            FamilyError: There is no such marker family, or it has not all the tags.
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

    def prepare(self, timestep: int, images: NDArray[np.uint8]) -> None:
        """Draws the empty arena into images (cameras, h, w) uint8."""
        for renderer, image in zip(self._renderers, images):
            renderer.prepare(timestep, image)

    def expose(
        self,
        timestep: int,
        poses: NDArray[np.float64],
        leds: NDArray[np.uint16],
        images: NDArray[np.uint8],
    ) -> None:
        """Draws the bodies into prepared images; see `CameraRenderer.expose`."""
        for renderer, image in zip(self._renderers, images):
            renderer.expose(timestep, poses, leds, image)
