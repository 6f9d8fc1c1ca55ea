"""Opens what a tracking session names: cameras or recordings, detectors and arena tracker.

This is the factory of the thesis's figure 2.11.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from statistics import median

from vsense.base.errors import ConfigError, GrabberError
from vsense.vision.cameras import aravis
from vsense.vision.cameras._aravis_camera import is_address
from vsense.vision.cameras._genicam import GenicamSource
from vsense.vision.cameras._live_grabber import LiveGrabber, SoftwareTrigger
from vsense.vision.cameras._networks import (
    USUAL_PACKET,
    BandwidthError,
    ListedCamera,
    NetworkLoad,
    Stream,
)
from vsense.vision.cameras._opencv_source import DeviceSource, teach_opencv
from vsense.vision.cameras._paced_grabber import HeldPlayer, PacedGrabber
from vsense.vision.cameras._recorded_grabber import CameraRecording, RecordedGrabber
from vsense.vision.cameras._recordings import DirectoryRecording, VideoRecording
from vsense.vision.cameras._reference import ReferenceWatch
from vsense.vision.cameras.grabber import Grabber, Troubles
from vsense.vision.cameras.source import FREE, SOFTWARE, Controls, GenicamSettings, Source
from vsense.vision.markers.families import SquareFamily, load_family
from vsense.vision.tracking._legibility import legibility
from vsense.vision.tracking._prediction import MarkerSearch, SearchPlan
from vsense.vision.tracking._tracks import Limits
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.vision.tracking.marker_detector import cell_width_seen
from vsense.vision.tracking.mask import Mask, outlines_px
from vsense.vision.tracking.specs import (
    DIRECTORY,
    CameraTrackerSpec,
    GrabberSpec,
    TrackerSpec,
    TrackingSession,
)

_PAINTS = "vsense camera calibrate check --tracking paints it"
OFFLINE = "offline"
PACED = "paced"


def open_tracking(
    session: TrackingSession,
    clock: Callable[[], int],
    say: Callable[[str], None],
    recordings: str | float = OFFLINE,
    troubles: Troubles | None = None,
) -> CameraTracking:
    """Opens a session's cameras or recordings and gets everything ready.

    A camera that does not open is reported and tried again. One whose pictures show the markers too
    small is refused; that of a recording is told.

    Args:
        clock: the host's monotonic clock [ns].
        say, troubles: see `CameraTracking`.
        recordings: how recordings are handed out. `OFFLINE`: as fast as they are asked for.
            `PACED`: as they were taken, from the first `next` on. A number: their first pictures
            so often [s] until `CameraTracking.start`, then as they were taken, dated by the clock.

    Raises:
        ConfigError: a recording or a camera cannot be used; names the place in the resources file.
        VsenseError: something else cannot be used.
    """
    teach_opencv()
    _check_cells(session, say)
    grabber = _grabber(session, clock, recordings)
    try:
        tracker = _tracker(session)
    except BaseException:
        grabber.close()
        raise
    files = session.resources.cameras
    calibrations = {c: files[c].calibration for v in session.views if (c := v.camera.id) in files}
    references = ReferenceWatch(calibrations, session.is_live)
    return CameraTracking(grabber, tracker, say, troubles, not session.is_live, references)


def _check_cells(session: TrackingSession, say: Callable[[str], None]) -> None:
    """Refuses cameras that see their markers too small to be named, and tells of small ones."""
    for view in session.views:
        height_m = min(view.tracker.heights_m.values(), default=0.0)
        family = load_family(view.tracker.family)
        width, text = cell_width_seen(family, view.camera, height_m)
        if width.is_illegible and view.grabber.is_live:
            message = f"<camera_state_tracker> camera: {view.camera.id!r}: {text}"
            raise ConfigError(session.file, view.line, message)
        if width.is_small:
            say(f"camera {view.camera.id}: {text}")
        elif words := legibility(family, view.camera, height_m, session.mask).in_words():
            say(f"camera {view.camera.id}: {words} ({_PAINTS})")


def _grabber(
    session: TrackingSession, clock: Callable[[], int], recordings: str | float
) -> Grabber:
    sizes_px = {v.camera.id: (v.camera.width_px, v.camera.height_px) for v in session.views}
    if session.is_live:
        return live_grabber(session, sizes_px, clock)
    opened = {v.camera.id: _recording(session, v.grabber) for v in session.views}
    recorded = RecordedGrabber(opened, sizes_px, clock)
    if recordings == OFFLINE:
        return recorded
    if recordings == PACED:
        return PacedGrabber(recorded, clock)
    return HeldPlayer(recorded, float(recordings), clock)


def _recording(session: TrackingSession, spec: GrabberSpec) -> CameraRecording:
    kind = DirectoryRecording if spec.type == DIRECTORY else VideoRecording
    start_ns = round(spec.start_s * 1e9)
    try:
        return kind(Path(spec.source), spec.timestamps, start_ns, spec.frame_rate_hz)
    except GrabberError as error:
        raise session.resources.error(spec.line, f"<grabber> path: {error}") from None


def _tracker(session: TrackingSession) -> ArenaTracker:
    views = session.views
    mask = session.mask
    searches = {view.tracker.id: _search(view.tracker, mask) for view in views}
    return ArenaTracker.of_searches(
        [view.camera for view in views],
        [searches[view.tracker.id] for view in views],
        Limits(max(view.tracker.max_speed_m_s for view in views)),
        SearchPlan(session.key_frame_period, session.square_size_m),
        pin=True,
        offsets=session.offsets,
    )


def _search(tracker: TrackerSpec, mask: Mask | None) -> MarkerSearch:
    family = load_family(tracker.family)
    if isinstance(family, SquareFamily):
        family = replace(family, heading_deg=family.heading_deg + tracker.heading_deg)
    return MarkerSearch(family, tracker.heights_m, tracker.open_roster, mask=mask)


def masks_px(session: TrackingSession) -> dict[str, list[list[tuple[float, float]]]] | None:
    """Gives by camera the polygons in which its markers are looked for; None: everywhere."""
    mask = session.mask
    if mask is None:
        return None
    polygons = {}
    for view in session.views:
        heights_m = view.tracker.heights_m.values()
        polygons[view.camera.id] = outlines_px(
            mask, view.camera, median(heights_m) if heights_m else 0.0
        )
    return polygons


def make_source(spec: GrabberSpec, clock: Callable[[], int], links: NetworkLoad) -> Source:
    """Makes the source of a grabber that is a camera; `links` are the networks of all cameras."""
    if isinstance(spec.settings, GenicamSettings):
        return GenicamSource(spec.source, spec.settings, clock, links)
    return DeviceSource(spec.source, spec.settings or Controls())


def live_grabber(
    session: TrackingSession,
    sizes_px: Mapping[str, tuple[int, int]],
    clock: Callable[[], int],
) -> LiveGrabber:
    """Starts all cameras of a session whose views are all live; `sizes_px` by the cameras' ids.

    Raises:
        ConfigError: the library for them is missing, or they would send more than their network
            carries; names the place in the resources file.
    """
    links = NetworkLoad()
    _check(session, links)
    sources = {v.camera.id: make_source(v.grabber, clock, links) for v in session.views}
    rates_hz = {v.camera.id: v.grabber.frame_rate_hz for v in session.views}
    triggers = {v.grabber.trigger for v in session.views}
    rate_hz = session.views[0].grabber.frame_rate_hz
    if triggers == {FREE} or rate_hz is None:
        return LiveGrabber(sources, sizes_px, clock, rates_hz)
    trigger = None
    if triggers == {SOFTWARE}:
        triggered = {c: s for c, s in sources.items() if isinstance(s, GenicamSource)}
        trigger = SoftwareTrigger(triggered, rate_hz, clock)
    return LiveGrabber(sources, sizes_px, clock, rates_hz, 0.5 / rate_hz, trigger)


def _check(session: TrackingSession, links: NetworkLoad) -> None:
    """Refuses what can be refused before a camera is opened."""
    genicam = [v for v in session.views if isinstance(v.grabber.settings, GenicamSettings)]
    if not genicam:
        return
    there: list[ListedCamera] = []
    try:
        aravis.load()
        if not all(is_address(view.grabber.source) for view in genicam):
            there = aravis.listed()
    except aravis.AravisError as error:
        line = genicam[0].grabber.line
        raise session.resources.error(line, f"<grabber> type: {error}") from None
    first: dict[str, str] = {}
    for view in genicam:
        grabber = view.grabber
        addresses = [c.address for c in there if grabber.source in c.names]
        address = grabber.source if is_address(grabber.source) else next(iter(addresses), "")
        if not address:
            continue
        if address in first:
            text = f"{first[address]!r} and {grabber.source!r} are the same camera, at {address}"
            raise session.resources.error(grabber.line, f"<grabber> device: {text}")
        first[address] = grabber.source
        _claim(session, view, address, links)


def _claim(
    session: TrackingSession, view: CameraTrackerSpec, address: str, links: NetworkLoad
) -> None:
    grabber = view.grabber
    assert isinstance(grabber.settings, GenicamSettings)
    size_px = grabber.settings.controls.size_px or (view.camera.width_px, view.camera.height_px)
    packet = grabber.settings.packet_size or USUAL_PACKET
    assert grabber.frame_rate_hz is not None
    try:
        links.claim(grabber.source, address, Stream(size_px, grabber.frame_rate_hz, packet))
    except BandwidthError as error:
        raise session.resources.error(grabber.line, f"<grabber> frame_rate: {error}") from None
