"""Exposure and gain of a camera that is giving pictures: asked, turned, and put back."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

from vsense.cameras.v4l2_controls import Control, Device
from vsense.tracking.aravis import AravisError
from vsense.tracking.aravis_camera import AravisCamera
from vsense.tracking.grabbers import GrabberError
from vsense.tracking.source import Bounds

EXPOSURE, GAIN = "exposure_time_abs", "gain_raw"
"""As the resources file calls them: exposure in us, gain in the camera's own unit."""

_FEATURES = {EXPOSURE: ("ExposureTimeAbs", "ExposureTime"), GAIN: ("GainRaw", "Gain")}
_AUTOMATIC = {EXPOSURE: "ExposureAuto", GAIN: "GainAuto"}
_CONTROLS = {EXPOSURE: Control.EXPOSURE, GAIN: Control.GAIN}
_UNITS = {EXPOSURE: 100.0, GAIN: 1.0}
"""V4L2 counts exposures in 100 us. Source: Linux, V4L2_CID_EXPOSURE_ABSOLUTE."""
_MANUAL = {EXPOSURE: (Control.EXPOSURE_AUTO, 1), GAIN: (Control.AUTOGAIN, 0)}


class Knobs(Protocol):
    """A camera's `EXPOSURE` and `GAIN`; belongs to its source's thread."""

    def value(self, name: str) -> float | None:
        """Reads one; None: the camera does not have it, or does not tell."""

    def bounds(self, name: str) -> Bounds | None:
        """Gives the least and the greatest value; None: nobody knows."""

    def turn(self, name: str, value: float) -> None:
        """Sets one, and what would set it by itself off; the camera may round.

        Raises:
            GrabberError: it refuses.
        """

    def remember(self) -> Callable[[], None]:
        """Notes how the camera is set; gives what sets it so again."""


class GenicamKnobs:
    """Those of a camera behind Aravis."""

    def __init__(self, opened: Callable[[], AravisCamera | None]) -> None:
        """Takes what gives the opened camera, None while it is gone."""
        self._opened = opened

    def value(self, name: str) -> float | None:
        """Reads one; see `Knobs`."""
        camera, feature = self._feature(name)
        return None if camera is None or feature is None else float(camera.get(feature))

    def bounds(self, name: str) -> Bounds | None:
        """Gives the least and the greatest value; see `Knobs`."""
        camera, feature = self._feature(name)
        return None if camera is None or feature is None else camera.bounds(feature)

    def turn(self, name: str, value: float) -> None:
        """Sets one; see `Knobs`."""
        camera, feature = self._feature(name)
        if camera is None or feature is None:
            raise GrabberError(f"has no {name}")
        if camera.has(_AUTOMATIC[name]):
            camera.set(_AUTOMATIC[name], "Off")
        camera.set(feature, f"{value:.0f}" if float(value).is_integer() else repr(value))

    def remember(self) -> Callable[[], None]:
        """Notes how the camera is set; see `Knobs`."""
        camera = self._opened()
        names = [name for names in _FEATURES.values() for name in names]
        # What a camera does by itself is taken up last: until then it could not be set.
        names += _AUTOMATIC.values()
        kept = [(name, camera.get(name)) for name in names if camera and camera.has(name)]

        def put_back() -> None:
            now = self._opened()
            if now is None:
                raise GrabberError("is gone: its exposure and gain are not put back")
            _each(lambda name, value: now.set(name, value), kept)

        return put_back

    def _feature(self, name: str) -> tuple[AravisCamera | None, str | None]:
        camera = self._opened()
        if camera is None:
            return None, None
        return camera, next((f for f in _FEATURES[name] if camera.has(f)), None)


class V4l2Knobs:
    """Those of a V4L2 device, which hears beside whoever takes its pictures."""

    def __init__(self, device: Device) -> None:
        """Takes the device."""
        self._device = device

    def value(self, name: str) -> float | None:
        """Reads one; see `Knobs`."""
        value = self._device.get(_CONTROLS[name])
        return None if value is None else value * _UNITS[name]

    def bounds(self, name: str) -> Bounds | None:
        """Gives the least and the greatest value; see `Knobs`."""
        bounds = self._device.bounds(_CONTROLS[name])
        return None if bounds is None else (bounds[0] * _UNITS[name], bounds[1] * _UNITS[name])

    def turn(self, name: str, value: float) -> None:
        """Sets one; see `Knobs`."""
        control, manual = _MANUAL[name]
        if self._device.get(control) is not None:
            self._device.set(control, manual)
        if not self._device.set(_CONTROLS[name], max(round(value / _UNITS[name]), 0)):
            raise GrabberError(f"does not take {name} {value:g}")

    def remember(self) -> Callable[[], None]:
        """Notes how the camera is set; see `Knobs`."""
        controls = [*_CONTROLS.values(), *(control for control, _ in _MANUAL.values())]
        kept = [(control, self._device.get(control)) for control in controls]

        def put_back() -> None:
            for control, value in kept:
                if value is not None:
                    self._device.set(control, value)

        return put_back


def _each(set_one: Callable[[str, str], None], kept: Iterable[tuple[str, str]]) -> None:
    """Sets all; what cannot be set while the camera does it by itself need not be."""
    for name, value in kept:
        try:
            set_one(name, value)
        except AravisError:
            continue
