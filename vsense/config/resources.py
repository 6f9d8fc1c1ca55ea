"""The resources file: every picture source, tracker and camera that a laboratory has.

Thesis, 2.2.2. The file only declares; an experiment file (`tracking_session`) says by id what is
used. Pictures and camera files are read when they are used, not when they are declared.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from vsense.base import files
from vsense.base.errors import UsageError
from vsense.base.native import kernels
from vsense.base.xml.element import Element
from vsense.base.xml.parsing import parse
from vsense.vision.cameras.camera import Camera, CameraError
from vsense.vision.cameras.source import (
    FREE,
    PIXEL_FORMATS,
    Controls,
    GenicamSettings,
    attribute_of,
)
from vsense.vision.markers.families import FamilyError, MarkerFamily, SquareFamily, load_family
from vsense.vision.tracking.node_session import NODE_NAME, NodeNetwork, check_endpoint
from vsense.vision.tracking.specs import (
    CAMERA,
    CAMERA_TYPES,
    DIRECTORY,
    GENICAM,
    GRABBER_TYPES,
    NODE,
    NODE_TYPES,
    CameraSpec,
    GrabberSpec,
    Resources,
    TrackerSpec,
)

RATES_HZ = (0.01, 1000.0)
EXPOSURE_RANGE_US = (1.0, 1e7)
GAIN_RANGE = (-1000.0, 1e6)
"""In cameras' own units; where that is dB a gain may be negative."""
SIDES_PX = (1, 20_000)

_PACKET_BYTES = (576, 9216)
"""What every link carries, and what none exceeds. Source: RFC 791; jumbo frames."""


def read_camera_grabber(id: str, kind: str, element: Element) -> GrabberSpec:
    """Reads a grabber whose `kind` is `CAMERA` or `GENICAM`."""
    expected = {
        CAMERA: "a device such as '/dev/video0', or a URL",
        GENICAM: "an IP address, or an id that 'vsense camera list' shows",
    }
    device = element.text("device", None, expected[kind])
    controls = _controls(element, rate_needed=kind == GENICAM)
    settings = _genicam(element, controls) if kind == GENICAM else controls
    return GrabberSpec.of_camera(id, kind, device, settings, element.line)


def read_rate_hz(element: Element) -> float | None:
    """Reads `frame_rate`, where there is one."""
    return _optional(element, "frame_rate", *RATES_HZ, "pictures per second")


def _controls(element: Element, rate_needed: bool) -> Controls:
    size_px = None
    if element.has("width") or element.has("height"):
        width = element.integer("width", *SIDES_PX)
        size_px = (width, element.integer("height", *SIDES_PX))
    rate = read_rate_hz(element)
    if rate_needed and rate is None:
        raise element.error(
            "is missing, expected pictures per second: what the network carries, and whether the"
            " camera is too slow, is judged by it",
            "frame_rate",
        )
    return Controls(
        size_px=size_px,
        rate_hz=rate,
        exposure_us=_optional(element, "exposure_time_abs", *EXPOSURE_RANGE_US, "microseconds"),
        gain_raw=_optional(element, "gain_raw", *GAIN_RANGE, ""),
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
        features=tuple(_feature(feature) for feature in element.children("feature")),
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


DEFAULT_HEIGHT_M = 0.06
DEFAULT_SPEED_M_S = 0.25
"""An e-puck drives 0.13 m/s, with a margin."""

_MAX_TAG = 65_535
_RANGE = re.compile(r"([0-9]{1,9})(?:-([0-9]{1,9}))?")


def load(path: str | Path) -> Resources:
    """Reads a resources file; raises UsageError where it cannot be read."""
    return read(read_bytes(path), str(path), Path(path).parent)


def read_bytes(path: str | Path) -> bytes:
    """Reads a file that the user named; raises UsageError where it cannot be read."""
    try:
        return files.read_bytes(Path(path))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is no path"
        raise UsageError(f"{path}: cannot be read: {reason}") from None


def read(data: bytes, file: str, folder: Path) -> Resources:
    """Reads a resources file from its bytes; relative paths start from `folder`."""
    root = parse(data, file)
    if root.name != "arena_tracking_system":
        raise root.error("is the outermost element, expected <arena_tracking_system>")
    grabbers = _section(root, "grabbers", "grabber")
    trackers = _section(root, "trackers", "tracker")
    cameras = _section(root, "cameras", "camera")
    resources = Resources(
        file=file,
        grabbers={id: _read_grabber(id, e, folder) for id, e in grabbers.items()},
        trackers={id: _read_tracker(id, e, folder) for id, e in trackers.items()},
        cameras={
            id: CameraSpec(id, folder / e.text("calibration", None, "a camera file"), e.line)
            for id, e in cameras.items()
        },
        network=_read_network(root, folder),
    )
    root.check_all_read()
    return resources


def load_camera(resources: Resources, spec: CameraSpec) -> Camera:
    """Reads a camera's calibration; the camera gets the id of the resources file.

    Raises:
        ConfigError: the camera file cannot be read, or describes no camera, or one whose pictures
            are larger than the tracker takes.
    """
    subject = f"<camera> calibration: {spec.calibration}"
    try:
        camera = Camera.from_json(files.read_text(spec.calibration))
    except FileNotFoundError:
        hint = "is not there: calibrate the cameras first, see vsense camera calibrate --help"
        raise resources.error(spec.line, f"{subject} {hint}") from None
    except OSError as error:
        raise resources.error(spec.line, f"{subject} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise resources.error(spec.line, f"{subject} is no text") from None
    except CameraError as error:
        raise resources.error(spec.line, f"{subject}: {error}") from None
    for name, side_px in (("width_px", camera.width_px), ("height_px", camera.height_px)):
        if side_px > kernels.VS_MARKERS_SIDE:
            message = f"{name} is {side_px}, expected at most {kernels.VS_MARKERS_SIDE}"
            raise resources.error(spec.line, f"{subject}: {message}")
    return Camera(**{name: getattr(camera, name) for name in Camera.__slots__} | {"id": spec.id})


def check_recording(resources: Resources, spec: GrabberSpec) -> None:
    """Raises ConfigError where a recording's directory, video or timestamps do not exist."""
    exists = os.path.isdir if spec.type == DIRECTORY else os.path.isfile
    if not exists(spec.source):
        message = f"<grabber> path: there is no {spec.type} {spec.source}"
        raise resources.error(spec.line, message)
    if spec.timestamps is not None and not os.path.isfile(spec.timestamps):
        message = f"<grabber> timestamps: there is no file {spec.timestamps}"
        raise resources.error(spec.line, message)


def _section(root: Element, name: str, kind: str) -> dict[str, Element]:
    """Gives the elements of one section by their ids, in the file's order."""
    elements: dict[str, Element] = {}
    for element in root.child(name).children(kind):
        id = element.text("id", None, "a name that the experiment file refers to")
        if id in elements:
            raise element.error(f"{id!r} is there already, in line {elements[id].line}", "id")
        elements[id] = element
    return elements


def _read_grabber(id: str, element: Element, folder: Path) -> GrabberSpec:
    kind = element.choice("type", GRABBER_TYPES)
    if kind in CAMERA_TYPES:
        return read_camera_grabber(id, kind, element)
    if kind in NODE_TYPES:
        return _read_node_grabber(id, kind, element)
    rate_hz = read_rate_hz(element)
    timestamps = folder / element.text("timestamps") if element.has("timestamps") else None
    if timestamps is not None and rate_hz is not None:
        raise element.error("stands beside 'timestamps'; expected one of the two", "frame_rate")
    return GrabberSpec(
        id=id,
        type=kind,
        source=str(folder / element.text("path", None, f"the path of the {kind}")),
        timestamps=timestamps,
        frame_rate_hz=rate_hz,
        start_s=element.number("start_time", -1e9, 1e9, "s", 0.0),
        settings=None,
        line=element.line,
    )


def _read_node_grabber(id: str, kind: str, element: Element) -> GrabberSpec:
    node = element.text("node", None, "the name of the node that has it")
    if not NODE_NAME.fullmatch(node):
        raise element.error(f"{node[:40]!r} is no name: letters, digits, '_', '.', '-'", "node")
    rate_hz = read_rate_hz(element)
    if kind == NODE and rate_hz is None:
        raise element.error(
            "is missing, expected pictures per second: by half of that time pictures of several"
            " computers belong together",
            "frame_rate",
        )
    source = element.text("grabber", id)
    return GrabberSpec(id, kind, source, None, rate_hz, 0.0, None, element.line, node)


def _read_network(root: Element, folder: Path) -> NodeNetwork | None:
    """Reads where nodes are met."""
    element = root.optional_child("nodes")
    if element is None:
        return None
    ways = {}
    for way in ("listen", "connect"):
        try:
            addresses = element.text(way).split() if element.has(way) else []
            ways[way] = tuple(map(check_endpoint, addresses))
        except UsageError as error:
            raise element.error(str(error), way) from None
    if not (ways["listen"] or ways["connect"]):
        raise element.error("is missing, expected an address such as tcp/0.0.0.0:7447", "listen")
    arena = element.text("arena", "arena")
    if not NODE_NAME.fullmatch(arena):
        raise element.error(f"{arena[:40]!r} is no name: letters, digits, '_', '.', '-'", "arena")
    config = folder / element.text("config") if element.has("config") else None
    return NodeNetwork(ways["listen"], ways["connect"], config, arena)


def _read_tracker(id: str, element: Element, folder: Path) -> TrackerSpec:
    name, family = _read_family(element, folder)
    tags = family.tags
    height_m = element.number("robot_height", 0.0, 2.0, "m", DEFAULT_HEIGHT_M)
    heights_m = dict.fromkeys(_read_tags(element, tags), height_m)
    for other in element.children("robots"):
        height_m = other.number("robot_height", 0.0, 2.0, "m")
        for tag in _read_tags(other, tags):
            if tag not in heights_m:
                raise other.error(f"{tag} is none of the tracker's tags", "tags")
            heights_m[tag] = height_m
    return TrackerSpec(
        id=id,
        family=name,
        heading_deg=_read_heading(element, family),
        heights_m=heights_m,
        max_speed_m_s=element.number("max_speed", 0.001, 100.0, "m/s", DEFAULT_SPEED_M_S),
        open_roster=element.choice("roster", ("open", "closed"), "open") == "open",
        line=element.line,
    )


def _read_family(element: Element, folder: Path) -> tuple[str, MarkerFamily | SquareFamily]:
    name = element.text("family", "arrow4x4")
    if name.endswith(".json"):
        name = str(folder / name)
    try:
        return name, load_family(name)
    except FamilyError as error:
        raise element.error(str(error), "family") from None


def _read_heading(element: Element, family: MarkerFamily | SquareFamily) -> float:
    if element.has("heading") and not isinstance(family, SquareFamily):
        raise element.error(f"is for square markers, those of {family.name} show it", "heading")
    return element.number("heading", -360.0, 360.0, "degrees", 0.0)


def _read_tags(element: Element, count: int) -> list[int]:
    """Reads tags and ranges of tags, such as "1-15 22, 40"."""
    text = element.text("tags", None, "tags such as '1-15 22'")
    tags: dict[int, None] = {}
    highest = min(count - 1, _MAX_TAG)
    for part in text.replace(",", " ").split():
        match = _RANGE.fullmatch(part)
        if match is None:
            raise element.error(f"{part[:40]!r} is not a tag or a range such as '1-15'", "tags")
        first, last = int(match[1]), int(match[2] or match[1])
        if not first <= last <= highest:
            raise element.error(f"{part!r} is not within 0-{highest}", "tags")
        for tag in range(first, last + 1):
            if tag in tags:
                raise element.error(f"{tag} is there twice", "tags")
            tags[tag] = None
    return list(tags)
