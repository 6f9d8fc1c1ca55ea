"""`vsense camera list` and `init`: the cameras that are there, and their configuration files."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from vsense.base.errors import UsageError, VsenseError
from vsense.base.terminal import Console, aligned, counted, print_data
from vsense.config import resources as resources_file
from vsense.config import roster
from vsense.config.resources import (
    DEFAULT_HEIGHT_M,
    DEFAULT_SPEED_M_S,
    EXPOSURE_RANGE_US,
    GAIN_RANGE,
    RATES_HZ,
    SIDES_PX,
)
from vsense.config.tracking_session import EXPERIMENT_FILE, RESOURCES_FILE
from vsense.monitor.recording import pictures
from vsense.vision.cameras.discovery import RATE_HZ, URL, FoundCamera, find
from vsense.vision.cameras.source import (
    FREE,
    PIXEL_FORMATS,
    SOFTWARE,
    Bounds,
    Controls,
    GenicamSettings,
)
from vsense.vision.markers import families
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.single_camera import camera_named, free
from vsense.vision.tracking.specs import CAMERA, GENICAM, GrabberSpec, TrackerSpec

LIST_HEAD = ("id", "kind", "address", "model", "resolution", "rate", "formats")
FORMATS_SHOWN = 3
_UNKNOWN = "-"


def lines(cameras: Sequence[FoundCamera]) -> list[str]:
    """Returns a row for each camera, with its trouble below."""
    head, *rows = aligned([LIST_HEAD, *(_row(camera) for camera in cameras)])
    table = [head]
    for camera, row in zip(cameras, rows):
        table.append(row)
        if camera.trouble:
            table.append(f"  ! {camera.trouble}")
    return table


def facts(camera: FoundCamera) -> dict[str, Any]:
    """Returns a camera as JSON values; null is unknown."""
    details = asdict(camera.details)
    width, height = details.pop("size_px") or (None, None)
    return {
        "id": camera.id,
        "kind": camera.kind,
        "address": camera.address or None,
        "model": camera.model,
        "serial": camera.serial or None,
        "mac": camera.mac or None,
        "width_px": width,
        "height_px": height,
        **details,
        "trouble": camera.trouble or None,
    }


def formats(names: Sequence[str]) -> str:
    """Returns the first few formats, those that vsense takes first."""
    usable = [name for name in PIXEL_FORMATS if name in names]
    ordered = [*usable, *(name for name in names if name not in usable)]
    more = len(ordered) - FORMATS_SHOWN
    shown = " ".join(ordered[:FORMATS_SHOWN])
    return f"{shown} +{more}" if more > 0 else shown or _UNKNOWN


def _row(camera: FoundCamera) -> tuple[str, ...]:
    details = camera.details
    size = _UNKNOWN if details.size_px is None else "x".join(map(str, details.size_px))
    rate = _UNKNOWN if details.rate_hz is None else f"{details.rate_hz:.4g} Hz"
    return (
        camera.id,
        camera.kind,
        camera.address or _UNKNOWN,
        camera.model or _UNKNOWN,
        size,
        rate,
        formats(details.formats),
    )


NO_CAMERA = (
    "no camera found. What to check:",
    "  power and cable: does the camera's lamp shine? PoE needs a switch or an injector for it.",
    "  network: is this host on the cameras' network (ip -4 addr)? A firewall passes UDP 3956?",
    "  /dev/video*: is there one, and are you in the group video (groups)?",
)


def list_cameras(as_json: bool) -> int:
    """Prints the table or JSON; without cameras, what to check on standard error, and 1."""
    with Console().patience("looking for cameras"):
        cameras, missing = find()
    if as_json:
        print_data(json.dumps([facts(camera) for camera in cameras], indent=2))
    elif cameras:
        print_data("\n".join(lines(cameras)))
    if missing:
        Console().say(f"vsense: {missing}")
    if not cameras:
        Console().say("\n".join(NO_CAMERA))
    return int(not cameras)


def choose(id: str, wanted: Controls, resources: str | None = None) -> GrabberSpec:
    """Finds the camera that a user means: a grabber of a resources file, or one that is there.

    `wanted` are settings from the command line.

    Raises:
        UsageError: There is no such camera, or the file cannot be read.
        ConfigError: The resources file is wrong.
        GrabberError: The camera exists and does not open.
    """
    if resources is None:
        return camera_named(id, wanted)
    return _of_file(id, wanted, resources)


def _of_file(id: str, wanted: Controls, path: str) -> GrabberSpec:
    """Chooses a grabber of a resources file; the command line's settings come first."""
    resources = resources_file.load(path)
    live = {name: spec for name, spec in resources.grabbers.items() if spec.is_live}
    if id not in live:
        ids = ", ".join(live) or "none"
        are = "is" if len(live) == 1 else "are"
        raise UsageError(f"no camera {id!r} among the grabbers of {path}: there {are} {ids}")
    spec = live[id]
    asked = {name: value for name, value in asdict(wanted).items() if value is not None}
    controls = replace(spec.controls, **asked)
    settings: Controls | GenicamSettings = controls
    if isinstance(spec.settings, GenicamSettings):
        settings = replace(spec.settings, controls=controls)
    return free(replace(spec, settings=settings, frame_rate_hz=controls.rate_hz))


FAMILY = "arrow4x4"
TRACKER = "robots"
ROSTER = "auto:20"
_FILES = (RESOURCES_FILE, EXPERIMENT_FILE)

_GRABBERS = """\
    <!--
      Cameras. Whatever one of them refuses or rounds is reported when it is opened.

      device             an IP address, or an id, serial number, MAC address of "vsense camera list"
      width, height      [px] what it is calibrated with; offset_x, offset_y: where on the sensor
      frame_rate         [1/s] also what the network's load and "too slow" are judged by
      exposure_time_abs  [us] longer is brighter, and smears robots that move
      gain_raw           in the camera's own unit: higher is brighter and noisier
      trigger            "free", "software": all expose together, or a line such as "Line1"
      pixel_format       "Mono8", or BayerRG8 and the like where there is no Mono8
      packet_size        [bytes] left out: the largest that gets through; packet_delay: [us]

      Any other feature of a camera is set by its name, inside its element:
      <feature name="BlackLevelRaw" value="0" />
    -->
"""
_TRACKERS = """\
    <!--
      family        the printed markers, see "vsense camera markers"
      tags          the numbers of the markers in the arena; {whose}
      robot_height  of the markers above the floor [m]
      max_speed     of a robot [m/s]
    -->
"""
_CAMERAS = """\
    <!-- Where the cameras hang, and their lenses: files that "vsense camera calibrate" writes. -->
"""


@dataclass(frozen=True, slots=True)
class Markers:
    """The markers that a tracker looks for; `whose` says where their numbers come from."""

    tags: Sequence[int]
    whose: str
    family: str = FAMILY
    height_m: float = DEFAULT_HEIGHT_M

    @classmethod
    def usual(cls) -> Markers:
        """Those of the roster in the current folder; without one those of `vsense robot init`.

        Raises as `roster.find_roster`.
        """
        lab = roster.find_roster(None)
        if lab is not None:
            return cls(lab.tags, f"these are those of {lab.path}")
        tags = families.parse_tags(ROSTER, load_family(FAMILY))
        return cls(tags, f'these are "{ROSTER}" of vsense camera markers')


def resources_text(cameras: Sequence[FoundCamera], markers: Markers) -> str:
    """Returns the resources file of cameras that look for markers."""
    heights_m = dict.fromkeys(markers.tags, markers.height_m)
    speed_m_s = DEFAULT_SPEED_M_S
    tracker = TrackerSpec(TRACKER, markers.family, 0.0, heights_m, speed_m_s, True, 0)
    trigger, rates_hz = way(cameras)
    lines = [pictures.head("arena_tracking_system", "resources.xsd"), "  <grabbers>"]
    lines.append(_GRABBERS)
    for id, camera, rate_hz in zip(camera_ids(cameras), cameras, rates_hz):
        lines += [_comment(camera), grabber(id, camera, trigger, rate_hz), ""]
    lines += ["  </grabbers>", "", "  <trackers>"]
    lines.append(_TRACKERS.rstrip("\n").format(whose=markers.whose))
    lines += pictures.tracker_lines(tracker)
    lines += ["  </trackers>", "", "  <cameras>", _CAMERAS.rstrip("\n")]
    lines += [
        f'    <camera id="{id}" calibration="cameras/{id}.json" />' for id in camera_ids(cameras)
    ]
    return "\n".join([*lines, "  </cameras>", "", "</arena_tracking_system>", ""])


def experiment_text(cameras: Sequence[FoundCamera]) -> str:
    """Returns the experiment file."""
    return pictures.session_text([(id, id, TRACKER) for id in camera_ids(cameras)])


def camera_ids(cameras: Sequence[FoundCamera]) -> list[str]:
    """Returns the cameras' ids in the files, which are also names of folders."""
    return [camera.name or f"cam{number}" for number, camera in enumerate(cameras, 1)]


def way(cameras: Sequence[FoundCamera]) -> tuple[str, list[float]]:
    """Chooses how the cameras of a session take their pictures.

    Returns:
        The common trigger, and the rate of each camera: a common one where they are triggered.
    """
    # The usual rate is the limit, because many cameras share a link.
    rates_hz = [min(_within(c.details.rate_hz, RATES_HZ) or RATE_HZ, RATE_HZ) for c in cameras]
    if len(cameras) < 2 or not all(camera.is_genicam for camera in cameras):
        return FREE, rates_hz
    return SOFTWARE, [min(rates_hz)] * len(cameras)


def grabber(id: str, camera: FoundCamera, trigger: str, rate_hz: float) -> str:
    """Returns a camera's element, without values that a resources file does not take."""
    details = camera.details
    genicam = camera.is_genicam
    rows: list[dict[str, object]] = [
        {"id": id, "type": GENICAM if genicam else CAMERA, "device": device(camera)}
    ]
    size_px = details.size_px
    if size_px is not None and None not in [_within(side, SIDES_PX) for side in size_px]:
        rows.append({"width": size_px[0], "height": size_px[1]})
        if genicam:
            rows[-1] |= {"offset_x": 0, "offset_y": 0}
    rows.append({"frame_rate": None if camera.kind == URL else rate_hz})  # it sends as it likes
    rows[-1] |= {"exposure_time_abs": _within(details.exposure_us, EXPOSURE_RANGE_US)}
    rows[-1] |= {"gain_raw": _within(details.gain, GAIN_RANGE)}
    if genicam:
        usable = [name for name in PIXEL_FORMATS if name in details.formats]
        rows.append({"trigger": trigger, "pixel_format": usable[0] if usable else None})
    return f"    <grabber {_joined(rows)} />"


def device(camera: FoundCamera) -> str:
    """Returns how a camera is opened: by its address, which is fastest, where it is its own."""
    return camera.address or camera.id if camera.is_genicam and not camera.trouble else camera.id


def write(directory: Path, cameras: Sequence[FoundCamera], markers: Markers) -> None:
    """Writes both files and the schemas for editors, and prints the files' names.

    Raises:
        VsenseError: one cannot be written.
    """
    texts = dict(zip(_FILES, (resources_text(cameras, markers), experiment_text(cameras))))
    try:
        directory.mkdir(parents=True, exist_ok=True)
        pictures.write_schemas(directory)
        for name, text in texts.items():
            (directory / name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise VsenseError(f"{error.filename}: cannot be written: {error.strerror}") from None
    print_data("\n".join(str(directory / name) for name in texts))


def _within(value: float | None, bounds: Bounds) -> float | None:
    """Returns a value that a resources file takes; None: unknown, or beyond the bounds."""
    return value if value is not None and bounds[0] <= value <= bounds[1] else None


def _joined(rows: Sequence[dict[str, object]]) -> str:
    """Returns attributes, a line for each row, aligned."""
    lines = [
        " ".join(
            f"{name}={quoteattr(_text(value))}" for name, value in row.items() if value is not None
        )
        for row in rows
    ]
    return f"\n{' ' * 13}".join(line for line in lines if line)


def _comment(camera: FoundCamera) -> str:
    """Describes a camera: its name, what it takes, and its trouble."""
    details = camera.details
    parts = [camera.model]
    parts += [f"serial {camera.serial}"] if camera.serial else []
    parts += [camera.id, camera.mac] if camera.is_genicam else [camera.address]
    lines = [", ".join(filter(None, parts))]
    bounds = {"exposure": (details.exposure_bounds_us, " us"), "gain": (details.gain_bounds, "")}
    takes = [
        f"{name} {_text(limits[0])} to {_text(limits[1])}{unit}"
        for name, (limits, unit) in bounds.items()
        if limits is not None
    ]
    lines += [", ".join(takes)] if takes else []
    lines += [f"formats {' '.join(details.formats)}"] if details.formats else []
    lines += [f"NOT READY: {camera.trouble}"] if camera.trouble else []
    # Two dashes would end the comment.
    text = re.sub("-(?=-)", "- ", "\n         ".join(lines))
    return f"    <!-- {text} -->"


def _text(value: object) -> str:
    """Writes a value; numbers without an exponent, which the schema's decimals do not have."""
    return f"{value:.6f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)


BOARD = "charuco:7x5:80mm:4X4_50"


def init_pretended(directory: Path, cameras: Sequence[FoundCamera], markers: Markers) -> None:
    """Writes the files for rendered cameras into a folder; those that are theirs already stay.

    Raises UsageError where there are files of others; else as `write`.
    """
    there = [directory / name for name in _FILES if os.path.exists(directory / name)]
    if not there:
        write(directory, cameras, markers)
        return
    used = resources_file.load(there[0]) if len(there) == len(_FILES) else None
    if (
        used is None
        or {c.id for c in cameras} != {g.source for g in used.grabbers.values()}
        or any(
            tracker.family != markers.family or not {*markers.tags} <= tracker.heights_m.keys()
            for tracker in used.trackers.values()
        )
    ):
        words = "is there already, of other cameras or markers; take another folder"
        raise UsageError(f"{there[0]}: {words}")
    Console().say(f"{there[0]} has these cameras already: it stays as it is")


def init(directory: Path, force: bool) -> int:
    """Writes the files into a folder, and prints the next steps; `force` overwrites files.

    Raises:
        UsageError: A file exists already.
        VsenseError: There is no camera, or a file cannot be written.
    """
    there = [name for name in _FILES if os.path.exists(directory / name)]
    if there and not force:
        raise UsageError(f"{directory / there[0]}: is there already; --force writes over it")
    cameras, missing = find()
    if missing:
        Console().say(f"vsense: {missing}")
    if not cameras:
        raise VsenseError("\n".join(NO_CAMERA))
    write(directory, cameras, Markers.usual())
    for line in _next(directory, camera_ids(cameras)):
        Console().say(line)
    for id, camera in zip(camera_ids(cameras), cameras):
        if camera.trouble:
            Console().say(f"vsense: {id}: {camera.id}: {camera.trouble}")
    return 0


def _next(directory: Path, ids: list[str]) -> list[str]:
    cameras = counted(len(ids), "camera")
    step = "" if directory == Path() else f"  cd {directory}\n"
    return [
        f"{cameras}: {', '.join(ids)}. What comes next:",
        f"{step}  vsense camera tune {ids[0]} --resources {RESOURCES_FILE} --sweep",
        f"  vsense camera shoot {RESOURCES_FILE} --board {BOARD} -o shoot",
        f"  vsense camera calibrate rig --board {BOARD} --pictures shoot --floor 'floor_*'"
        " -o cameras",
        f"and then: vsense camera track {RESOURCES_FILE} {EXPERIMENT_FILE}",
    ]
