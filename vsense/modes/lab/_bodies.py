"""Robots and tagged objects from above, as stacks of flat sprites.

A body is a shadow on the floor, its sides as dark discs at several heights, its lit LEDs, and
the marker at its true height, so that perspective shows the sides as in a real picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.shared import LabError
from vsense.modes.lab._optics import BLUR_SIGMA_PX
from vsense.vision.cameras.camera import Camera, Image32
from vsense.vision.markers.families import Family
from vsense.world.robot_models import EPUCK, RobotModel, read_model

PAPER_REFLECTANCE, INK_REFLECTANCE = 0.84, 0.05
"""Reflectances of a marker's white and black."""
SPRITE_PX_PER_M = 2000.0
"""Resolution of sprites: three times finer than a picture of them."""

EMISSION_DN = 190.0
"""Emitted light of strength 1 adds this to the picture."""

ROBOT = "robot"
OBJECT = "object"

_FINE = 3
_SHADOW_M = 0.023
"""How far a shadow reaches beyond the body."""
_SHADOW_DEPTH = 0.55
_SIDES: dict[str, tuple[tuple[float, float], ...]] = {
    ROBOT: ((0.3, 0.10), (0.62, 0.17)),
    OBJECT: ((0.25, 0.20), (0.5, 0.23), (0.75, 0.26)),
}
"""Height of each side disc as a share of the marker's, and its reflectance."""
_RING_SHARE = 0.68
"""Height of the ring's LEDs as a share of the marker's: 41 of 60 mm."""

_GLOW_M = 0.021
"""Likewise."""
_RIM = 1.08
"""Halos shine so much farther out than their LEDs sit."""
_LED_BITS = 0x3FF


@dataclass(frozen=True, slots=True)
class Body:
    """A thing, ROBOT or OBJECT, with a marker at a height above the floor.

    `marker` is where that sits in the body's frame: x, y [m] and heading [rad].
    """

    tag: int
    height_m: float
    kind: str = ROBOT
    marker: tuple[float, float, float] = (0.0, 0.0, 0.0)
    model: RobotModel = EPUCK

    def __post_init__(self) -> None:
        if self.kind not in _SIDES:
            raise LabError(f"body {self.tag}: kind {self.kind!r} is neither robot nor object")
        if not 0.0 < self.height_m < 1.0:
            raise LabError(f"body {self.tag}: height_m: {self.height_m} is not in (0, 1)")

    def message(self) -> dict[str, Any]:
        """What the process of the cameras is sent."""
        return asdict(self) | {"model": str(self.model.file)}

    @classmethod
    def of(cls, message: Mapping[str, Any]) -> Body:
        """Reads a `message`; ValueError, KeyError, TypeError or WorldError where it is none."""
        model = read_model(Path(message["model"]))
        return cls(**{**message, "marker": tuple(message["marker"]), "model": model})


class Effect(Enum):
    """Effect of a sprite on the light behind it; the values describe its texture."""

    PRINT = "reflectance times coverage; `cover` is coverage"
    COVER = "coverage by a surface of one reflectance"
    GLOW = "light that it adds, in units of EMISSION_DN"


@dataclass(frozen=True)
class Sprite:
    """A flat picture at one height above the floor, already as blurred as in the camera.

    Attributes:
        texture: (n, n) float32, see `Effect`; +x of the body runs to the right and +y up, the
            body's centre is in the middle, and the border is zero.
        cover: (n, n) float32, likewise; the texture itself but for a PRINT.
        radius_m: half the texture's side without its border.
        reflectance: of a surface that is the same everywhere.
        moving: whether the motion during the exposure is drawn.
    """

    texture: Image32
    cover: Image32
    radius_m: float
    height_m: float
    effect: Effect
    reflectance: float = 0.0
    moving: bool = False

    @cached_property
    def reach(self) -> float:
        """How far from its texture's middle a place can be that is not 0 [texel]."""
        return float(_away(np.logical_or(self.texture, self.cover)).max(initial=0.0)) + _BETWEEN

    @cached_property
    def core(self) -> float:
        """How near to its middle the cover is `flat` in all places [texel]; 0: nowhere."""
        away = _away(np.not_equal(self.cover, self.flat))
        return max(0.0, float(away.min(initial=math.inf)) - _BETWEEN)

    @property
    def flat(self) -> float:
        """The cover's middle."""
        return float(self.cover[self.cover.shape[0] // 2, self.cover.shape[1] // 2])


_BETWEEN = 1.5
"""A place lies so far from the farthest of the texels around it, at most [texel]."""


def _away(texels: NDArray[np.bool_]) -> Floats:
    """How far some texels are from their texture's middle [texel]."""
    row, column = (np.argwhere(texels) - (texels.shape[0] - 1) / 2.0).T
    return np.asarray(np.hypot(row, column))


class BodySprites:
    """The sprites of one body as one kind of camera sees them."""

    def __init__(self, body: Body, family: Family, camera: Camera) -> None:
        """Draws all that does not change, with the camera's blur."""
        self._height_m, self._model = body.height_m, body.model
        self._pixel_m = _pixel_m(camera, body.height_m)
        sides = [
            _side(body.kind, k, body.height_m, self._pixel_m, body.model.radius_m)
            for k in range(len(_SIDES[body.kind]))
        ]
        self._below = (_shadow(self._pixel_m, body.model.radius_m), *sides)
        self._top = _marker(body, family, self._pixel_m)

    def sprites(self, leds: int) -> tuple[Sprite, ...]:
        """The sprites from the floor upwards, with these LED bits lit."""
        bits = leds & _LED_BITS
        glow = (_glow(bits, self._height_m, self._pixel_m, self._model),) if bits else ()
        return (*self._below, *glow, self._top)


def _pixel_m(camera: Camera, height_m: float) -> float:
    """Width of the camera's pixels at a height, in the middle of the picture."""
    return (camera.position_m[2] - height_m) / camera.fx_px


def _draw(
    draw: Callable[[Floats, Floats], Floats], radius_m: float, pixel_m: float, fine: int = _FINE
) -> tuple[Image32, float]:
    """Samples a drawing densely and blurs it as the camera does.

    Args:
        draw: takes (n, n) x and y [m] in the body's frame, returns (n, n, channels).
        radius_m: of the drawing.
        pixel_m: the camera's pixel on the drawing.
        fine: samples per texture pixel, both ways.

    Returns:
        The texture with an empty border, and half its side without that [m].
    """
    sigma_m = BLUR_SIGMA_PX * pixel_m
    half = int(np.ceil((radius_m + 3.0 * sigma_m) * SPRITE_PX_PER_M)) + 1
    places = ((np.arange(2 * half * fine) + 0.5) / fine - half) / SPRITE_PX_PER_M
    x, y = np.meshgrid(places, -places)
    samples = draw(x, y).reshape(2 * half, fine, 2 * half, fine, -1).mean(axis=(1, 3))
    texture = cv2.GaussianBlur(samples.astype(np.float32), (0, 0), sigma_m * SPRITE_PX_PER_M)
    border = ((1, 1), (1, 1), (0, 0))[: texture.ndim]
    return np.pad(np.asarray(texture, dtype=np.float32), border), half / SPRITE_PX_PER_M


@lru_cache(maxsize=16)
def _shadow(pixel_m: float, body_m: float) -> Sprite:
    """A soft dark spot around a body of a radius."""
    reach_m = body_m + _SHADOW_M

    def draw(x: Floats, y: Floats) -> Floats:
        beyond = (np.hypot(x, y) - body_m) / (reach_m - body_m)
        depth = _SHADOW_DEPTH * (1.0 - np.clip(beyond, 0.0, 1.0)) ** 2
        return np.asarray(depth[..., np.newaxis])

    texture, radius = _draw(draw, reach_m, pixel_m, fine=1)
    return Sprite(texture, texture, radius, 0.0, Effect.COVER)


@lru_cache(maxsize=32)
def _side(kind: str, number: int, height_m: float, pixel_m: float, body_m: float) -> Sprite:
    """A slice through the body below the marker."""
    share, reflectance = _SIDES[kind][number]

    def draw(x: Floats, y: Floats) -> Floats:
        inside = np.hypot(x, y) <= body_m
        return np.asarray(inside[..., np.newaxis], dtype=np.float64)

    texture, radius = _draw(draw, body_m, pixel_m)
    return Sprite(texture, texture, radius, share * height_m, Effect.COVER, reflectance)


@lru_cache(maxsize=1024)
def _marker(body: Body, family: Family, pixel_m: float) -> Sprite:
    disc = family.disc_diameter_mm / 2000.0
    at_x, at_y, turned = body.marker
    away = float(np.hypot(at_x, at_y))
    cos, sin = np.cos(turned), np.sin(turned)

    def draw(x: Floats, y: Floats) -> Floats:
        if body.marker != (0.0, 0.0, 0.0):
            x, y = cos * (x - at_x) + sin * (y - at_y), cos * (y - at_y) - sin * (x - at_x)
        places_mm = np.stack((x, y), axis=-1) * 1000.0 + family.disc_centre_mm
        shade = np.where(family.is_white(body.tag, places_mm), PAPER_REFLECTANCE, INK_REFLECTANCE)
        covered = np.hypot(x, y) <= disc
        return np.stack((shade * covered, covered), axis=-1)

    drawn, radius = _draw(draw, disc + away, pixel_m)
    texture, cover = np.ascontiguousarray(drawn[..., 0]), _shared(drawn[..., 1].tobytes())
    return Sprite(texture, cover, radius, body.height_m, Effect.PRINT, moving=True)


@lru_cache(maxsize=64)
def _shared(texels: bytes) -> Image32:
    """A square of texels; markers with equal covers share them in the processor's cache."""
    square = np.frombuffer(texels, dtype=np.float32)
    return square.reshape((math.isqrt(len(square)),) * 2)


@lru_cache(maxsize=256)
def _glow(bits: int, height_m: float, pixel_m: float, model: RobotModel) -> Sprite:
    """Halos around the LEDs, of which the marker's disc leaves the outer half to be seen."""
    ring = np.array(model.leds.ring_m).reshape(-1, 2) * _RIM
    lamps = [(place, 0.0045, 0.5) for k, place in enumerate(ring) if bits >> k & 1]
    if bits >> 8 & 1:
        lamps.append((np.zeros(2), 0.024, 0.5))
    if bits >> 9 & 1:
        lamps.append((np.array(model.leds.front_m), 0.006, 0.7))

    def draw(x: Floats, y: Floats) -> Floats:
        light = np.zeros((*x.shape, 1))
        for (ahead, left), size, strength in lamps:
            squared = ((x - ahead) ** 2 + (y - left) ** 2) / (2.0 * size**2)
            light[..., 0] += strength * np.exp(-squared)
        return light

    texture, radius = _draw(draw, model.radius_m + _GLOW_M, pixel_m, fine=1)
    return Sprite(texture, texture, radius, _RING_SHARE * height_m, Effect.GLOW)
