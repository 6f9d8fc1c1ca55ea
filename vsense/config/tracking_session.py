"""The experiment file of the arena tracking system (thesis, 2.2.2): what a session uses."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from vsense.cameras.genicam import FREE
from vsense.config import resources as resources_file
from vsense.config.resources import check_recording, load_camera, read_bytes
from vsense.link.trackers.protocol import DEFAULT_PORT
from vsense.tracking.specs import (
    CameraTrackerSpec,
    GrabberSpec,
    RecordSpec,
    Resources,
    TrackerSpec,
    TrackingSession,
)
from vsense.xml.element import Element
from vsense.xml.parsing import parse

DEFAULT_DIRECTORY = "recordings"
IMAGE_FORMATS = ("png", "jpg", "pgm")

_MAX_PERIOD = 10_000
_MAX_SQUARE_CM = 1000.0

Part = TypeVar("Part")


def load(resources_path: str | Path, experiment_path: str | Path) -> TrackingSession:
    """Reads the two files of a tracking session; raises UsageError where one cannot be read."""
    resources = resources_file.load(resources_path)
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
        server_port=tracker.integer("server_port", 0, 65_535, DEFAULT_PORT),
        key_frame_period=period,
        square_size_m=tracker.number("opt_square_size", 1.0, _MAX_SQUARE_CM, "cm", 30.0) / 100.0,
        views=tuple(_read_view(element, resources) for element in elements),
        record=_read_record(root, folder),
    )
    root.check_all_read()
    _check_together(session, elements)
    return session


def _read_view(element: Element, resources: Resources) -> CameraTrackerSpec:
    grabber: GrabberSpec = _referred(element, "grabber", resources.grabbers, resources.file)
    camera = _referred(element, "camera", resources.cameras, resources.file)
    tracker: TrackerSpec = _referred(element, "tracker", resources.trackers, resources.file)
    if not grabber.is_live:
        check_recording(resources, grabber)
    return CameraTrackerSpec(grabber, load_camera(resources, camera), tracker, element.line)


def _referred(element: Element, key: str, known: Mapping[str, Part], file: str) -> Part:
    id = element.choice(key, tuple(known)) if known else element.text(key)
    if id not in known:
        raise element.error(f"{id!r} is not known: {file} declares no {key}", key)
    return known[id]


def _check_together(session: TrackingSession, elements: list[Element]) -> None:
    first: dict[tuple[str, str], int] = {}
    heights_m: dict[int, tuple[float, str]] = {}
    for view, element in zip(session.views, elements):
        used = [("grabber", view.grabber.id), ("camera", view.camera.id)]
        if view.grabber.is_live:
            used.append(("grabber", f"the device {view.grabber.source}"))
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
            known, tracker = heights_m.setdefault(tag, (height, view.tracker.id))
            if known != height:
                message = f"tag {tag} has another height in {tracker!r}: {known:g} m, {height:g} m"
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
