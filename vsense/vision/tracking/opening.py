"""Opens what a tracking session names: cameras or recordings, detectors and arena tracker.

This is the factory of the thesis's figure 2.11.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
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
from vsense.vision.tracking._nodes import Nodes
from vsense.vision.tracking._prediction import MarkerSearch, SearchPlan
from vsense.vision.tracking._tracks import Limits
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.vision.tracking.marker_detector import cell_width_seen
from vsense.vision.tracking.mask import Mask, outlines_px
from vsense.vision.tracking.specs import (
    DIRECTORY,
    GrabberSpec,
    Resources,
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
    with ExitStack() as stack:
        nodes = None
        if any(view.grabber.node for view in session.views):
            nodes = Nodes(session, clock, say)
            stack.callback(nodes.close)
        grabber = _grabber(session, clock, recordings, nodes)
        stack.callback(grabber.close)
        tracker = _tracker(session, nodes)
        tracking = CameraTracking(
            grabber, tracker, say, troubles, not session.is_live, nodes, _references(session)
        )
        stack.pop_all()
    return tracking


def _references(session: TrackingSession) -> ReferenceWatch:
    """Compares cameras here with their reference pictures; nodes keep their pictures."""
    files = session.resources.cameras
    here = [view.camera.id for view in session.views if not view.grabber.node]
    calibrations = {id: files[id].calibration for id in here if id in files}
    return ReferenceWatch(calibrations, session.is_live)


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
    session: TrackingSession,
    clock: Callable[[], int],
    recordings: str | float,
    nodes: Nodes | None,
) -> Grabber:
    sizes_px = {v.camera.id: (v.camera.width_px, v.camera.height_px) for v in session.views}
    if session.is_live:
        return live_grabber(session.resources, session.grabbers, sizes_px, clock, nodes)
    elsewhere = {} if nodes is None else nodes.recordings()
    here = [view for view in session.views if not view.grabber.node]
    opened = {v.camera.id: open_recording(session.resources, v.grabber) for v in here} | elsewhere
    recorded = RecordedGrabber(opened, sizes_px, clock)
    if recordings == OFFLINE:
        return recorded
    if recordings == PACED:
        return PacedGrabber(recorded, clock)
    return HeldPlayer(recorded, float(recordings), clock)


def open_recording(resources: Resources, spec: GrabberSpec) -> CameraRecording:
    """Opens a recording of this computer; ConfigError: it cannot be used."""
    kind = DirectoryRecording if spec.type == DIRECTORY else VideoRecording
    start_ns = round(spec.start_s * 1e9)
    try:
        return kind(Path(spec.source), spec.timestamps, start_ns, spec.frame_rate_hz)
    except GrabberError as error:
        raise resources.error(spec.line, f"<grabber> path: {error}") from None


def _tracker(session: TrackingSession, nodes: Nodes | None) -> ArenaTracker:
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
        elsewhere=nodes,
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
    """Makes the source of a grabber that is a camera; `links` are the networks of all cameras.

    GrabberError: it is another computer's.
    """
    if spec.node:
        raise GrabberError(
            f"{spec.id} is a camera of node {spec.node}: only that computer opens it"
        )
    if isinstance(spec.settings, GenicamSettings):
        return GenicamSource(spec.source, spec.settings, clock, links)
    return DeviceSource(spec.source, spec.settings or Controls())


def live_grabber(
    resources: Resources,
    grabbers: Mapping[str, GrabberSpec],
    sizes_px: Mapping[str, tuple[int, int]],
    clock: Callable[[], int],
    nodes: Nodes | None = None,
) -> LiveGrabber:
    """Starts cameras, all of them live; `grabbers` and `sizes_px` by the cameras' ids.

    Raises:
        ConfigError: the library for them is missing, or they would send more than their network
            carries; names the place in the resources file.
    """
    links = NetworkLoad()
    _check(resources, grabbers, sizes_px, links)
    sources: dict[str, Source] = {}
    for camera, spec in grabbers.items():
        at_node = nodes.source(camera, spec) if nodes is not None and spec.node else None
        sources[camera] = at_node or make_source(spec, clock, links)
    rates_hz = {camera: spec.frame_rate_hz for camera, spec in grabbers.items()}
    triggers = {spec.trigger for spec in grabbers.values()}
    rate_hz = next((rate_hz for rate_hz in rates_hz.values() if rate_hz is not None), None)
    if (triggers == {FREE} and nodes is None) or rate_hz is None:
        return LiveGrabber(sources, sizes_px, clock, rates_hz)
    trigger = None
    if triggers == {SOFTWARE}:
        triggered = {c: s for c, s in sources.items() if isinstance(s, GenicamSource)}
        trigger = SoftwareTrigger(triggered, rate_hz, clock)
    in_order = nodes is not None
    together_s = 0.5 / rate_hz
    return LiveGrabber(sources, sizes_px, clock, rates_hz, together_s, trigger, in_order=in_order)


def _check(
    resources: Resources,
    grabbers: Mapping[str, GrabberSpec],
    sizes_px: Mapping[str, tuple[int, int]],
    links: NetworkLoad,
) -> None:
    """Refuses what can be refused before a camera is opened."""
    genicam = {c: g for c, g in grabbers.items() if isinstance(g.settings, GenicamSettings)}
    if not genicam:
        return
    there: list[ListedCamera] = []
    try:
        aravis.load()
        if not all(is_address(grabber.source) for grabber in genicam.values()):
            there = aravis.listed()
    except aravis.AravisError as error:
        line = next(iter(genicam.values())).line
        raise resources.error(line, f"<grabber> type: {error}") from None
    first: dict[str, str] = {}
    for camera, grabber in genicam.items():
        addresses = [c.address for c in there if grabber.source in c.names]
        address = grabber.source if is_address(grabber.source) else next(iter(addresses), "")
        if not address:
            continue
        if address in first:
            text = f"{first[address]!r} and {grabber.source!r} are the same camera, at {address}"
            raise resources.error(grabber.line, f"<grabber> device: {text}")
        first[address] = grabber.source
        _claim(resources, grabber, sizes_px[camera], address, links)


def _claim(
    resources: Resources,
    grabber: GrabberSpec,
    calibrated_px: tuple[int, int],
    address: str,
    links: NetworkLoad,
) -> None:
    assert isinstance(grabber.settings, GenicamSettings)
    size_px = grabber.settings.controls.size_px or calibrated_px
    packet = grabber.settings.packet_size or USUAL_PACKET
    assert grabber.frame_rate_hz is not None
    try:
        links.claim(grabber.source, address, Stream(size_px, grabber.frame_rate_hz, packet))
    except BandwidthError as error:
        raise resources.error(grabber.line, f"<grabber> frame_rate: {error}") from None
