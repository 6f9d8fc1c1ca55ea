"""Recordings of pictures as folders, which `vsense camera track` takes as they are.

Each camera has a folder with numbered pictures and their timestamps; two XML files lie beside them.
"""

from __future__ import annotations

import json
import os
import queue
import re
import textwrap
import threading
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any, TextIO
from xml.sax.saxutils import quoteattr

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Frame, Image
from vsense.base.errors import VsenseError, failing_as
from vsense.base.message_bus import DAMAGED, Message
from vsense.config.resources import DEFAULT_SPEED_M_S
from vsense.config.tracking_session import EXPERIMENT_FILE, PICTURES_OF, RESOURCES_FILE
from vsense.monitor.recording.form import ExperimentMessage
from vsense.vision.cameras.camera import Camera, CameraError
from vsense.vision.cameras.picture import PictureError, decode
from vsense.vision.tracking.mask import Mask, MaskError, painted
from vsense.vision.tracking.specs import TrackerSpec
from vsense.world.entities import Arena

TIMESTAMPS = "timestamps.csv"

_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,60}")


class PictureRecordingError(VsenseError):
    """A recording that cannot be written."""

    exit_code = 2


# Measured on rendered and on real pictures: the smallest and the fastest of the lossless ones.
_PNG = (
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_AVG),
)


def png_of(image: NDArray[np.uint8]) -> bytes:
    """A grey picture as PNG, made fast."""
    return cv2.imencode(".png", image, _PNG)[1].tobytes()


def folder_names(cameras: Iterable[Camera]) -> dict[str, str]:
    """Gives each camera's folder: its id where that is a plain name."""
    return {
        camera.id: camera.id if _PLAIN.fullmatch(camera.id) else f"camera-{number}"
        for number, camera in enumerate(cameras)
    }


class PictureRecorder:
    """Writes pictures at once, in the caller's thread.

    The recording is `pictures/CAMERA/000012.png` with `timestamps.csv` beside them, and
    `cameras/CAMERA.json`, the camera files. `written` counts the pictures on the disk, `bytes` is
    their size.

    Args:
        directory: made where it does not exist; must not hold a recording.
        cameras: whose pictures come.
        suffix: format of the pictures: "png", "jpg" or "pgm".

    Raises:
        PictureRecordingError: it cannot be written, or holds a recording already.
    """

    def __init__(self, directory: Path, cameras: Sequence[Camera], suffix: str = "png") -> None:
        self.directory = directory
        self._suffix = suffix
        self._folders: dict[str, Path] = {}
        self._tables: dict[str, TextIO] = {}
        self.written = self.bytes = 0
        if os.path.exists(directory / "pictures"):
            raise PictureRecordingError(
                f"{directory}: holds a recording already; expected another place"
            )
        with failing_as(PictureRecordingError, f"{directory}: cannot be written"):
            (directory / "cameras").mkdir(parents=True, exist_ok=True)
            for camera in cameras:
                name = folder_names(cameras)[camera.id]
                text = camera.to_json() + "\n"
                (directory / "cameras" / f"{name}.json").write_text(text, encoding="utf-8")
                self._begin(camera.id, directory / "pictures" / name)

    def write(self, frames: Sequence[Frame]) -> None:
        """Writes the pictures of a timestep; PictureRecordingError if the disk is full, or gone."""
        for frame in frames:
            name = f"{frame.timestep:06d}.{self._suffix}"
            path = self._folders[frame.camera] / name
            data = cv2.imencode(f".{self._suffix}", frame.image)[1]
            with failing_as(PictureRecordingError, f"{path}: cannot be written"):
                path.write_bytes(data.tobytes())
                self._tables[frame.camera].write(f"{name},{frame.timestep},{frame.capture_ns}\n")
            self.written += 1
            self.bytes += len(data)

    def close(self) -> None:
        """Ends the tables of timestamps; can be called again."""
        for table in self._tables.values():
            table.close()

    def _begin(self, camera: str, folder: Path) -> None:
        folder.mkdir(parents=True)
        self._folders[camera] = folder
        # Line by line, so that a recording that was cut off is still one.
        table = (folder / TIMESTAMPS).open("w", encoding="utf-8", buffering=1)
        table.write("picture,timestep,capture_ns\n")
        self._tables[camera] = table


class BackgroundRecorder:
    """Writes pictures on a thread of its own; what it cannot keep up with is left out.

    At most `most` timesteps wait; `dropped` counts those that were left out, `recorder` has what
    was written.
    """

    def __init__(self, recorder: PictureRecorder, most: int = 8) -> None:
        self.recorder = recorder
        self._waiting: queue.Queue[Sequence[Frame] | None] = queue.Queue(most)
        self._failure: PictureRecordingError | None = None
        self.dropped = 0
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()

    def write(self, frames: Sequence[Frame]) -> None:
        """Hands over the pictures of a timestep, whose memory must not be used again.

        PictureRecordingError if an earlier one could not be written.
        """
        if self._failure is not None:
            raise self._failure
        try:
            self._waiting.put_nowait(frames)
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Writes what waits, and ends; PictureRecordingError if something was not written."""
        self._waiting.put(None)
        self._thread.join()
        self.recorder.close()
        if self._failure is not None:
            raise self._failure

    def in_words(self) -> str:
        """Where the recording lies, and how much it is."""
        disk = self.recorder
        return f"recording: {disk.directory}, {disk.written} pictures, {disk.bytes / 1e6:.1f} MB"

    def _run(self) -> None:
        while (frames := self._waiting.get()) is not None:
            try:
                if self._failure is None:
                    self.recorder.write(frames)
            except PictureRecordingError as failure:
                self._failure = failure


_TAGS_WIDTH = 80
XML_SCHEMAS = ("resources.xsd", "experiment.xsd")


def one_tracker(
    cameras: Iterable[Camera], family: str, heights_m: Mapping[int, float]
) -> dict[str, TrackerSpec]:
    """Gives all cameras the same tracker: one family, and by tag its marker's height [m]."""
    tracker = TrackerSpec("robots", family, 0.0, heights_m, DEFAULT_SPEED_M_S, True, 0)
    return {camera.id: tracker for camera in cameras}


def write_session_files(
    directory: Path,
    cameras: Sequence[Camera],
    trackers: Mapping[str, TrackerSpec],
    mask: Mask | None = None,
) -> None:
    """Writes `resources.xml`, `experiment.xml` and their schemas beside a recording.

    A `PictureRecorder` has written into `directory` before; `trackers` are by the camera's id.
    OSError if a file cannot be written.
    """
    write_schemas(directory)
    text = resources_text(cameras, trackers)
    (directory / RESOURCES_FILE).write_text(text, encoding="utf-8")
    text = experiment_text(cameras, trackers, mask)
    (directory / EXPERIMENT_FILE).write_text(text, encoding="utf-8")


def write_schemas(directory: Path) -> None:
    """Writes the schemas of both files into `directory / "schema"`, for editors."""
    (directory / "schema").mkdir(exist_ok=True)
    for name in XML_SCHEMAS:
        schema = (resources.files("vsense.config") / "schema" / name).read_text(encoding="utf-8")
        (directory / "schema" / name).write_text(schema, encoding="utf-8")


def resources_text(cameras: Sequence[Camera], trackers: Mapping[str, TrackerSpec]) -> str:
    """Gives the resources file of a recording; see `write_session_files`."""
    folders = folder_names(cameras)
    lines = [head("arena_tracking_system", "resources.xsd"), "  <grabbers>"]
    for camera in cameras:
        folder = f"pictures/{folders[camera.id]}"
        lines.append(
            f'    <grabber id={quoteattr(PICTURES_OF + camera.id)} type="directory"'
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


def experiment_text(
    cameras: Iterable[Camera], trackers: Mapping[str, TrackerSpec], mask: Mask | None = None
) -> str:
    """Gives the experiment file of a recording; see `write_session_files`."""
    return session_text([(PICTURES_OF + c.id, c.id, trackers[c.id].id) for c in cameras], mask)


def session_text(views: Iterable[tuple[str, str, str]], mask: Mask | None = None) -> str:
    """Gives an experiment file; a view names a camera's grabber, the camera, and its tracker."""
    masked = ""
    if mask is not None:
        corners = " ".join(f"{x!r},{y!r}" for x, y in mask.outline_m)
        margin = f'opt_mask_margin="{100.0 * mask.margin_m:.10g}"'
        masked = f'\n                       opt_mask="{corners}"\n                       {margin}'
    lines = [
        head("arena_tracking", "experiment.xsd"),
        f'  <arena_state_tracker server_port="4040" opt_key_frame_period="1"{masked}>',
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
        # Its path is relative to another file's folder.
        family = str(Path(family).resolve())
    usual_m = Counter(heights_m.values()).most_common(1)[0][0]
    other_heights_m = sorted({height for height in heights_m.values() if height != usual_m})
    heading = f' heading="{spec.heading_deg:g}"' if spec.heading_deg else ""
    tags = f"\n{' ' * 19}".join(textwrap.wrap(tag_ranges(heights_m), _TAGS_WIDTH))
    closed = "" if spec.open_roster else ' roster="closed"'
    tracker = (
        f"    <tracker id={quoteattr(spec.id)} family={quoteattr(family)}{heading}"
        f' robot_height="{usual_m:g}"\n             max_speed="{spec.max_speed_m_s:g}"{closed}\n'
        f'             tags="{tags}"'
    )
    if not other_heights_m:
        return [f"{tracker} />"]
    rows = [
        f'      <robots tags="{tag_ranges(t for t, h in heights_m.items() if h == height)}"'
        f' robot_height="{height:g}" />'
        for height in other_heights_m
    ]
    return [f"{tracker}>", *rows, "    </tracker>"]


ARENA_MARGIN_M = 0.1
"""What is so near to the arena is not painted over: markers of robots at its edge stay whole."""
TOP_M = 0.15
"""What is up to so high above the arena's floor stays to be seen, or up to the highest robot."""


class PicturePainter:
    """Paints over what pictures show outside of the arena: people walk there.

    Attributes:
        pictures: that were painted, by camera and timestep: some come twice.
    """

    def __init__(self, experiment: Mapping[str, Any]) -> None:
        facts = ExperimentMessage.read(experiment)
        self.pictures: set[tuple[str, Any]] = set()
        self._left_out: set[tuple[str, Any]] = set()
        self._cameras: dict[str, Camera] = {}
        for camera in facts.cameras:
            with suppress(*DAMAGED, CameraError):
                self._cameras[camera["id"]] = Camera.from_json(json.dumps(camera["model"]))
        self._top_m = TOP_M
        self._mask: Mask | None = None
        with suppress(*DAMAGED, MaskError):
            tops = (float(robot.get("height_m") or 0.0) for robot in facts.robots)
            self._top_m = max([TOP_M, *tops])
            size_m, centre_m = ((facts.arena or {})[name] for name in ("size_m", "centre_m"))
            self._mask = Mask(Arena(tuple(size_m), tuple(centre_m)).corners_m, ARENA_MARGIN_M)

    def painted(self, message: Message) -> Message | None:
        """The message with another picture; None: nothing says where the arena is in it."""
        name = str(message.data.get("camera"))
        picture = name, message.data.get("timestep")
        camera = self._cameras.get(name)
        image: Image | None = None
        with suppress(PictureError):
            image = decode(message.blob, "a picture")
        if camera is None or self._mask is None or image is None:
            self._left_out.add(picture)
            return None
        shown = painted(image, self._mask, camera, self._top_m)
        self.pictures.add(picture)
        return replace(message, data={**message.data, "format": "png"}, blob=png_of(shown))

    def lacks(self) -> Iterator[str]:
        """What was left out, in words."""
        for name, count in sorted(Counter(name for name, _ in self._left_out).items()):
            yield (
                f"pictures of camera {name} are left out ({count}): its calibration or the arena is"
                " not in the recording, so nothing outside can be painted over (--unmasked)"
            )
