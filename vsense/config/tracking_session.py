"""The experiment file of the arena tracking system (thesis, 2.2.2): what a session uses."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar
from xml.sax.saxutils import quoteattr

from vsense.base.xml.element import Element
from vsense.base.xml.parsing import parse
from vsense.config import resources as resources_file
from vsense.config.resources import check_recording, load_camera, read_bytes
from vsense.robots.link.trackers.protocol import TRACKER_PORT
from vsense.vision.cameras.source import FREE
from vsense.vision.tracking.mask import MASK_MARGIN_M, Mask, MaskError
from vsense.vision.tracking.specs import (
    CameraSpec,
    CameraTrackerSpec,
    GrabberSpec,
    MaskSpec,
    RecordSpec,
    Resources,
    TrackerSpec,
    TrackingSession,
)

DEFAULT_DIRECTORY = "recordings"
IMAGE_FORMATS = ("png", "jpg", "pgm")
RESOURCES_FILE, EXPERIMENT_FILE = "resources.xml", "experiment.xml"
"""The two files' names in a folder that vsense has written."""
PICTURES_OF = "pictures of "
"""In a recording's resources file, what stands before a camera's id in that of its grabber."""

ARENA = "arena"
"""A mask's outline that is the experiment's arena."""

_FAR_M = 20.0
"""A corner so far from the origin is in another unit."""
_MAX_PERIOD = 10_000
_MAX_SQUARE_CM = 1000.0

Declared = TypeVar("Declared")


def load(resources_path: str | Path, experiment_path: str | Path) -> TrackingSession:
    """Reads the two files of a tracking session; raises UsageError where one cannot be read."""
    resources = resources_file.load(resources_path)
    return _load(resources, experiment_path)


def load_whole(path: str | Path) -> TrackingSession:
    """Reads a tracking session of which no experiment file is named: all that there is.

    `path` is a resources file, or a folder with `resources.xml` and perhaps `experiment.xml`, as
    recordings and `vsense camera list` have them.

    Raises:
        UsageError: a file cannot be read.
        ConfigError: it is wrong, or leaves open which camera has which pictures or tracker.
    """
    folder = Path(path)
    if not os.path.isdir(folder):
        return session_of(resources_file.load(path), folder.parent)
    resources = resources_file.load(folder / RESOURCES_FILE)
    if os.path.exists(folder / EXPERIMENT_FILE):
        return _load(resources, folder / EXPERIMENT_FILE)
    return session_of(resources, folder)


def session_of(resources: Resources, folder: Path) -> TrackingSession:
    """The session with all cameras of a resources file; raises as `load_whole`."""
    if not resources.cameras:
        raise resources.error(1, "<cameras>: declares no camera, expected one at least")
    if len(resources.trackers) != 1:
        raise resources.error(
            1,
            f"<trackers>: declares {len(resources.trackers)}, expected one; of several, an"
            " experiment file says which camera has which",
        )
    (tracker,) = resources.trackers.values()
    pairs = [(camera, _grabber_of(resources, camera)) for camera in resources.cameras.values()]
    # As if somebody had written the file, with each camera in its line of the resources: it is
    # checked like every other.
    rows = [""] * max(camera.line for camera, _ in pairs)
    for camera, grabber in pairs:
        used = {"grabber": grabber.id, "camera": camera.id, "tracker": tracker.id}
        words = " ".join(f"{key}={quoteattr(id)}" for key, id in used.items())
        rows[camera.line - 1] += f"<camera_state_tracker {words} />"
    rows[0] = f"<arena_tracking><arena_state_tracker>{rows[0]}"
    text = "\n".join([*rows, "</arena_state_tracker></arena_tracking>"])
    return read(text.encode(), resources.file, folder, resources)


def _grabber_of(resources: Resources, camera: CameraSpec) -> GrabberSpec:
    """The grabber that has a camera's name; where there is one of each, they belong together."""
    grabbers = resources.grabbers
    for id in (camera.id, PICTURES_OF + camera.id):
        if id in grabbers:
            return grabbers[id]
    if len(grabbers) == len(resources.cameras) == 1:
        return next(iter(grabbers.values()))
    raise resources.error(
        camera.line,
        f"<camera> id: no <grabber> is called {camera.id!r}, so without an experiment file nobody"
        " knows which pictures are this camera's: give both one id, or name an experiment file",
    )


def _load(resources: Resources, experiment_path: str | Path) -> TrackingSession:
    folder = Path(experiment_path).parent
    return read(read_bytes(experiment_path), str(experiment_path), folder, resources)


def read(data: bytes, file: str, folder: Path, resources: Resources) -> TrackingSession:
    """Reads an experiment file from its bytes; its relative paths start from `folder`."""
    root = parse(data, file)
    if root.name != "arena_tracking":
        raise root.error("is the outermost element, expected <arena_tracking>")
    tracker = root.child("arena_state_tracker")
    period = tracker.integer("opt_key_frame_period", 1, _MAX_PERIOD, 1)
    if period > 1 and not tracker.has("opt_square_size"):
        raise tracker.error(
            "is missing, expected the side in cm of the square to search between key frames",
            "opt_square_size",
        )
    elements = tracker.children("camera_state_tracker")
    if not elements:
        raise tracker.error("holds no <camera_state_tracker>, expected one per camera")
    session = TrackingSession(
        file=file,
        resources=resources,
        server_port=tracker.integer("server_port", 0, 65_535, TRACKER_PORT),
        key_frame_period=period,
        square_size_m=tracker.number("opt_square_size", 1.0, _MAX_SQUARE_CM, "cm", 30.0) / 100.0,
        views=tuple(_read_view(element, resources) for element in elements),
        record=_read_record(root, folder),
        masked=_read_mask(tracker),
    )
    root.check_all_read()
    _check_together(session, elements)
    return session


def _read_mask(tracker: Element) -> MaskSpec | None:
    margin_cm = 100.0 * MASK_MARGIN_M
    if not tracker.has("opt_mask"):
        if tracker.has("opt_mask_margin"):
            raise tracker.error(
                "stands there without 'opt_mask', to which it belongs", "opt_mask_margin"
            )
        return None
    margin_m = tracker.number("opt_mask_margin", 0.0, 1000.0, "cm", margin_cm) / 100.0
    text, corners = tracker.text("opt_mask"), []
    for corner in text.split() if text != ARENA else ():
        try:
            x, y = (float(part) for part in corner.split(","))
        except ValueError:
            x = math.nan
        if not (math.isfinite(x) and math.isfinite(y)):
            expected = f"'{ARENA}', or corners in m such as '-1,-1 1,-1 1,1 -1,1'"
            raise tracker.error(f"{corner[:40]!r} is no corner, expected {expected}", "opt_mask")
        if max(abs(x), abs(y)) > _FAR_M:
            raise tracker.error(f"{corner[:40]!r}: expected m, not cm or mm", "opt_mask")
        corners.append((x, y))
    spec = MaskSpec(None if text == ARENA else tuple(corners), margin_m, tracker.line)
    if spec.outline_m is not None:
        try:
            Mask(spec.outline_m, margin_m)
        except MaskError as error:
            raise tracker.error(str(error), "opt_mask") from None
    return spec


def _read_view(element: Element, resources: Resources) -> CameraTrackerSpec:
    grabber: GrabberSpec = _referred(element, "grabber", resources.grabbers, resources.file)
    camera = _referred(element, "camera", resources.cameras, resources.file)
    tracker: TrackerSpec = _referred(element, "tracker", resources.trackers, resources.file)
    if grabber.node and resources.network is None:
        where = '<nodes listen="tcp/0.0.0.0:7447" />'
        raise resources.error(grabber.line, f"<grabber> node: expected {where}, where they are met")
    if not (grabber.is_live or grabber.node):
        check_recording(resources, grabber)
    return CameraTrackerSpec(grabber, load_camera(resources, camera), tracker, element.line)


def _referred(element: Element, key: str, parts: Mapping[str, Declared], file: str) -> Declared:
    id = element.choice(key, tuple(parts)) if parts else element.text(key)
    if id not in parts:
        raise element.error(f"{id!r} is not known: {file} declares no {key}", key)
    return parts[id]


def _check_together(session: TrackingSession, elements: list[Element]) -> None:
    first: dict[tuple[str, str], int] = {}
    heights_m: dict[int, tuple[float, str]] = {}
    for view, element in zip(session.views, elements):
        used = [("grabber", view.grabber.id), ("camera", view.camera.id)]
        if view.grabber.is_live:
            of_node = f" of node {view.grabber.node}" if view.grabber.node else ""
            used.append(("grabber", f"the device {view.grabber.source}{of_node}"))
        for key, id in used:
            if (key, id) in first:
                line = first[key, id]
                raise element.error(f"{id!r} is used already, in line {line}", key)
            first[key, id] = element.line
        if view.grabber.is_live != session.views[0].grabber.is_live:
            other = session.views[0].grabber.id
            message = f"a camera and a recording ({view.grabber.id!r} and {other!r}) do not mix"
            raise element.error(message, "grabber")
        _check_trigger(view.grabber, session.views[0].grabber, element)
        for tag, height in view.tracker.heights_m.items():
            was_m, tracker = heights_m.setdefault(tag, (height, view.tracker.id))
            if was_m != height:
                message = f"tag {tag} has another height in {tracker!r}: {was_m:g} m, {height:g} m"
                raise element.error(message, "tracker")


def _check_trigger(grabber: GrabberSpec, first: GrabberSpec, element: Element) -> None:
    """Refuses cameras of which some are triggered and others not, or not in the same way."""
    ways = [f"trigger {g.trigger!r} at {g.frame_rate_hz or 0:g} Hz" for g in (grabber, first)]
    if FREE in (grabber.trigger, first.trigger):
        ways = [f"trigger {g.trigger!r}" for g in (grabber, first)]
    if ways[0] != ways[1]:
        message = f"{grabber.id!r} has {ways[0]}, {first.id!r} has {ways[1]}: expected the same"
        raise element.error(message, "grabber")


def _read_record(root: Element, folder: Path) -> RecordSpec:
    element = root.optional_child("experiment_record")
    if element is None:
        element = Element(root.document, "experiment_record", root.line, {})
    return RecordSpec(
        record_image=element.boolean("record_image", False),
        change_root_directory_on_start=element.boolean("change_root_directory_on_start", True),
        root_directory=folder / element.text("root_directory", DEFAULT_DIRECTORY),
        image_format=element.choice("image_format", IMAGE_FORMATS, "png"),
        line=element.line,
    )
