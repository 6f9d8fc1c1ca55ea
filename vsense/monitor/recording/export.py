"""Recordings as CSV tables, as a video, or for Foxglove. README.md describes the columns."""

from __future__ import annotations

import csv
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError, failing_as, require
from vsense.base.interruption import Interruption
from vsense.base.message_bus import DAMAGED, Message
from vsense.base.terminal import Console
from vsense.monitor import recording
from vsense.monitor.recording import changes, form
from vsense.monitor.recording._hearing import COLUMNS as HEARD
from vsense.monitor.recording._hearing import Hearing
from vsense.monitor.recording.form import ExperimentMessage, RecordingError
from vsense.monitor.recording.reader import Recording, open_recording, read_gap

Cells = list[Any]

_POSES = ("x_m", "y_m", "yaw_rad", "speed_m_s", "age_ns", "confidence", "cameras", "seen")
_SPREADS = (0, 1, 2, 4, 5, 8)
"""Places of a covariance's upper half in its nine numbers."""
TRAJECTORIES = (
    "time_s", "timestep", "run_timestep", "tag", *_POSES,
    "covariance_xx_m2", "covariance_xy_m2", "covariance_x_yaw_m_rad",
    "covariance_yy_m2", "covariance_y_yaw_m_rad", "covariance_yaw_yaw_rad2",
)  # fmt: skip
_TEXTS = {
    "name", "doubt", "state", "stop_cause", "version", "controller", "hash", "expected", "held",
    "trouble", "level", "by", "text", "value",
}  # fmt: skip
_WHOLE = {"timestep", "run_timestep", "tag", "sender", "age_ns"}
"""Columns of text, and of whole numbers; all others are of numbers."""
TABLES = ("trajectories", "readings", "heard", "robots", "shown", "measures", "events")


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """What of a recording is written; by default its tables.

    Attributes:
        output: folder of the tables; None: FILE without its suffix.
        video: file of a video in place of them.
        foxglove: file of a recording for Foxglove in place of them.
        rosbag: folder of a bag for ROS 2 in place of them.
        parquet: the tables are Parquet files, not CSV.
        film: of the video, what is asked for, by the names of `VideoPlan`.
    """

    output: Path | None = None
    video: Path | None = None
    foxglove: Path | None = None
    rosbag: Path | None = None
    parquet: bool = False
    film: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written: `facts` for scripts, `lines` for people."""

    facts: Mapping[str, Any]
    lines: Sequence[str]


def export(
    path: Path, options: ExportOptions, console: Console, interrupted: Interruption
) -> Exported | None:
    """Writes what a recording, or the only one in a folder, holds.

    Returns:
        What was written; None: a video was interrupted, and nothing is left of it.

    Raises:
        UsageError: options do not go together, or there is no recording.
        RecordingError: the recording cannot be read, or a file cannot be written.
        CutShort: it was interrupted.
    """
    _check(options)
    if options.parquet:
        require("--parquet needs", "pyarrow")
    path = recording.file_of(path)
    with ExitStack() as stack:
        with interrupted.at_once():
            opened = stack.enter_context(open_recording(path))
        if options.video is not None:
            return _video(opened, options.video, options.film, console, interrupted)
        with interrupted.at_once():
            if options.foxglove is not None:
                return _foxglove(opened, options.foxglove, console)
            if options.rosbag is not None:
                return _rosbag(opened, options.rosbag, console)
            folder = options.output or path.with_suffix("")
            return _tables(opened, folder, options.parquet, console)


def _check(options: ExportOptions) -> None:
    """Refuses options that do not go together."""
    if options.video is None and options.film:
        words = {"from_s": "from", "to_s": "to"}
        name = next(iter(options.film))
        raise UsageError(f"--{words.get(name, name)} belongs to --video NAME.webm")
    if options.video is not None and options.output is not None:
        raise UsageError("--output and --csv are for tables, --video says its own file: give one")
    written = {"video": options.video, "foxglove": options.foxglove, "rosbag": options.rosbag}
    asked = [f"--{name}" for name, path in written.items() if path is not None]
    if len(asked) > 1:
        raise UsageError(f"{' and '.join(asked)} write different files: give one")
    if asked and options.parquet:
        raise UsageError(f"--parquet is for tables: {asked[0]} writes none")
    if asked and options.output is not None:
        raise UsageError(f"--output is the folder of tables: {asked[0]} names its own file")


def _tables(opened: Recording, folder: Path, parquet: bool, console: Console) -> Exported:
    rows = export_csv(opened, folder)
    if parquet:
        with failing_as(RecordingError, f"{folder}: cannot be written"):
            for name in rows:
                _as_parquet(folder / f"{name}.csv")
    lacking = _say_lacking(opened, console)
    ending = "parquet" if parquet else "csv"
    tables = {f"{folder / name}.{ending}": count for name, count in rows.items()}
    facts = {"tables": tables, "lacking": lacking}
    return Exported(facts, [f"{name}: {n} rows" for name, n in tables.items()])


def _as_parquet(path: Path) -> None:
    """Puts a Parquet file in the place of a table."""
    import pyarrow
    from pyarrow import csv as tables
    from pyarrow import parquet

    damage = (pyarrow.ArrowInvalid, csv.Error)
    with failing_as(RecordingError, f"{path} is no Parquet, and stays", damage):
        with path.open(encoding="utf-8", newline="") as file:
            columns = next(csv.reader(file))
        text, whole, number = pyarrow.string(), pyarrow.int64(), pyarrow.float64()
        # A guess would make a number of a robot that is called 007, and nothing of an empty column.
        types = {c: text if c in _TEXTS else whole if c in _WHOLE else number for c in columns}
        if path.stem == "measures":  # whose names are the user's
            types = dict.fromkeys(columns, number) | {"timestep": whole}
        convert = tables.ConvertOptions(
            column_types=types, strings_can_be_null=True, null_values=[""]
        )
        parse = tables.ParseOptions(newlines_in_values=True)
        table = tables.read_csv(path, parse_options=parse, convert_options=convert)
    parquet.write_table(table, path.with_suffix(".parquet"))
    path.unlink()


def _video(
    opened: Recording,
    path: Path,
    asked: Mapping[str, Any],
    console: Console,
    interrupted: Interruption,
) -> Exported | None:
    from vsense.monitor.recording._film import OLD_S
    from vsense.monitor.recording._video import Video, VideoPlan

    with interrupted.at_once():
        film = Video(opened, VideoPlan(**asked))
    begun_s = time.monotonic()

    def show(done: int) -> None:
        left_s = (time.monotonic() - begun_s) / done * (film.frames - done)
        left = f"{int(left_s) // 60}:{int(left_s) % 60:02}"
        console.progress(f"video: {100 * done // film.frames} %, {left} left")

    complete = film.write(path, show, interrupted.is_set)
    console.end_progress()
    lacking = _say_lacking(opened, console)
    if not complete:
        console.say(f"vsense: interrupted; nothing is left of {path}")
        return None
    size, duration_s = path.stat().st_size, round(film.frames / film.fps, 3)
    facts = {"video": str(path), "frames": film.frames, "seconds": duration_s, "bytes": size}
    facts |= {"old_pictures": dict(film.old_pictures), "lacking": lacking}
    lines = [f"{path}: {duration_s:.1f} s, {film.frames} frames, {size / 1e6:.1f} MB"]
    if film.old_pictures:
        old = ", ".join(f"{name} in {n}" for name, n in sorted(film.old_pictures.items()))
        lines.append(f"pictures older than {OLD_S:g} s, of {film.frames} frames: {old}")
    return Exported(facts, lines)


def _foxglove(opened: Recording, path: Path, console: Console) -> Exported:
    from vsense.monitor.recording.foxglove_export import export_foxglove

    show = lambda share: console.progress(f"for Foxglove: {share:.0%}")  # noqa: E731
    sizes = export_foxglove(opened, path, show)
    console.end_progress()
    lacking = _say_lacking(opened, console)
    return Exported(
        {"files": sizes, "lacking": lacking},
        [f"{name}: {size / 1e6:.1f} MB" for name, size in sizes.items()],
    )


def _rosbag(opened: Recording, folder: Path, console: Console) -> Exported:
    from vsense.monitor.recording._rosbag import export_rosbag

    counts = export_rosbag(opened, folder)
    lacking = _say_lacking(opened, console)
    lines = [f"{folder}: {sum(counts.values())} messages of {len(counts)} topics"]
    return Exported({"bag": str(folder), "topics": counts, "lacking": lacking}, lines)


def _say_lacking(opened: Recording, console: Console) -> dict[str, Any]:
    """Says what the recording lacks; gives that for scripts."""
    for line in opened.lacks():
        console.say(f"vsense: {line}", "warning")
    gaps = opened.gaps
    messages, pictures = sum(gap.messages for gap in gaps), sum(gap.pictures for gap in gaps)
    length_s = sum(gap.to_ns - gap.from_ns for gap in gaps) / 1e9
    return {"gaps": len(gaps), "messages": messages, "pictures": pictures, "seconds": length_s}


def export_csv(recording: Recording, folder: Path) -> dict[str, int]:
    """Writes a recording's tables into a folder; gives how many rows each has.

    RecordingError if there are tables already, they would be too wide, or cannot be written.
    """
    paths = {name: folder / f"{name}.csv" for name in TABLES}
    for path in paths.values():
        if os.path.exists(path):
            raise RecordingError(f"{path}: is there already; expected another folder")
    export = _Export(recording)
    with failing_as(RecordingError, f"{folder}: cannot be written"), ExitStack() as stack:
        folder.mkdir(parents=True, exist_ok=True)
        # A recording that somebody made may hold half a character.
        create = partial(Path.open, mode="x", encoding="utf-8", errors="replace", newline="")
        files = {name: stack.enter_context(create(path)) for name, path in paths.items()}
        writers = {name: csv.writer(file).writerow for name, file in files.items()}
        return export.write(writers)


_MOST_READINGS, _MOST_MEASURES = 16384, 4096  # a datagram holds so many numbers
_MOST_LETTERS = 200  # of a sensor's name, which each of its columns has
_ROWS_AT_ONCE = 512  # a message may make millions of rows: all robots that heard all others


class _Export:
    """One export; damaged messages are left out, of longer ones the rows from the damage on."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._rows = dict.fromkeys(TABLES, 0)
        experiment = ExperimentMessage.read(recording.experiment)
        self._sensors = [_sensors_of(controller) for controller in experiment.controllers] or [[]]
        self._controller_of = experiment.controller_of()
        self._columns = _columns(self._sensors)
        self._measures = self._measure_names()
        for name, count, most in (
            ("readings", sum(self._columns.values()), _MOST_READINGS),
            ("measures", len(self._measures), _MOST_MEASURES),
        ):
            if count > most:  # a few bytes may ask for millions of columns
                words = f"says {count} {name}, expected at most {most}"
                raise RecordingError(f"{recording.path}: {words}")
        self._shown: dict[int, dict[str, Any]] = {}
        self._hearing = Hearing(experiment)

    def write(self, write: Mapping[str, Callable[[Cells], Any]]) -> dict[str, int]:
        write["trajectories"](list(TRAJECTORIES))
        write["robots"](["time_s", *form.ROBOT_COLUMNS])
        write["heard"](["time_s", *HEARD])
        write["events"](list(recording.EVENTS))
        write["shown"](list(recording.SHOWN))
        write["measures"](["time_s", "timestep", *self._measures])
        names = [[f"{s}_{n}" for n in range(k)] + [f"{s}_age_s"] for s, k in self._columns.items()]
        write["readings"](["time_s", "timestep", "tag", *(n for columns in names for n in columns)])
        rows: dict[str, list[tuple[str, Callable[[Message], Iterable[Cells]]]]] = {
            "/arena": [("trajectories", _poses), ("heard", self._see)],
            "/readings": [("readings", self._readings), ("heard", self._heard)],
            "/robots": [("robots", _robots), ("shown", self._changes)],
            "/signals": [("measures", self._measure)],
            "/event": [("events", _event)],
            form.GAP: [("events", _gap)],
        }
        for message in self._recording.messages(rows.keys()):
            time_s = round((message.time_ns - self._recording.begin_ns) / 1e9, 9)
            for table, make in rows[message.topic]:
                with suppress(*DAMAGED):
                    made = iter(make(message))
                    while lines := [[time_s, *row] for row in islice(made, _ROWS_AT_ONCE)]:
                        for row in lines:
                            write[table](row)
                        self._rows[table] += len(lines)
        return self._rows

    def _measure_names(self) -> list[str]:
        """All measures of the recording, in their order of appearance."""
        names: dict[str, None] = {}
        for message in self._recording.messages({"/signals"}):
            measures = message.data.get("measures")
            if isinstance(measures, dict):
                names |= dict.fromkeys(measures)
        return list(names)

    def _measure(self, message: Message) -> Iterable[Cells]:
        measures = message.data["measures"]
        if measures:
            yield [message.data["timestep"], *(measures.get(name) for name in self._measures)]

    def _changes(self, message: Message) -> Iterable[Cells]:
        """What controllers show, where it changes."""
        for tag, values in zip(message.data["tag"], message.data.get("shown") or []):
            before, self._shown[tag] = self._shown.get(tag, {}), values
            yield from ([tag, name, value] for name, value in changes(before, values))

    def _see(self, message: Message) -> Iterable[Cells]:
        self._hearing.see(message.data)
        return ()

    def _heard(self, message: Message) -> Iterable[Cells]:
        return self._hearing.rows(message.data)

    def _readings(self, message: Message) -> Iterable[Cells]:
        data = message.data
        for tag, values, taken in zip(data["tag"], data["values"], data["captured_ns"]):
            own = [name for name, _ in self._sensors[self._controller_of.get(tag, 0)]]
            row: Cells = [data["timestep"], tag]
            for name, count in self._columns.items():
                place = own.index(name) if name in own else None
                numbers, taken_ns = ([], -1) if place is None else (values[place], taken[place])
                row += [*numbers, *([None] * (count - len(numbers)))][:count]
                row.append(None if taken_ns < 0 else (data["capture_ns"] - taken_ns) / 1e9)
            yield row


Sensors = list[tuple[str, int]]
"""Names, and how many numbers each has."""


def _sensors_of(controller: Any) -> Sensors:
    sensors = controller.get("sensors") if isinstance(controller, dict) else None
    rows = sensors if isinstance(sensors, list) else []
    return [(str(s["name"])[:_MOST_LETTERS], int(s["count"])) for s in rows if _is_sensor(s)]


def _columns(controllers: Iterable[Sensors]) -> dict[str, int]:
    """The sensors of all controllers with the most numbers that one of this name has."""
    columns: dict[str, int] = {}
    for name, count in (sensor for sensors in controllers for sensor in sensors):
        columns[name] = max(count, columns.get(name, 0))
    return columns


def _is_sensor(sensor: Any) -> bool:
    count = sensor.get("count") if isinstance(sensor, dict) and "name" in sensor else None
    return isinstance(count, int) and count >= 0


def _poses(message: Message) -> Iterable[Cells]:
    data, robots = message.data, message.data["robots"]
    head = [data["timestep"], data.get("run_timestep")]
    columns = zip(robots["tag"], robots["covariance"], *(robots[name] for name in _POSES))
    for tag, spread, *values in columns:
        spreads = [None] * len(_SPREADS) if spread is None else [spread[n] for n in _SPREADS]
        yield [*head, tag, *map(_cell, values), *spreads]


def _robots(message: Message) -> Iterable[Cells]:
    columns = [message.data.get(name) or [] for name in form.ROBOT_COLUMNS]
    for row in range(len(columns[0])):
        yield [_cell(column[row]) if row < len(column) else None for column in columns]


def _event(message: Message) -> Iterable[Cells]:
    yield [message.data.get("level"), message.data.get("by"), message.data["text"]]


def _gap(message: Message) -> Iterable[Cells]:
    gap = read_gap(message.data)
    if gap is not None:
        length_s = (gap.to_ns - gap.from_ns) / 1e9
        text = (
            f"{length_s:.3f} s before this are not recorded whole ({gap.messages} messages,"
            f" {gap.pictures} pictures): {gap.why}"
        )
        yield ["gap", None, text]


def _cell(value: Any) -> Any:
    """Yes and no as 1 and 0: every tool reads these."""
    return int(value) if isinstance(value, bool) else value
