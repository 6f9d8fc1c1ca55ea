"""Exposure and gain of an open camera: read, set, and restored."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from vsense.base.errors import GrabberError
from vsense.vision.cameras.aravis import AravisError
from vsense.vision.cameras.aravis_camera import AravisCamera
from vsense.vision.cameras.genicam import AUTOMATIC, NAMES, digits
from vsense.vision.cameras.opencv_source import EXPOSURE_UNIT_US
from vsense.vision.cameras.source import Bounds
from vsense.vision.cameras.v4l2 import V4l2Control, V4l2ControlDevice

EXPOSURE, GAIN = "exposure_time_abs", "gain_raw"
"""As in the resources file: exposure in us, gain in the camera's own unit."""

_CONTROLS = {EXPOSURE: V4l2Control.EXPOSURE, GAIN: V4l2Control.GAIN}
_UNITS = {EXPOSURE: EXPOSURE_UNIT_US, GAIN: 1.0}
"""V4L2's units in ours."""
_MANUAL = {EXPOSURE: (V4l2Control.EXPOSURE_AUTO, 1), GAIN: (V4l2Control.AUTOGAIN, 0)}


class CameraControls(Protocol):
    """A camera's `EXPOSURE` and `GAIN`; belongs to its source's thread."""

    def value(self, name: str) -> float | None:
        """Returns the current value; None: unknown, or the camera does not have it."""

    def bounds(self, name: str) -> Bounds | None:
        """Returns the least and the greatest value; None: unknown."""

    def set(self, name: str, value: float) -> None:
        """Switches its automatic mode off and sets a value, which may be rounded, or raises
        GrabberError.
        """

    def remember(self) -> Callable[[], None]:
        """Returns what restores the settings; it raises GrabberError if they are not as before."""


class GenicamControls:
    """Controls of a camera behind Aravis; `opened` returns the camera, None while it is gone."""

    def __init__(self, opened: Callable[[], AravisCamera | None]) -> None:
        self._opened = opened

    def value(self, name: str) -> float | None:
        camera, feature = self._feature(name)
        return None if camera is None or feature is None else float(camera.get(feature))

    def bounds(self, name: str) -> Bounds | None:
        camera, feature = self._feature(name)
        return None if camera is None or feature is None else camera.bounds(feature)

    def set(self, name: str, value: float) -> None:
        camera, feature = self._feature(name)
        if camera is None or feature is None:
            raise GrabberError(f"has no {name}")
        if camera.has(AUTOMATIC[name]):
            camera.set(AUTOMATIC[name], "Off")
        camera.set(feature, digits(value))

    def remember(self) -> Callable[[], None]:
        camera, kept, automatic = self._opened(), list[tuple[str, str, str]](), set[str]()
        for name in (EXPOSURE, GAIN):
            feature = self._feature(name)[1]
            if camera is not None and feature is not None:
                kept.append((name, feature, camera.get(feature)))
                if camera.has(AUTOMATIC[name]) and camera.get(AUTOMATIC[name]) != "Off":
                    automatic.add(name)
        # Automatic modes are restored last: values cannot be set while they are on.
        for feature in AUTOMATIC.values():
            if camera is not None and camera.has(feature):
                kept.append((feature, feature, camera.get(feature)))

        def put_back() -> None:
            now = self._opened()
            if now is None:
                raise GrabberError("the camera is gone")
            for name, feature, value in kept:
                _set_back(now, name, feature, value, name in automatic)

        return put_back

    def _feature(self, name: str) -> tuple[AravisCamera | None, str | None]:
        camera = self._opened()
        if camera is None:
            return None, None
        return camera, next((f for f in NAMES[name] if camera.has(f)), None)


class V4l2Controls:
    """Controls of a V4L2 device, which can be set while another program takes its pictures."""

    def __init__(self, device: V4l2ControlDevice) -> None:
        self._device = device

    def value(self, name: str) -> float | None:
        value = self._device.get(_CONTROLS[name])
        return None if value is None else value * _UNITS[name]

    def bounds(self, name: str) -> Bounds | None:
        bounds = self._device.bounds(_CONTROLS[name])
        return None if bounds is None else (bounds[0] * _UNITS[name], bounds[1] * _UNITS[name])

    def set(self, name: str, value: float) -> None:
        control, manual = _MANUAL[name]
        if self._device.get(control) is not None:
            self._device.set(control, manual)
        if not self._device.set(_CONTROLS[name], max(round(value / _UNITS[name]), 0)):
            raise GrabberError(f"does not take {name} {value:g}")

    def remember(self) -> Callable[[], None]:
        kept = {name: self._device.get(control) for name, control in _CONTROLS.items()}
        modes = {name: self._device.get(control) for name, (control, _) in _MANUAL.items()}

        def put_back() -> None:
            for name, value in kept.items():
                automatic = modes[name] not in (None, _MANUAL[name][1])
                self._set_back(name, _CONTROLS[name], value, automatic)
            for name, mode in modes.items():
                self._set_back(f"automatic {name}", _MANUAL[name][0], mode, False)

        return put_back

    def _set_back(
        self, name: str, control: V4l2Control, value: int | None, automatic: bool
    ) -> None:
        """Restores a control and reads it back; one that was automatic may differ."""
        if value is None:
            return
        self._device.set(control, value)
        now = self._device.get(control)
        if now is None:
            raise GrabberError(f"{name}: the device does not answer")
        if not automatic and now != value:
            unit = _UNITS.get(name, 1.0)
            raise GrabberError(f"{name} is {now * unit:g}, and was {value * unit:g}")


def _set_back(camera: AravisCamera, name: str, feature: str, value: str, automatic: bool) -> None:
    """Restores a feature and reads it back; one that was automatic may differ."""
    reason = ""
    try:
        camera.set(feature, value)
    except AravisError as error:
        reason = f" ({error})"
    try:
        now = camera.get(feature)
    except AravisError as error:
        raise GrabberError(f"{name}: {error}") from None
    if not automatic and not _same(now, value):
        raise GrabberError(f"{name} is {now}, and was {value}{reason}")


def _same(now: str, before: str) -> bool:
    try:
        return math.isclose(float(now), float(before), rel_tol=1e-6)
    except ValueError:
        return now == before
