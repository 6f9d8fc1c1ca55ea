"""Makes the live cameras of a tracking session: their sources, what they share, their trigger."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from vsense.cameras import aravis
from vsense.cameras.aravis_camera import is_address
from vsense.cameras.genicam import FREE, SOFTWARE, GenicamSettings, GenicamSource
from vsense.cameras.gige import ListedCamera
from vsense.cameras.live_grabber import LiveGrabber, SoftwareTrigger
from vsense.cameras.networks import USUAL_PACKET, BandwidthError, NetworkLoad, Stream
from vsense.cameras.opencv_source import DeviceSource
from vsense.cameras.source import Source
from vsense.config.tracking_specs import CameraTrackerSpec, GrabberSpec, TrackingSession


def make_source(spec: GrabberSpec, clock: Callable[[], int], links: NetworkLoad) -> Source:
    """Makes the source of a grabber that is a camera.

    Args:
        spec: the grabber.
        clock: the host's monotonic clock [ns].
        links: the networks that the cameras share.
    """
    if isinstance(spec.settings, GenicamSettings):
        return GenicamSource(spec.source, spec.settings, clock, links)
    return DeviceSource(spec.source, spec.controls)


def live_grabber(
    session: TrackingSession, sizes_px: Mapping[str, tuple[int, int]], clock: Callable[[], int]
) -> LiveGrabber:
    """Starts all cameras of a session.

    Args:
        session: its views are all live.
        sizes_px: width and height by the cameras' ids.
        clock: the host's monotonic clock [ns].

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
        known = [c.address for c in there if grabber.source in c.names]
        address = grabber.source if is_address(grabber.source) else next(iter(known), "")
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
    size_px = grabber.controls.size_px or (view.camera.width_px, view.camera.height_px)
    packet = grabber.settings.packet_size or USUAL_PACKET
    try:
        links.claim(grabber.source, address, Stream(size_px, _rate(grabber), packet))
    except BandwidthError as error:
        raise session.resources.error(grabber.line, f"<grabber> frame_rate: {error}") from None


def _rate(grabber: GrabberSpec) -> float:
    assert grabber.frame_rate_hz is not None
    return grabber.frame_rate_hz
