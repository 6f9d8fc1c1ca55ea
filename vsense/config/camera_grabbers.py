"""Grabbers of the resources file that are cameras: what a camera is, and what it is asked for."""

from __future__ import annotations

from vsense.config.element import Element
from vsense.config.tracking_specs import CAMERA, GENICAM, GrabberSpec
from vsense.tracking.genicam_settings import FREE, PIXEL_FORMATS, GenicamSettings, attribute_of
from vsense.tracking.grabbers_device import Controls

RATES_HZ = (0.01, 1000.0)
EXPOSURES_US = (1.0, 1e7)
GAINS = (-1000.0, 1e6)
"""In cameras' own units; where that is dB a gain may be negative."""
SIDES_PX = (1, 20_000)

_PACKET_BYTES = (576, 9216)
"""What every link carries, and what none exceeds. Source: RFC 791; jumbo frames."""


def read(id: str, kind: str, element: Element) -> GrabberSpec:
    """Reads a grabber that is a camera.

    Args:
        id: its name.
        kind: `CAMERA` or `GENICAM`.
        element: its element.

    Raises:
        ConfigError: a value is wrong; names file, line, value and expectation.
    """
    expected = {
        CAMERA: "a device such as '/dev/video0', or a URL",
        GENICAM: "an IP address, or an id that 'vsense cameras' shows",
    }
    device = element.text("device", None, expected[kind])
    controls = _controls(element, rate_needed=kind == GENICAM)
    return GrabberSpec(
        id=id,
        type=kind,
        source=device,
        timestamps=None,
        frame_rate_hz=controls.rate_hz,
        start_s=0.0,
        settings=_genicam(element, controls) if kind == GENICAM else controls,
        line=element.line,
    )


def rate_hz(element: Element) -> float | None:
    """Reads `frame_rate`, where there is one."""
    if not element.has("frame_rate"):
        return None
    return element.number("frame_rate", *RATES_HZ, "pictures per second")


def _controls(element: Element, rate_needed: bool) -> Controls:
    size_px = None
    if element.has("width") or element.has("height"):
        width = element.integer("width", *SIDES_PX)
        size_px = (width, element.integer("height", *SIDES_PX))
    rate = rate_hz(element)
    if rate_needed and rate is None:
        raise element.error(
            "is missing, expected pictures per second: what the network carries, and whether the"
            " camera is too slow, is judged by it",
            "frame_rate",
        )
    return Controls(
        size_px=size_px,
        rate_hz=rate,
        exposure_us=_optional(element, "exposure_time_abs", *EXPOSURES_US, "microseconds"),
        gain_raw=_optional(element, "gain_raw", *GAINS, ""),
    )


def _genicam(element: Element, controls: Controls) -> GenicamSettings:
    offset_px = None
    if element.has("offset_x") or element.has("offset_y"):
        offset_px = (
            element.integer("offset_x", 0, SIDES_PX[1], 0),
            element.integer("offset_y", 0, SIDES_PX[1], 0),
        )
    pixel_format, packet_size = None, None
    if element.has("pixel_format"):
        pixel_format = element.choice("pixel_format", PIXEL_FORMATS)
    if element.has("packet_size"):
        packet_size = element.integer("packet_size", *_PACKET_BYTES)
    return GenicamSettings(
        controls=controls,
        offset_px=offset_px,
        pixel_format=pixel_format,
        packet_size=packet_size,
        packet_delay_us=_optional(element, "packet_delay", 0.0, 1e6, "microseconds"),
        trigger=element.text("trigger", FREE),
        features=tuple(_feature(each) for each in element.children("feature")),
    )


def _feature(element: Element) -> tuple[str, str]:
    """Reads a feature's name and value; those with an attribute of their own are refused."""
    name = element.text("name", None, "a feature of the camera, such as BlackLevelRaw")
    own = attribute_of(name)
    if own is not None:
        raise element.error(f"{name!r} is what the grabber's attribute {own!r} sets", "name")
    return name, element.text("value", None, "what the feature is set to")


def _optional(element: Element, key: str, low: float, high: float, unit: str) -> float | None:
    return element.number(key, low, high, unit) if element.has(key) else None
