"""Opens any kind of camera that a user names; tracking sessions of uncalibrated cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError, UsageError
from vsense.config import resources as resources_file
from vsense.vision.cameras import aravis, v4l2
from vsense.vision.cameras.aravis import AravisError
from vsense.vision.cameras.aravis_camera import AravisCamera, is_address
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.controls import CameraControls, GenicamControls, V4l2Controls
from vsense.vision.cameras.discovery import RATE_HZ, rate_of
from vsense.vision.cameras.genicam import FREE, SOFTWARE, GenicamSettings, GenicamSource
from vsense.vision.cameras.networks import (
    HELD,
    ListedCamera,
    NetworkLoad,
    controlled,
    heard,
    networks,
    stranded,
)
from vsense.vision.cameras.opencv_source import Controls, teach_opencv
from vsense.vision.cameras.picture import PictureError
from vsense.vision.cameras.source import Shot, Source
from vsense.vision.cameras.v4l2 import V4l2ControlDevice
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


def make(spec: GrabberSpec, clock: Callable[[], int] = host_ns) -> OpenCamera:
    """Makes the source of a camera's pictures; it is not open yet."""
    teach_opencv()
    source = make_source(spec, clock, NetworkLoad())
    if isinstance(source, GenicamSource):
        controls = GenicamControls(lambda: source.camera)
        return OpenCamera(spec.id, source, controls, spec.frame_rate_hz)
    return OpenCamera(spec.id, source, _v4l2_controls(spec.source), spec.frame_rate_hz)


def choose(id: str, wanted: Controls, resources: str | None = None) -> GrabberSpec:
    """Finds the camera that a user means by an id of `vsense.commands.cameras`.

    With the path of a resources file, one of its grabbers is meant. `wanted` are settings from the
    command line.

    Raises:
        UsageError: There is no such camera, or the file cannot be read.
        ConfigError: The resources file is wrong.
        GrabberError: The camera exists and does not open.
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
    """Lists the cameras, for an error message."""
    known = [camera.id for camera in listed] + [device.path for device in v4l2.devices()]
    if not known:
        return "there are none; see vsense cameras"
    return f"there {'is' if len(known) == 1 else 'are'} {', '.join(known)}"


def _of_file(id: str, wanted: Controls, path: str) -> GrabberSpec:
    """Chooses a grabber of a resources file; the command line's settings come first."""
    resources = resources_file.load(path)
    live = {name: spec for name, spec in resources.grabbers.items() if spec.is_live}
    if id not in live:
        known = ", ".join(live) or "none"
        are = "is" if len(live) == 1 else "are"
        raise UsageError(f"no camera {id!r} among the grabbers of {path}: there {are} {known}")
    spec = live[id]
    asked = {name: value for name, value in asdict(wanted).items() if value is not None}
    controls = replace(spec.controls, **asked)
    settings: Controls | GenicamSettings = controls
    if isinstance(spec.settings, GenicamSettings):
        settings = replace(spec.settings, controls=controls)
    return free(replace(spec, settings=settings, frame_rate_hz=controls.rate_hz))


def free(spec: GrabberSpec) -> GrabberSpec:
    """Has a single camera run freely that a session would trigger by software."""
    settings = spec.settings
    if not isinstance(settings, GenicamSettings) or settings.trigger != SOFTWARE:
        return spec
    return replace(spec, settings=replace(settings, trigger=FREE))


def _v4l2_controls(device: str) -> CameraControls | None:
    """Opens the controls of a device node; streams have none."""
    path = v4l2.node(device)
    if not path.startswith("/dev/"):
        return None
    try:
        return V4l2Controls(V4l2ControlDevice(path))
    except OSError:
        # Then its pictures do not come either, which is an error of its own.
        return None
