"""What the two files of a tracking session say, as frozen records: m, rad, s, px; arena frame.

Thesis, 2.2.2. `line` is that of a record's element, so that a fault which shows only later is
still reported at its place; `id` is its name in the experiment file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

from vsense.base.errors import ConfigError
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.source import FREE, Controls, GenicamSettings
from vsense.vision.tracking.mask import Mask, MaskError
from vsense.vision.tracking.node_session import NodeNetwork

DIRECTORY = "directory"
VIDEO = "video"
CAMERA = "camera"
GENICAM = "genicam"
NODE = "node"
NODE_RECORDING = "node_recording"
CAMERA_TYPES = (CAMERA, GENICAM)
NODE_TYPES = (NODE, NODE_RECORDING)
GRABBER_TYPES = (DIRECTORY, VIDEO, *CAMERA_TYPES, *NODE_TYPES)


@dataclass(frozen=True, slots=True)
class GrabberSpec:
    """A picture source.

    Attributes:
        type: one of `GRABBER_TYPES`.
        source: the directory, the video file, or the camera: its device, URL, address or id.
        timestamps: table of the pictures' capture times, or None.
        frame_rate_hz: pictures per second, of a recording without timestamps or wanted of a
            camera; None: what the video or the camera says itself.
        start_s: when the first picture of a recording without timestamps was taken.
        settings: what a camera is asked for; None: it is a recording, or on another computer.
        node: the other computer that has it, where `source` is the grabber's id; "": it is here.
    """

    id: str
    type: str
    source: str
    timestamps: Path | None
    frame_rate_hz: float | None
    start_s: float
    settings: Controls | GenicamSettings | None
    line: int
    node: str = ""

    @classmethod
    def of_camera(
        cls, id: str, type: str, device: str, settings: Controls | GenicamSettings, line: int = 0
    ) -> GrabberSpec:
        """Makes the spec of a camera, without a recording's timestamps and start."""
        controls = settings.controls if isinstance(settings, GenicamSettings) else settings
        return cls(id, type, device, None, controls.rate_hz, 0.0, settings, line)

    @property
    def is_live(self) -> bool:
        """Whether it is a camera and no recording."""
        return self.type in (*CAMERA_TYPES, NODE)

    @property
    def controls(self) -> Controls:
        """Size, rate, exposure and gain that a camera is asked for; none of a recording."""
        if isinstance(self.settings, GenicamSettings):
            return self.settings.controls
        return self.settings or Controls()

    @property
    def trigger(self) -> str:
        """What makes a camera take a picture; see `GenicamSettings`."""
        return self.settings.trigger if isinstance(self.settings, GenicamSettings) else FREE


@dataclass(frozen=True, slots=True)
class TrackerSpec:
    """What to look for in the pictures.

    Attributes:
        family: name of the marker family, or path of its definition.
        heading_deg: what is added to the heading of the family's square markers.
        heights_m: the roster: the height of each tag's marker above the floor.
        open_roster: whether robots with other tags of the family can join.
    """

    id: str
    family: str
    heading_deg: float
    heights_m: Mapping[int, float]
    max_speed_m_s: float
    open_roster: bool
    line: int


@dataclass(frozen=True, slots=True)
class CameraSpec:
    """A camera's place above the arena: its `calibration` is a camera file.

    `id` is its name also in all that is reported.
    """

    id: str
    calibration: Path
    line: int


@dataclass(frozen=True, slots=True)
class Resources:
    """All that a resources file declares, by id; `network` is that of cameras' nodes."""

    file: str
    grabbers: Mapping[str, GrabberSpec]
    trackers: Mapping[str, TrackerSpec]
    cameras: Mapping[str, CameraSpec]
    network: NodeNetwork | None = None

    def error(self, line: int, message: str) -> ConfigError:
        """Makes the error that something in this file is wrong."""
        return ConfigError(self.file, line, message)


@dataclass(frozen=True, slots=True)
class CameraTrackerSpec:
    """One camera of a session: a picture source, a calibrated camera, and what to look for.

    The camera's id is the resources file's.
    """

    grabber: GrabberSpec
    camera: Camera
    tracker: TrackerSpec
    line: int


@dataclass(frozen=True, slots=True)
class RecordSpec:
    """Whether and where the pictures are kept.

    Attributes:
        change_root_directory_on_start: each run gets a directory of its own; otherwise all of them
            are one recording.
        root_directory: where the recordings go.
        image_format: "png", "jpg" or "pgm".
    """

    record_image: bool
    change_root_directory_on_start: bool
    root_directory: Path
    image_format: str
    line: int


@dataclass(frozen=True, slots=True)
class MaskSpec:
    """Where markers are looked for, as the experiment file says it.

    Attributes:
        outline_m: corners in the arena frame; None: those of the arena of the experiment that is
            run.
    """

    outline_m: tuple[tuple[float, float], ...] | None
    margin_m: float
    line: int


@dataclass(frozen=True, slots=True)
class TrackingSession:
    """All that an experiment file asks for.

    Attributes:
        file: the file as the user named it.
        server_port: TCP port of the arena tracking server.
        key_frame_period: every so many timesteps the whole picture is searched; 1: always.
        square_size_m: side of the square searched around a known robot in between.
        offsets: by tag, where markers sit on their robots; those of others sit in the middle.
        masked: where markers are looked for; None: everywhere.
    """

    file: str
    resources: Resources
    server_port: int
    key_frame_period: int
    square_size_m: float
    views: tuple[CameraTrackerSpec, ...]
    record: RecordSpec
    masked: MaskSpec | None = None
    offsets: Mapping[int, PlacedMarker] = field(default_factory=dict)

    @property
    def mask(self) -> Mask | None:
        """Where markers are looked for; None: everywhere.

        Raises ConfigError where that is an experiment's arena, and there is no experiment; or where
        the corners make no outline.
        """
        spec = self.masked
        if spec is None:
            return None
        if spec.outline_m is None:
            raise self.error(
                spec.line,
                "<arena_state_tracker> opt_mask: 'arena' is that of the experiment of vsense run,"
                " and here is none: expected its corners in m, such as '-1,-1 1,-1 1,1 -1,1'",
            )
        try:
            return Mask(spec.outline_m, spec.margin_m)
        except MaskError as error:
            raise self.error(spec.line, f"<arena_state_tracker> opt_mask: {error}") from None

    def within(self, corners_m: Sequence[Sequence[float]]) -> TrackingSession:
        """The session in an experiment, whose arena has these corners."""
        spec = self.masked
        if spec is None or spec.outline_m is not None:
            return self
        outline_m = tuple((x, y) for x, y in corners_m)
        return replace(self, masked=replace(spec, outline_m=outline_m))

    @property
    def is_live(self) -> bool:
        """Whether its pictures come from cameras and not from recordings."""
        return any(view.grabber.is_live for view in self.views)

    @property
    def grabbers(self) -> dict[str, GrabberSpec]:
        """Where the pictures come from, by the camera's id."""
        return {view.camera.id: view.grabber for view in self.views}

    @property
    def heights_m(self) -> dict[int, float]:
        """The roster of all trackers: the height of each tag's marker above the floor."""
        return {tag: height for v in self.views for tag, height in v.tracker.heights_m.items()}

    def error(self, line: int, message: str) -> ConfigError:
        """Makes the error that something in the experiment file is wrong."""
        return ConfigError(self.file, line, message)


class PlacedMarker(Protocol):
    """A marker's place in its robot's frame: its centre [m] and its heading [rad]."""

    @property
    def x_m(self) -> float: ...

    @property
    def y_m(self) -> float: ...

    @property
    def yaw_rad(self) -> float: ...
