"""The resources file: every picture source, tracker and camera that a laboratory has.

Thesis, 2.2.2. The file only declares; an experiment file (`tracking_session`) says by id what is
used. So pictures and camera files are looked at when they are used, not when they are declared.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from vsense.config import camera_grabbers
from vsense.config.element import Element
from vsense.config.tracking_specs import (
    CAMERA_TYPES,
    GRABBER_TYPES,
    CameraSpec,
    GrabberSpec,
    Resources,
    TrackerSpec,
)
from vsense.config.xml import parse
from vsense.errors import UsageError
from vsense.tracking.camera import Camera, CameraError
from vsense.tracking.families import FamilyError, MarkerFamily, SquareFamily, load_family

DEFAULT_HEIGHT_M = 0.06
DEFAULT_SPEED_M_S = 0.25
"""An e-puck drives 0.13 m/s, with a margin."""

_MAX_TAG = 65_535
_RANGE = re.compile(r"([0-9]{1,9})(?:-([0-9]{1,9}))?")


def load(path: str | Path) -> Resources:
    """Reads a resources file.

    Raises:
        UsageError: it cannot be read.
        ConfigError: it is wrong; the error names file, line, value and expectation.
    """
    return read(read_bytes(path), str(path), Path(path).parent)


def read_bytes(path: str | Path) -> bytes:
    """Reads a file that the user named.

    Raises:
        UsageError: it cannot be read.
    """
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is no path"
        raise UsageError(f"{path}: cannot be read: {reason}") from None


def read(data: bytes, file: str, folder: Path) -> Resources:
    """Reads a resources file from its bytes.

    Args:
        data: the XML.
        file: what errors call the file.
        folder: what its relative paths start from.

    Raises:
        ConfigError: the file is wrong.
    """
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
    )
    root.check_all_read()
    return resources


def load_camera(resources: Resources, spec: CameraSpec) -> Camera:
    """Reads a camera's calibration; the camera gets the id of the resources file.

    Raises:
        ConfigError: the camera file cannot be read, or describes no camera.
    """
    subject = f"<camera> calibration: {spec.calibration}"
    try:
        camera = Camera.from_json(spec.calibration.read_text(encoding="utf-8"))
    except OSError as error:
        raise resources.error(spec.line, f"{subject} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise resources.error(spec.line, f"{subject} is no text") from None
    except CameraError as error:
        raise resources.error(spec.line, f"{subject}: {error}") from None
    return Camera(**{name: getattr(camera, name) for name in Camera.__slots__} | {"id": spec.id})


def check_recording(resources: Resources, spec: GrabberSpec) -> None:
    """Refuses a recording that is not there.

    Raises:
        ConfigError: its directory, video or table of timestamps does not exist.
    """
    kinds = {"directory": (os.path.isdir, "path"), "video": (os.path.isfile, "path")}
    exists, key = kinds[spec.type]
    if not exists(spec.source):
        message = f"<grabber> {key}: there is no {spec.type} {spec.source}"
        raise resources.error(spec.line, message)
    if spec.timestamps is not None and not spec.timestamps.is_file():
        message = f"<grabber> timestamps: there is no file {spec.timestamps}"
        raise resources.error(spec.line, message)


def _section(root: Element, name: str, kind: str) -> dict[str, Element]:
    """Gives the elements of one section by their ids, in the file's order."""
    found: dict[str, Element] = {}
    for element in root.child(name).children(kind):
        id = element.text("id", None, "a name that the experiment file refers to")
        if id in found:
            raise element.error(f"{id!r} is there already, in line {found[id].line}", "id")
        found[id] = element
    return found


def _read_grabber(id: str, element: Element, folder: Path) -> GrabberSpec:
    kind = element.choice("type", GRABBER_TYPES)
    if kind in CAMERA_TYPES:
        return camera_grabbers.read(id, kind, element)
    rate_hz = camera_grabbers.rate_hz(element)
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
    """Gives the family's name or path, and the family."""
    name = element.text("family", "arrow4x4")
    if name.endswith(".json"):
        name = str(folder / name)
    try:
        return name, load_family(name)
    except FamilyError as error:
        raise element.error(str(error), "family") from None


def _read_heading(element: Element, family: MarkerFamily | SquareFamily) -> float:
    """Reads how the markers are turned on their robots."""
    if element.has("heading") and not isinstance(family, SquareFamily):
        raise element.error(f"is for square markers, those of {family.name} show it", "heading")
    return element.number("heading", -360.0, 360.0, "degrees", 0.0)


def _read_tags(element: Element, known: int) -> list[int]:
    """Reads tags and ranges of tags, such as "1-15 22, 40"."""
    text = element.text("tags", None, "tags such as '1-15 22'")
    tags: dict[int, None] = {}
    highest = min(known - 1, _MAX_TAG)
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
