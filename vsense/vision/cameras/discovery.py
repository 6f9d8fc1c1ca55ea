"""Lists cameras, and says why one cannot be used as it is."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

from vsense.base.errors import GrabberError
from vsense.vision.cameras import _networks as gige
from vsense.vision.cameras import _v4l2, aravis
from vsense.vision.cameras._aravis_camera import AravisCamera
from vsense.vision.cameras._networks import (
    CAMERA_HELD,
    ListedCamera,
    controlled,
    heard,
    networks,
    several,
    stranded,
)
from vsense.vision.cameras.aravis import AravisError
from vsense.vision.cameras.source import EXPOSURE, GAIN, NAMES, Bounds

GIGE, USB3, V4L2, URL = "GigE", "USB3", "V4L2", "URL"
DEAF = "answers to everybody, but not to this host alone: look at its network mask and the firewall"
_WORKERS = 8
"""A camera that does not answer takes seconds; the others are read meanwhile."""
RATE_HZ = 10.0
"""The thesis's rate, for a camera whose own is unknown."""


@dataclass(frozen=True, slots=True)
class Details:
    """What an open camera reports; None and empty: unknown.

    `size_px` is (width, height), `formats` are names of pixel formats, `gain` has the camera's
    unit; bounds are the least and the greatest value.
    """

    size_px: tuple[int, int] | None = None
    formats: tuple[str, ...] = ()
    rate_hz: float | None = None
    exposure_us: float | None = None
    exposure_bounds_us: Bounds | None = None
    gain: float | None = None
    gain_bounds: Bounds | None = None


@dataclass(frozen=True, slots=True)
class FoundCamera:
    """A camera that was found; texts may be empty.

    Attributes:
        id: The name in device= and in commands.
        kind: `GIGE`, `USB3`, `V4L2` or `URL`.
        address: IPv4 address of GigE, bus of the others.
        model: Vendor and model, or the device's name.
        mac: MAC address of GigE, GUID of USB3.
        trouble: Why it cannot be used as it is, without its name; empty: it can.
        name: What files call it; empty: cam1, cam2, and so on.
    """

    id: str
    kind: str
    address: str
    model: str
    serial: str = ""
    mac: str = ""
    details: Details = field(default_factory=Details)
    trouble: str = ""
    name: str = ""

    @property
    def is_genicam(self) -> bool:
        """Whether it has the features of GenICam, and can be triggered."""
        return self.kind in (GIGE, USB3)


def find() -> tuple[list[FoundCamera], str]:
    """Looks for cameras; takes a second or two.

    Returns:
        The cameras, and why GigE and USB3 Vision cameras could not be looked for, or "".
    """
    devices = [_of_v4l2(device) for device in _v4l2.devices()]
    with ThreadPoolExecutor(_WORKERS) as workers:
        answers = workers.submit(heard)
        missing, listed = "", list[ListedCamera]()
        try:
            listed = aravis.listed()
        except AravisError as error:
            missing = str(error)
        cameras = _mark_shared(listed)
        lost = _unheard(answers.result(), listed, missing)
        return [*workers.map(_asked, cameras), *lost, *devices], missing


def _unheard(
    answers: Sequence[ListedCamera], listed: Sequence[ListedCamera], missing: str
) -> list[FoundCamera]:
    """Returns the GigE cameras that answer and that Aravis does not find, with the reason."""
    listed_keys = {(camera.mac.lower(), camera.address) for camera in listed}
    there = networks()
    return [
        replace(
            _listed(camera),
            trouble=stranded(camera.address, there) or ("needs Aravis" if missing else DEAF),
        )
        for camera in answers
        if (camera.mac, camera.address) not in listed_keys
    ]


def _of_v4l2(device: _v4l2.V4l2Device) -> FoundCamera:
    details = Details(device.size_px, tuple(device.formats), device.rate_hz)
    return FoundCamera(
        device.path, V4L2, device.bus, device.name, details=details, trouble=device.trouble
    )


def _listed(listed: ListedCamera) -> FoundCamera:
    kind = GIGE if listed.protocol == gige.GIGE_PROTOCOL else USB3
    model = listed.model if listed.vendor in listed.model else f"{listed.vendor} {listed.model}"
    return FoundCamera(listed.id, kind, listed.address, model, listed.serial, listed.mac)


def _mark_shared(listed: Sequence[ListedCamera]) -> list[FoundCamera]:
    marked = []
    for camera in listed:
        same = [other for other in listed if camera.address and other.address == camera.address]
        trouble = several(f"the address {camera.address}", same) if len(same) > 1 else ""
        marked.append(replace(_listed(camera), trouble=trouble))
    return marked


def _asked(camera: FoundCamera) -> FoundCamera:
    """Opens a camera to read its details, or adds the reason why it does not open."""
    if camera.trouble:
        return camera
    # Opening a camera that another program controls takes seconds and disturbs that program.
    if camera.kind == GIGE and controlled(camera.address):
        return replace(camera, trouble=CAMERA_HELD)
    try:
        opened = AravisCamera(camera.address or camera.id)
        try:
            return replace(camera, details=read(opened))
        finally:
            opened.close()
    except GrabberError as error:
        # A camera of another network may be reached through a router; only where it does not answer
        # is the network the trouble.
        lost = stranded(camera.address, networks()) if camera.kind == GIGE else ""
        return replace(camera, trouble=lost or f"does not open: {error}")


def read(camera: AravisCamera) -> Details:
    """Reads the details of an open camera; raises AravisError where it does not answer."""
    exposure_us, exposure_bounds_us = _number(camera, NAMES[EXPOSURE])
    gain, gain_bounds = _number(camera, NAMES[GAIN])
    return Details(
        (int(camera.get("Width")), int(camera.get("Height"))),
        tuple(camera.formats()),
        rate_of(camera),
        exposure_us,
        exposure_bounds_us,
        gain,
        gain_bounds,
    )


def rate_of(camera: AravisCamera) -> float | None:
    """Returns the pictures per second of an open camera; None: unknown."""
    try:
        return camera.rate_hz
    except AravisError:
        # Some cameras have the feature only while they run freely, or never.
        return None


def _number(camera: AravisCamera, names: Sequence[str]) -> tuple[float | None, Bounds | None]:
    """Reads the first of some features that the camera has."""
    name = next((feature for feature in names if camera.has(feature)), None)
    if name is None:
        return None, None
    return float(camera.get(name)), camera.bounds(name)
