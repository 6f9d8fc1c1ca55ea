"""One camera of any kind, as a user names it: opened, its exposure and gain set and restored.

Also tracking sessions of cameras that are not calibrated."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from vsense.base.errors import GrabberError, UsageError
from vsense.vision.cameras import _v4l2, aravis
from vsense.vision.cameras._aravis_camera import AravisCamera, is_address
from vsense.vision.cameras._genicam import GenicamSource, digits
from vsense.vision.cameras._networks import (
    CAMERA_HELD,
    ListedCamera,
    NetworkLoad,
    controlled,
    heard,
    networks,
    stranded,
)
from vsense.vision.cameras._opencv_source import EXPOSURE_UNIT_US, teach_opencv
from vsense.vision.cameras._v4l2 import V4l2Control, V4l2ControlDevice
from vsense.vision.cameras.aravis import AravisError
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.discovery import RATE_HZ, rate_of
from vsense.vision.cameras.picture import PictureError
from vsense.vision.cameras.source import (
    AUTOMATIC,
    EXPOSURE,
    FREE,
    GAIN,
    NAMES,
    SOFTWARE,
    Bounds,
    Controls,
    GenicamSettings,
    Shot,
    Source,
)
from vsense.vision.tracking.opening import make_source
from vsense.vision.tracking.specs import (
    CAMERA,
    GENICAM,
    CameraTrackerSpec,
    GrabberSpec,
    RecordSpec,
    Resources,
    TrackerSpec,
    TrackingSession,
)

AWAY_M = 2.5
"""Assumed height of an uncalibrated camera."""
NO_TRACKER = "not calibrated"

Size = tuple[int, int]


def session_of(
    name: str,
    specs: Sequence[GrabberSpec],
    sizes_px: Mapping[str, Size],
    px_per_m: float | None = None,
) -> TrackingSession:
    """Makes a tracking session whose cameras look straight down, without robots.

    `sizes_px` are width and height of the pictures, by their cameras' ids; `px_per_m` is their
    scale.
    """
    tracker = TrackerSpec(NO_TRACKER, "", 0.0, {}, 1.0, True, 0)
    views = tuple(
        CameraTrackerSpec(spec, _camera(spec.id, sizes_px[spec.id], px_per_m), tracker, spec.line)
        for spec in specs
    )
    record = RecordSpec(False, False, Path(), "png", 0)
    resources = Resources(name, {spec.id: spec for spec in specs}, {}, {})
    return TrackingSession(name, resources, 0, 1, 0.3, views, record)


def _camera(id: str, size_px: Size, px_per_m: float | None) -> Camera:
    focal_px = float(max(size_px)) if px_per_m is None else AWAY_M * px_per_m
    return Camera.looking_down(id, 0.0, 0.0, AWAY_M, focal_px, size_px)


MOST_DAMAGED = 20
"""Damaged pictures in a row that count as none."""

NODE_DIGITS = 4
"""Shorter numbers are those of /dev/video*, longer ones are serial numbers."""


@dataclass(slots=True)
class OpenCamera:
    """A camera's pictures, and its controls (if any) while it is open; for one thread.

    `id` is the user's name of it; `rate_hz` was asked for, if known.
    """

    id: str
    source: Source
    controls: CameraControls | None
    rate_hz: float | None = None

    def open(self) -> list[str]:
        """Opens it, see `Source.open`; errors name the camera."""
        try:
            return self.source.open()
        except GrabberError as error:
            raise self.named(error) from None

    def named(self, error: GrabberError) -> GrabberError:
        """Returns an error that names the camera."""
        text = str(error)
        return error if text.startswith(self.id) else GrabberError(f"{self.id}: {text}")

    def picture(self) -> Shot:
        """Waits for a good picture; raises GrabberError, which names the camera, without one."""
        reason = ""
        for _ in range(MOST_DAMAGED):
            try:
                return self.source.read()
            except PictureError as error:
                reason = str(error)
            except GrabberError as error:
                raise self.named(error) from None
        raise GrabberError(f"{self.id}: gives damaged pictures only: {reason}")


def make(spec: GrabberSpec, clock: Callable[[], int]) -> OpenCamera:
    """Makes the source of a camera's pictures; it is not open yet. `clock` is the host's [ns]."""
    teach_opencv()
    source = make_source(spec, clock, NetworkLoad())
    if isinstance(source, GenicamSource):
        controls = GenicamControls(lambda: source.camera)
        return OpenCamera(spec.id, source, controls, spec.frame_rate_hz)
    return OpenCamera(spec.id, source, _v4l2_controls(spec.source), spec.frame_rate_hz)


def camera_named(id: str, wanted: Controls) -> GrabberSpec:
    """Finds a camera by an id or address that `find` lists, its serial number, a node, or a URL.

    Raises:
        UsageError: There is no such camera.
        GrabberError: The camera exists and does not open.
    """
    if "://" in id:
        return GrabberSpec.of_camera(id, CAMERA, id, wanted)
    node = _v4l2.node(id) if len(id) < NODE_DIGITS else id
    if node.startswith("/dev/"):
        if not os.path.exists(node):
            raise UsageError(f"no camera {node}: {_listed_text(())}")
        return GrabberSpec.of_camera(id, CAMERA, node, wanted)
    return _of_aravis(id, wanted)


def _of_aravis(id: str, wanted: Controls) -> GrabberSpec:
    """Chooses a GigE or USB3 Vision camera; it keeps its own rate where none is wanted."""
    missing, listed = "", list[ListedCamera]()
    try:
        listed = aravis.listed()
    except AravisError as error:
        missing = f"; {error}"
    mine = [camera for camera in listed if id in camera.names]
    if len(mine) > 1:
        who = " and ".join(f"{camera.id} ({camera.mac})" for camera in mine)
        raise UsageError(f"{id!r} is what {len(mine)} cameras are called: {who}")
    for far in () if mine else heard():
        text = stranded(far.address, networks())
        if text and id in far.names:
            raise GrabberError(f"{id}: {text}")
    if not mine and (missing or not is_address(id)):
        raise UsageError(f"no camera {id!r}: {_listed_text(listed)}{missing}")
    device = (mine[0].address or mine[0].id) if mine else id
    if is_address(device) and controlled(device):
        raise GrabberError(f"{id}: {CAMERA_HELD}")
    try:
        camera = AravisCamera(device)
    except AravisError as error:
        if mine:
            lost = stranded(mine[0].address, networks())
            raise GrabberError(f"{id}: {lost or error}") from None
        raise UsageError(f"no camera answers at {id}: {_listed_text(listed)}") from None
    try:
        rate_hz = wanted.rate_hz or rate_of(camera) or RATE_HZ
    finally:
        camera.close()
    settings = GenicamSettings(replace(wanted, rate_hz=rate_hz))
    return GrabberSpec.of_camera(id, GENICAM, device, settings)


def _listed_text(listed: Sequence[ListedCamera]) -> str:
    names = [camera.id for camera in listed] + [device.path for device in _v4l2.devices()]
    if not names:
        return "there are none; see vsense camera list"
    return f"there {'is' if len(names) == 1 else 'are'} {', '.join(names)}"


def free(spec: GrabberSpec) -> GrabberSpec:
    """Has a single camera run freely that a session would trigger by software."""
    settings = spec.settings
    if not isinstance(settings, GenicamSettings) or settings.trigger != SOFTWARE:
        return spec
    return replace(spec, settings=replace(settings, trigger=FREE))


def _v4l2_controls(device: str) -> CameraControls | None:
    """Opens the controls of a device node; streams have none."""
    path = _v4l2.node(device)
    if not path.startswith("/dev/"):
        return None
    try:
        return V4l2Controls(V4l2ControlDevice(path))
    except OSError:
        # Then its pictures do not come either, which is an error of its own.
        return None


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
        camera, saved, automatic = self._opened(), list[tuple[str, str, str]](), set[str]()
        for name in (EXPOSURE, GAIN):
            feature = self._feature(name)[1]
            if camera is not None and feature is not None:
                saved.append((name, feature, camera.get(feature)))
                if camera.has(AUTOMATIC[name]) and camera.get(AUTOMATIC[name]) != "Off":
                    automatic.add(name)
        # Automatic modes are restored last: values cannot be set while they are on.
        for feature in AUTOMATIC.values():
            if camera is not None and camera.has(feature):
                saved.append((feature, feature, camera.get(feature)))

        def put_back() -> None:
            now = self._opened()
            if now is None:
                raise GrabberError("the camera is gone")
            for name, feature, value in saved:
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
        saved = {name: self._device.get(control) for name, control in _CONTROLS.items()}
        modes = {name: self._device.get(control) for name, (control, _) in _MANUAL.items()}

        def put_back() -> None:
            for name, value in saved.items():
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
