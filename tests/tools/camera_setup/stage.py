"""A scripted camera whose brightness follows exposure and gain, looking at an arena."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from tests.vision.tracking.synthetic import Look, Robot, render
from vsense.base.errors import GrabberError
from vsense.tools.camera_setup.tuning import TuneOptions, Tuner, tuner_of
from vsense.vision.cameras.camera import Camera as Calibration
from vsense.vision.cameras.discovery import GIGE, Details, FoundCamera
from vsense.vision.cameras.picture import PictureError
from vsense.vision.cameras.source import EXPOSURE, GAIN, Bounds, Controls, Shot
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.single_camera import OpenCamera

PX_PER_M = 700.0
TAGS = (31, 1843, 4334, 7167)
CALIBRATION = Calibration.looking_down("c", 0.0, 0.0, 2.06, 2.0 * PX_PER_M, (640, 480))
"""Its markers are 0.06 m above the floor, where the scale is `PX_PER_M`."""
NORMAL_US = 5000.0
"""With this exposure and no gain white paper is at 205."""
DECIBEL = 10.0 ** (1.0 / 20.0)


@cache
def arena() -> np.ndarray:
    """What the camera sees: four robots on a floor, without the sensor's noise."""
    places = ((-0.25, -0.15), (0.2, -0.2), (-0.2, 0.2), (0.25, 0.1))
    robots = [Robot(tag, x, y, float(n)) for n, (tag, (x, y)) in enumerate(zip(TAGS, places))]
    return render(CALIBRATION, load_family("arrow4x4"), robots, Look(noise=0.0, light=0.0))


class Scripted:
    """A source and its controls.

    Attributes:
        values: exposure [us] and gain [dB]; noise grows with the gain.
        fails: raised instead of a picture, if it is set.
        reads: how many pictures were asked for.
        keeps: why its own values cannot be put back, if they cannot.
    """

    def __init__(self, fails: Exception | None = None) -> None:
        self.values = {EXPOSURE: 10_000.0, GAIN: 0.0}
        self.turned: list[tuple[str, float]] = []
        self.fails = fails
        self.reads = 0
        self.opened = False
        self.keeps = ""
        self.after_read: Callable[[int], None] = lambda reads: None
        self._random = np.random.default_rng(1)

    def open(self) -> list[str]:
        self.opened = True
        return []

    def read(self) -> Shot:
        self.reads += 1
        self.after_read(self.reads)
        if self.fails is not None:
            raise self.fails
        gain = DECIBEL ** self.values[GAIN]
        light = arena() * (self.values[EXPOSURE] / NORMAL_US * gain)
        noise = 1.5 * gain * self._random.standard_normal(light.shape, dtype=np.float32)
        image = np.clip(np.rint(light + noise), 0, 255).astype(np.uint8)
        return Shot(image, None, self.reads * 40_000_000)

    def close(self) -> None:
        self.opened = False

    def value(self, name: str) -> float | None:
        return self.values.get(name)

    def bounds(self, name: str) -> Bounds | None:
        return {EXPOSURE: (10.0, 1e6), GAIN: (0.0, 24.0)}[name]

    def set(self, name: str, value: float) -> None:
        self.turned.append((name, value))
        self.values[name] = value

    def remember(self) -> Callable[[], None]:
        own = dict(self.values)

        def put_back() -> None:
            if self.keeps:
                raise GrabberError(self.keeps)
            self.values.update(own)

        return put_back


def options(wanted: Controls | None = None, **values: Any) -> TuneOptions:
    """What `vsense camera tune` is told, its defaults for what is not given."""
    unsaid = dict.fromkeys(("resources", "px_per_m", "height_m", "focal_px", "camera"))
    usual = {"family": "arrow4x4", "speed": 0.13, "marker_height": 0.06}
    return TuneOptions(**{"id": "cam", "wanted": wanted or Controls(), **unsaid, **usual, **values})


def tuner(scripted: Scripted, **values: Any) -> Tuner:
    """A tuner of the scripted camera, which is open."""
    camera = OpenCamera("cam", scripted, scripted, 25.0)
    camera.open()
    return tuner_of(camera, options(**values), None)


def found(**values: object) -> FoundCamera:
    """A camera that was found and is well."""
    details = Details(
        size_px=(1620, 1220),
        formats=("RGB8", "BayerRG8", "Mono8", "Mono16", "BayerGB8"),
        rate_hz=25.0,
        exposure_us=10_000.0,
        exposure_bounds_us=(10.0, 1e7),
        gain=3.0,
        gain_bounds=(0.0, 24.0),
    )
    usual = {"id": "Maker-Model-7", "kind": GIGE, "address": "192.168.10.11"}
    usual |= {"model": "Maker Model", "serial": "7", "mac": "00:0f:31:00:00:07"}
    return FoundCamera(**{**usual, "details": details, **values})


DAMAGED = PictureError("12 of 90 packets are missing")
GONE = GrabberError("gives no pictures for 0.4 s")
