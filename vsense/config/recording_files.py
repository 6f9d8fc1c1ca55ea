"""Writes the two XML files of a recording, so that `vsense track` takes it as it is."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from xml.sax.saxutils import quoteattr

from vsense.config.resources import DEFAULT_SPEED_M_S
from vsense.config.tracking_specs import TrackerSpec
from vsense.tracking.camera import Camera
from vsense.tracking.picture_recorder import TIMESTAMPS, folder_names

RESOURCES = "resources.xml"
EXPERIMENT = "experiment.xml"
_TAGS_WIDTH = 80
SCHEMAS = ("resources.xsd", "experiment.xsd")


def one_tracker(
    cameras: Iterable[Camera], family: str, heights_m: Mapping[int, float]
) -> dict[str, TrackerSpec]:
    """Gives all cameras the same tracker.

    Args:
        cameras: The recorded cameras.
        family: The markers' family.
        heights_m: The height of each tag's marker above the floor.
    """
    tracker = TrackerSpec("robots", family, 0.0, heights_m, DEFAULT_SPEED_M_S, True, 0)
    return {camera.id: tracker for camera in cameras}


def write_session_files(
    directory: Path, cameras: Sequence[Camera], trackers: Mapping[str, TrackerSpec]
) -> None:
    """Writes `resources.xml`, `experiment.xml` and their schemas beside a recording.

    Args:
        directory: Where a `PictureRecorder` has written `pictures` and `cameras`.
        cameras: The recorded cameras.
        trackers: What to look for in their pictures, by the camera's id.

    Raises:
        OSError: A file cannot be written.
    """
    write_schemas(directory)
    text = resources_text(cameras, trackers)
    (directory / RESOURCES).write_text(text, encoding="utf-8")
    (directory / EXPERIMENT).write_text(experiment_text(cameras, trackers), encoding="utf-8")


def write_schemas(directory: Path) -> None:
    """Writes the schemas of both files into `directory / "schema"`, for editors.

    Raises:
        OSError: A file cannot be written.
    """
    (directory / "schema").mkdir(exist_ok=True)
    for name in SCHEMAS:
        schema = (resources.files("vsense.config") / "schema" / name).read_text(encoding="utf-8")
        (directory / "schema" / name).write_text(schema, encoding="utf-8")


def resources_text(cameras: Sequence[Camera], trackers: Mapping[str, TrackerSpec]) -> str:
    """Gives the resources file of a recording; see `write_session_files`."""
    folders = folder_names(cameras)
    lines = [
        head("arena_tracking_system", "resources.xsd"),
        "  <grabbers>",
    ]
    for camera in cameras:
        folder = f"pictures/{folders[camera.id]}"
        lines.append(
            f'    <grabber id={quoteattr("pictures of " + camera.id)} type="directory"'
            f' path="{folder}"\n             timestamps="{folder}/{TIMESTAMPS}" />'
        )
    lines += ["  </grabbers>", "", "  <trackers>"]
    for tracker in {tracker.id: tracker for tracker in trackers.values()}.values():
        lines += tracker_lines(tracker)
    lines += ["  </trackers>", "", "  <cameras>"]
    for camera in cameras:
        file = f"cameras/{folders[camera.id]}.json"
        lines.append(f'    <camera id={quoteattr(camera.id)} calibration="{file}" />')
    lines += ["  </cameras>", "", "</arena_tracking_system>", ""]
    return "\n".join(lines)


def experiment_text(cameras: Iterable[Camera], trackers: Mapping[str, TrackerSpec]) -> str:
    """Gives the experiment file of a recording; see `write_session_files`."""
    return session_text([(f"pictures of {c.id}", c.id, trackers[c.id].id) for c in cameras])


def session_text(views: Iterable[tuple[str, str, str]]) -> str:
    """Gives an experiment file.

    Args:
        views: The ids of each camera's grabber, of the camera itself, and of its tracker.
    """
    lines = [
        head("arena_tracking", "experiment.xsd"),
        '  <arena_state_tracker server_port="4040" opt_key_frame_period="1">',
    ]
    lines += [
        f"    <camera_state_tracker grabber={quoteattr(grabber)} camera={quoteattr(camera)}"
        f" tracker={quoteattr(tracker)} />"
        for grabber, camera, tracker in views
    ]
    lines += ["  </arena_state_tracker>", "", '  <experiment_record record_image="false" />', ""]
    return "\n".join([*lines, "</arena_tracking>", ""])


def tag_ranges(tags: Iterable[int]) -> str:
    """Gives tags as a resources file has them: "1-15 22"."""
    ranges: list[list[int]] = []
    for tag in sorted(tags):
        if ranges and tag == ranges[-1][1] + 1:
            ranges[-1][1] = tag
        else:
            ranges.append([tag, tag])
    return " ".join(f"{a}-{b}" if a < b else f"{a}" for a, b in ranges)


def head(root: str, schema: str) -> str:
    """Gives the first lines of a file, up to and with the outermost element's first tag."""
    return (
        '<?xml version="1.0" ?>\n'
        f'<{root} xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"\n'
        f'  xsi:noNamespaceSchemaLocation="schema/{schema}">\n'
    )


def tracker_lines(spec: TrackerSpec) -> list[str]:
    """Gives a tracker's element."""
    heights_m, family = spec.heights_m, spec.family
    if family.endswith(".json"):
        # Its path starts from the folder of another file.
        family = str(Path(family).resolve())
    usual_m = Counter(heights_m.values()).most_common(1)[0][0]
    others = sorted({height for height in heights_m.values() if height != usual_m})
    heading = f' heading="{spec.heading_deg:g}"' if spec.heading_deg else ""
    tags = f"\n{' ' * 19}".join(textwrap.wrap(tag_ranges(heights_m), _TAGS_WIDTH))
    closed = "" if spec.open_roster else ' roster="closed"'
    tracker = (
        f"    <tracker id={quoteattr(spec.id)} family={quoteattr(family)}{heading}"
        f' robot_height="{usual_m:g}"\n             max_speed="{spec.max_speed_m_s:g}"{closed}\n'
        f'             tags="{tags}"'
    )
    if not others:
        return [f"{tracker} />"]
    rows = [
        f'      <robots tags="{tag_ranges(t for t, h in heights_m.items() if h == height)}"'
        f' robot_height="{height:g}" />'
        for height in others
    ]
    return [f"{tracker}>", *rows, "    </tracker>"]
