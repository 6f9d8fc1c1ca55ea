"""Opens the camera that a user names, whatever kind it is, and makes tracking sessions of cameras
that nobody has calibrated."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from vsense.cameras import aravis, v4l2
from vsense.cameras.aravis import AravisError
from vsense.cameras.aravis_camera import AravisCamera, is_address
from vsense.cameras.camera import Camera
from vsense.cameras.controls import CameraControls, GenicamControls, V4l2Controls
from vsense.cameras.discovery import RATE_HZ, rate_of
from vsense.cameras.genicam import FREE, SOFTWARE, GenicamSettings, GenicamSource
from vsense.cameras.gige import HELD, ListedCamera, controlled, heard
from vsense.cameras.grabber import GrabberError
from vsense.cameras.networks import NetworkLoad, networks, stranded
from vsense.cameras.opencv_source import Controls, teach_opencv
from vsense.cameras.picture import PictureError
from vsense.cameras.source import Shot, Source
from vsense.cameras.v4l2 import V4l2ControlDevice
from vsense.config import resources as resources_file
from vsense.errors import UsageError
from vsense.tracking.opening import make_source
from vsense.tracking.specs import (
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
"""So high they hang as far as anybody is told."""
NO_TRACKER = "not calibrated"

Size = tuple[int, int]


def session_of(
    name: str,
    specs: Sequence[GrabberSpec],
    sizes_px: Mapping[str, Size],
    px_per_m: float | None = None,
) -> TrackingSession:
    """Makes a tracking session that looks straight down through cameras, and tracks nobody.

    Args:
        name: what it is called.
        specs: the cameras' grabbers.
        sizes_px: width and height of their pictures, by their ids.
        px_per_m: the pictures' scale, where it is known.
    """
    tracker = TrackerSpec(NO_TRACKER, "", 0.0, {}, 1.0, True, 0)
    views = tuple(
        CameraTrackerSpec(spec, _camera(spec.id, sizes_px[spec.id], px_per_m), tracker, spec.line)
        for spec in specs
    )
    record = RecordSpec(False, False, Path(), "png", 0)
    resources = Resources(name, {spec.id: spec for spec in specs}, {}, {})
    return TrackingSession(name, resources, 0, 1, 0.3, views, record)


def sizes_of(session: TrackingSession) -> dict[str, Size]:
    """Gives width and height of all cameras' pictures, by their ids."""
    return {v.camera.id: (v.camera.width_px, v.camera.height_px) for v in session.views}


def _camera(id: str, size_px: Size, px_per_m: float | None) -> Camera:
    focal_px = float(max(size_px)) if px_per_m is None else AWAY_M * px_per_m
    return Camera.looking_down(id, 0.0, 0.0, AWAY_M, focal_px, size_px)


MOST_DAMAGED = 20
"""A camera that gives so many damaged pictures in a row gives no pictures."""

NODE_DIGITS = 4
"""A number that is shorter is one of /dev/video*, a longer one a serial number."""


class OpenCamera:
    """A camera's pictures, and its controls while it is open; for one thread.

    Attributes:
        id: what the user calls it.
        source: its pictures.
        controls: exposure and gain; None: it has no such.
        rate_hz: pictures per second that it was asked for, where it was.
    """

    def __init__(
        self, id: str, source: Source, controls: CameraControls | None, rate_hz: float | None = None
    ) -> None:
        self.id = id
        self.source = source
        self.controls = controls
        self.rate_hz = rate_hz

    def open(self) -> list[str]:
        """Opens it; see `vsense.cameras.source.Source.open`.

        Raises:
            GrabberError: it does not open; names it.
        """
        try:
            return self.source.open()
        except GrabberError as error:
            raise self.named(error) from None

    def named(self, error: GrabberError) -> GrabberError:
        """Gives an error that says which camera it is about."""
        text = str(error)
        return error if text.startswith(self.id) else GrabberError(f"{self.id}: {text}")

    def picture(self) -> Shot:
        """Waits for a good picture.

        Raises:
            GrabberError: the camera is gone, or gives damaged ones only; names it.
        """
        reason = ""
        for _ in range(MOST_DAMAGED):
            try:
                return self.source.read()
            except PictureError as error:
                reason = str(error)
            except GrabberError as error:
                raise self.named(error) from None
        raise GrabberError(f"{self.id}: gives damaged pictures only: {reason}")


def make(spec: GrabberSpec, clock: Callable[[], int] = time.monotonic_ns) -> OpenCamera:
    """Makes the source of a camera's pictures; it is not open yet."""
    teach_opencv()
    source = make_source(spec, clock, NetworkLoad())
    if isinstance(source, GenicamSource):
        return OpenCamera(
            spec.id, source, GenicamControls(lambda: source.camera), spec.frame_rate_hz
        )
    return OpenCamera(spec.id, source, _v4l2_controls(spec.source), spec.frame_rate_hz)


def choose(id: str, wanted: Controls, resources: str | None = None) -> GrabberSpec:
    """Finds out which camera a user means.

    Args:
        id: see `vsense.commands.cameras`.
        wanted: what it is asked for on the command line.
        resources: path of the resources file whose grabbers are meant.

    Raises:
        UsageError: there is no such camera, or the file cannot be read.
        ConfigError: the resources file is wrong.
        GrabberError: it is there and does not open.
    """
    if resources is not None:
        return _of_file(id, wanted, resources)
    if "://" in id:
        return GrabberSpec.of_camera(id, CAMERA, id, wanted)
    node = v4l2.node(id) if len(id) < NODE_DIGITS else id
    if node.startswith("/dev/"):
        if not Path(node).exists():
            raise UsageError(f"no camera {node}: {_known(())}")
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
        raise UsageError(f"no camera {id!r}: {_known(listed)}{missing}")
    device = (mine[0].address or mine[0].id) if mine else id
    if is_address(device) and controlled(device):
        raise GrabberError(f"{id}: {HELD}")
    try:
        camera = AravisCamera(device)
    except AravisError as error:
        if mine:
            lost = stranded(mine[0].address, networks())
            raise GrabberError(f"{id}: {lost or error}") from None
        raise UsageError(f"no camera answers at {id}: {_known(listed)}") from None
    try:
        rate_hz = wanted.rate_hz or rate_of(camera) or RATE_HZ
    finally:
        camera.close()
    settings = GenicamSettings(replace(wanted, rate_hz=rate_hz))
    return GrabberSpec.of_camera(id, GENICAM, device, settings)


def _known(listed: Sequence[ListedCamera]) -> str:
    """Says which cameras there are."""
    known = [camera.id for camera in listed] + [device.path for device in v4l2.devices()]
    if not known:
        return "there are none; see vsense cameras"
    return f"there {'is' if len(known) == 1 else 'are'} {', '.join(known)}"


def _of_file(id: str, wanted: Controls, path: str) -> GrabberSpec:
    """Chooses what a resources file says, and sets what the command line says otherwise."""
    resources = resources_file.load(path)
    live = {name: spec for name, spec in resources.grabbers.items() if spec.is_live}
    if id not in live:
        known = ", ".join(live) or "none"
        are = "is" if len(live) == 1 else "are"
        raise UsageError(f"no camera {id!r} among the grabbers of {path}: there {are} {known}")
    spec = live[id]
    controls = _over(spec.controls, wanted)
    settings: Controls | GenicamSettings = controls
    if isinstance(spec.settings, GenicamSettings):
        settings = replace(spec.settings, controls=controls)
    return free(replace(spec, settings=settings, frame_rate_hz=controls.rate_hz))


def free(spec: GrabberSpec) -> GrabberSpec:
    """Has a camera run freely whose session would trigger it: one alone has nobody who does."""
    settings = spec.settings
    if not isinstance(settings, GenicamSettings) or settings.trigger != SOFTWARE:
        return spec
    return replace(spec, settings=replace(settings, trigger=FREE))


def _over(controls: Controls, wanted: Controls) -> Controls:
    """Gives what is wanted, and what the file says of the rest."""
    return Controls(
        wanted.size_px or controls.size_px,
        wanted.rate_hz or controls.rate_hz,
        controls.exposure_us if wanted.exposure_us is None else wanted.exposure_us,
        controls.gain_raw if wanted.gain_raw is None else wanted.gain_raw,
    )


def _v4l2_controls(device: str) -> CameraControls | None:
    """Opens the controls of a device node; streams have none."""
    path = v4l2.node(device)
    if not path.startswith("/dev/"):
        return None
    try:
        return V4l2Controls(V4l2ControlDevice(path))
    except OSError:
        # Then its pictures do not come, either, and that is told.
        return None
