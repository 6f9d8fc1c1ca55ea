"""The lab's pictures: the empty arena, and on it every body at its true place.

A picture is made in two steps. `prepare` needs no poses and is done before the exposure; `expose`
draws the bodies into the windows they cover. Both take the sensor's noise from the same place of
the bank, so that the windows do not show.

`Studio` holds all cameras. It is built on two threads, and draws the bodies on two: what takes
longest there is one call into C for each camera: `c_src/host/vs_sprites.h`. What of a body's
sprites depends on its LEDs alone is gathered once for each pattern of the swarm's LEDs; with every
picture come poses, and the pixels that the sprites may cover.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Image
from vsense.base.native import kernel_ffi, kernels
from vsense.modes.lab._backdrop import Backdrop
from vsense.modes.lab._bodies import EMISSION_DN, SPRITE_PX_PER_M, Body, BodySprites, Effect, Sprite
from vsense.modes.lab._camera_spec import LabCameraSpec
from vsense.modes.lab._optics import RayMap, Sensor, Window, to_levels
from vsense.modes.lab._scene import Scene
from vsense.modes.lab.truth import LedStates
from vsense.vision.markers.families import load_family

_MARGIN_PX = 1
_SAME_HEIGHT_M = 0.001
_STILL_M = 1e-5
"""Motion during the exposure that is not worth drawing: 0.007 px."""
_CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
_EFFECTS = {
    Effect.PRINT: kernels.VS_PRINT,
    Effect.COVER: kernels.VS_COVER,
    Effect.GLOW: kernels.VS_GLOW,
}

PATCH = np.dtype([("left", "i4"), ("top", "i4"), ("right", "i4"), ("bottom", "i4")])
"""Pixels of a picture: `struct vs_patch`."""
_POSES = kernels.VS_SPRITE_POSES
SPRITE = np.dtype(
    [
        ("texture", "u8"),
        ("cover", "u8"),
        ("side", "i4"),
        ("reach", "f4"),
        ("core", "f4"),
        ("flat", "f4"),
        ("effect", "i4"),
        ("strength", "f4"),
        ("below_m", "f4"),
        ("patch", PATCH),
        ("poses", "i4"),
        ("column", "f4", (_POSES, 3)),
        ("row", "f4", (_POSES, 3)),
    ],
    align=True,
)
"""A sprite where it is drawn: `struct vs_sprite`."""
assert SPRITE.itemsize == kernel_ffi.sizeof("struct vs_sprite")


SHEET = np.dtype(
    [
        ("sprite", SPRITE), ("radius_m", "f8"), ("height_m", "f8"), ("middle_px", "f8"),
        ("moving", "?"),
    ],
    align=True,
)  # fmt: skip
"""A sprite without patch and poses, half its texture's side and its height above the floor, its
texture's middle, and whether motion during the exposure is drawn."""


@dataclass(frozen=True, slots=True)
class Look:
    """Bodies' sprites with some LEDs lit, each body's from the floor upwards.

    Attributes:
        sheets: (m,) SHEET.
        owner: (m,) the body that each belongs to.
        keep_alive: what must live as long.
    """

    sheets: NDArray[np.void]
    owner: NDArray[np.intp]
    keep_alive: object


def look_of(sprites: Sequence[Sprite]) -> Look:
    """The look of one body."""
    sheets = np.zeros(len(sprites), dtype=SHEET)
    for sheet, sprite in zip(sheets, sprites):
        for texture in (sprite.texture, sprite.cover):
            assert texture.flags.c_contiguous and texture.dtype == np.float32
        row = sheet["sprite"]
        row["texture"] = sprite.texture.ctypes.data
        row["cover"] = sprite.cover.ctypes.data
        row["side"] = sprite.texture.shape[0]
        row["reach"], row["core"], row["flat"] = sprite.reach, sprite.core, sprite.flat
        row["effect"] = _EFFECTS[sprite.effect]
        row["strength"] = EMISSION_DN if sprite.effect is Effect.GLOW else sprite.reflectance
        row["below_m"] = sprite.height_m + _SAME_HEIGHT_M
        sheet["radius_m"], sheet["height_m"] = sprite.radius_m, sprite.height_m
        sheet["middle_px"] = sprite.texture.shape[0] / 2.0 - 0.5
        sheet["moving"] = sprite.moving
    return Look(sheets, np.zeros(len(sheets), dtype=np.intp), sprites)


def gather(bodies: Sequence[Look]) -> Look:
    """The look of several bodies."""
    sheets = [body.sheets for body in bodies]
    owner = np.repeat(np.arange(len(bodies)), [len(body) for body in sheets])
    return Look(np.concatenate([np.zeros(0, dtype=SHEET), *sheets]), owner, tuple(bodies))


class SpritePainter:
    """Draws and reads out the patches of one camera's pictures; one thread at a time."""

    def __init__(self, rays: RayMap, backdrop: Backdrop) -> None:
        self._rays = rays
        self._canvas = backdrop.grey.copy()
        self._arrays = [
            np.ascontiguousarray(a, dtype=np.float32)
            for a in (rays.x_m, rays.y_m, backdrop.light, backdrop.top_m, backdrop.grey)
        ]
        self._backdrop = kernel_ffi.new("struct vs_backdrop *")
        b = self._backdrop
        b.x_m, b.y_m, b.white_dn, b.top_m, b.light_dn = map(_floats, self._arrays)
        b.height_px, b.width_px = backdrop.grey.shape
        self._readout: Any = None

    def draw(self, look: Look, poses: Floats) -> NDArray[np.void]:
        """Draws all bodies over the empty arena.

        Args:
            poses: (samples, n, 3) x [m], y [m] and yaw [rad] of the bodies at moments of the
                exposure; one, or `VS_SPRITE_POSES`.

        Returns:
            (k,) PATCH, one for each body that can be seen.
        """
        patches, seen = self._patches(look.sheets, poses[poses.shape[0] // 2][look.owner])
        sheets, owner = look.sheets[seen], look.owner[seen]
        sprites = np.ascontiguousarray(sheets["sprite"])
        sprites["patch"] = patches[seen]
        self._pose(sprites, sheets, owner, poses)
        bodies = _around(sprites["patch"], owner)
        sprites = sprites[np.argsort(sheets["height_m"], kind="stable")]
        canvas = _floats(self._canvas)
        kernels.vs_sprites_clear(self._backdrop, _patches(bodies), len(bodies), canvas)
        rows = kernel_ffi.cast("struct vs_sprite *", sprites.ctypes.data)
        kernels.vs_sprites_draw(self._backdrop, rows, len(sprites), canvas)
        return bodies

    def read(self, patches: NDArray[np.void], sensor: Sensor, noise: Image, image: Image) -> None:
        """Reads (k,) PATCH of what was drawn out into `image`, both (h, w) uint8 as `noise`."""
        if self._readout is None:
            self._readout = sensor.readout()
        kernels.vs_sprites_read(
            self._backdrop, self._readout, _patches(patches), len(patches),
            _floats(self._canvas), _bytes(noise), noise.strides[0], _bytes(image),
            image.strides[0],
        )  # fmt: skip

    def _patches(
        self, sheets: NDArray[np.void], poses: Floats
    ) -> tuple[NDArray[np.void], NDArray[np.bool_]]:
        """The patch that each sprite covers at its pose, and whether it is in sight."""
        camera = self._rays.camera
        corners = np.empty((len(poses), 4, 3))
        corners[..., :2] = (
            poses[:, np.newaxis, :2] + sheets["radius_m"][:, np.newaxis, np.newaxis] * _CORNERS
        )
        corners[..., 2] = sheets["height_m"][:, np.newaxis]
        pixels = camera.project(corners)
        size = (camera.width_px, camera.height_px)
        low = np.clip(np.floor(pixels.min(axis=1)) - _MARGIN_PX, 0, size)
        high = np.clip(np.ceil(pixels.max(axis=1)) + _MARGIN_PX + 1, 0, size)
        patches = np.zeros(len(poses), dtype=PATCH)
        patches["left"], patches["top"] = low.T
        patches["right"], patches["bottom"] = high.T
        return patches, (low < high).all(axis=1)

    def _pose(
        self,
        sprites: NDArray[np.void],
        sheets: NDArray[np.void],
        owner: NDArray[np.intp],
        poses: Floats,
    ) -> None:
        """Sets where the sprites' textures are for the rays of the floor, at every pose."""
        still = np.ptp(poses, axis=0).max(axis=1) < _STILL_M
        moves = sheets["moving"] & ~still[owner]
        sprites["poses"] = np.where(moves, poses.shape[0], 1)
        centre_x, centre_y, centre_z = self._rays.camera.position_m
        reach = 1.0 - sheets["height_m"] / centre_z
        middle = sheets["middle_px"]
        # Not NumPy's, whose last bit depends on the processor.
        yaw = poses[..., 2].ravel().tolist()
        turns = (np.array(list(map(f, yaw))).reshape(poses.shape[:2]) for f in (math.cos, math.sin))
        facts = poses[..., 0], poses[..., 1], *(SPRITE_PX_PER_M * turn for turn in turns)
        for k in range(poses.shape[0]):
            through = np.where(moves, k, poses.shape[0] // 2)
            x, y, cos, sin = (fact[through, owner] for fact in facts)
            for name, by_x, by_y, offset in (
                ("column", cos, sin, middle - cos * x - sin * y),
                ("row", sin, -cos, middle - sin * x + cos * y),
            ):
                shift = offset + (1.0 - reach) * (by_x * centre_x + by_y * centre_y)
                sprites[name][:, k] = np.stack((by_x * reach, by_y * reach, shift), axis=-1)


def _around(patches: NDArray[np.void], owner: NDArray[np.intp]) -> NDArray[np.void]:
    """The smallest patch around those of each owner; `owner` ascends."""
    if len(patches) == 0:
        return np.zeros(0, dtype=PATCH)
    starts = np.flatnonzero(np.diff(owner, prepend=-1))
    hulls = np.zeros(len(starts), dtype=PATCH)
    for name, widest in zip(PATCH.names or (), (np.minimum, np.minimum, np.maximum, np.maximum)):
        hulls[name] = widest.reduceat(patches[name], starts)
    return hulls


def _floats(array: NDArray[np.float32]) -> Any:
    return kernel_ffi.cast("float *", array.ctypes.data)


def _bytes(array: Image) -> Any:
    assert array.strides[1] == 1
    return kernel_ffi.cast("uint8_t *", array.ctypes.data)


def _patches(array: NDArray[np.void]) -> Any:
    return kernel_ffi.cast("struct vs_patch *", array.ctypes.data)


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
            self._lit = lit, gather([_lit(body, bits) for body, bits in lit_bodies])
        return self._lit[1]


@lru_cache(maxsize=4096)
def _lit(body: BodySprites, leds: int) -> Look:
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
