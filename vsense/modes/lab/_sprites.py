"""Draws bodies over the empty arena, in C: the seam to `c_src/host/vs_sprites.h`.

What of a body's sprites depends on its LEDs alone is gathered once for each pattern of the swarm's
LEDs; with every picture come poses, and the pixels that the sprites may cover.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Image
from vsense.base.native import kernel_ffi, kernels
from vsense.modes.lab._backdrop import Backdrop
from vsense.modes.lab._bodies import EMISSION_DN, SPRITE_PX_PER_M, Effect, Sprite
from vsense.modes.lab._optics import RayMap, Sensor

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
        kept: What must live as long.
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
