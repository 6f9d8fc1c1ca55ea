"""The roster: which robots a lab has, how each is reached, and what was measured of it.

    [defaults]
    base = "argos:/dev/ttyS0"

    [[robot]]
    tag = 23
    host = "root@192.168.1.30"
    [robot.calibration]
    wheel_diameter_mm = 40.8
    [robot.marker]
    x_mm = 1.5

People write it, and we write what we measure into it (`update`): their comments stay.
`roster_fields` says what may stand where.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from vsense.base.errors import ConfigError, UsageError, failing_as
from vsense.base.files import MOST_FILE_BYTES, replace_text
from vsense.base.toml import TomlFile, decode_toml, read_toml_text
from vsense.config.roster_fields import DEFAULTS, LAB, MarkerOffset, RobotCalibration, refuse_lines
from vsense.world.robot_models import EPUCK, RobotModel, model_of

FILE_NAME = "robots.toml"

_REACHED = ("exec:", "wifi:")
"""Kinds of base that need no board: a driver, and an e-puck2 on its own Wi-Fi."""

SPARE = "a spare"
"""Why no experiment takes a spare by itself."""


@dataclass(frozen=True, slots=True)
class RosterRobot:
    """A robot of a lab.

    Attributes:
        tag: the number of its marker.
        host: what `ssh` is told; "": the roster does not say.
        uid: 32 hexadecimal digits in lower case; "": the roster does not say.
        name: what people call it; "": nothing.
        base: what turns its wheels, as `vsensed --base`; "": the roster does not say.
        model: what kind of robot it is; "": the roster does not say.
        spare: it plays only where another one is replaced.
        out_of_order: why it cannot play; "": it can.
        board: settings of its vsensed by the roster's names, [defaults] included.
        calibration: what was measured of its wheels and sensors.
        marker: where its marker is; None: not measured.
        line: where it begins in the file.
    """

    tag: int
    host: str = ""
    uid: str = ""
    name: str = ""
    base: str = ""
    model: str = ""
    spare: bool = False
    out_of_order: str = ""
    board: Mapping[str, str] = field(default_factory=dict)
    calibration: RobotCalibration = field(default_factory=RobotCalibration)
    marker: MarkerOffset | None = None
    line: int = 0

    @property
    def is_ready(self) -> bool:
        """Whether an experiment that asks for any robot may take it."""
        return not self.spare and not self.out_of_order

    @property
    def why_not(self) -> str:
        """Why no experiment takes it by itself; "": it may."""
        return f"out of order: {self.out_of_order}" if self.out_of_order else SPARE * self.spare

    @property
    def is_driven_here(self) -> bool:
        """Whether it has no board: the machine of the run reaches its base by itself."""
        return not self.host and self.base.startswith(_REACHED)

    def __str__(self) -> str:
        return f"robot {self.tag}{f' ({self.name})' if self.name else ''}"


@dataclass(frozen=True, slots=True)
class Roster:
    """A lab's robots.

    Attributes:
        path: the file.
        robots: they, in the file's order; tags, hosts, uids and names differ.
    """

    path: Path
    robots: tuple[RosterRobot, ...]

    def get(self, tag: int) -> RosterRobot | None:
        """The robot with a tag; None: there is none."""
        return next((robot for robot in self.robots if robot.tag == tag), None)

    def model_of(self, robot: RosterRobot) -> RobotModel | None:
        """A robot's model, a shipped one or a file beside the roster; None: it does not say.

        Raises:
            ConfigError: there is no such model, or its file is wrong.
        """
        try:
            return model_of(robot.model, self.path.parent) if robot.model else None
        except UsageError as error:
            raise self.error(robot, f"model: {error}") from None

    def settings_of(self, robot: RosterRobot) -> dict[str, str]:
        """vsensed's settings of what was measured of a robot; raises as `model_of`, and where it
        is farther from its model, by default an e-puck, than vsensed takes."""
        calibration = robot.calibration
        if not calibration.settings:
            return {}
        try:
            return calibration.settings_of(self.model_of(robot) or EPUCK)
        except ValueError as error:
            raise self.error(robot, str(error)) from None

    def error(self, robot: RosterRobot, words: str) -> ConfigError:
        """The error that something of a robot's cannot be."""
        return ConfigError(str(self.path), robot.line, words)

    @property
    def tags(self) -> tuple[int, ...]:
        """All tags, spares and broken robots included."""
        return tuple(robot.tag for robot in self.robots)

    @property
    def markers(self) -> dict[int, MarkerOffset]:
        """The measured markers by tag."""
        return {robot.tag: robot.marker for robot in self.robots if robot.marker is not None}


def read(path: Path) -> Roster:
    """Reads a roster.

    Raises:
        UsageError: it cannot be read, or names no robot.
        ConfigError: something in it is wrong; the message has its line.
    """
    return _read(path, read_toml_text(path))


def find_roster(path: Path | None, here: bool = True) -> Roster | None:
    """Reads the roster that is meant; None: none is.

    Args:
        path: the file; None: the one in the current folder, where there is one, and `here`.

    Raises:
        UsageError: it cannot be read, or names no robot.
        ConfigError: something in it is wrong.
    """
    if path is not None:
        return read(path)
    usual = Path(FILE_NAME)
    return read(usual) if here and os.path.exists(usual) else None


def require_roster(path: Path | None) -> Roster:
    """Reads the roster, which there has to be; raises as `find_roster`, and where there is none."""
    roster = find_roster(path)
    if roster is None:
        raise UsageError(
            f"no roster: expected --roster FILE, or {FILE_NAME} here; 'vsense robot init' writes"
            " it, 'vsense docs robot' says what stands in it"
        )
    return roster


def update(path: Path, changes: Mapping[int, Mapping[str, Any]]) -> Roster:
    """Writes what is known of robots into a roster; all else in it stays, comments too.

    The file is replaced as a whole, and by one process at a time.

    Args:
        path: the roster.
        changes: by tag what is new: values by name as in the file, those of its tables with the
            table's name before them, such as "calibration.wheel_diameter_mm"; None takes a value
            out.

    Returns:
        The roster as it is now.

    Raises:
        UsageError: it cannot be read or written, or has no robot of such a tag.
        ConfigError: something in it is wrong, or would be.
    """
    import tomlkit

    read(path)  # which refuses pipes and devices
    path = path.resolve()  # a link to it stays one
    with _locked(path) as file:
        text = decode_toml(path, file.read(MOST_FILE_BYTES))
        before, document = _read(path, text), tomlkit.parse(text)
        tables: dict[int, Any] = dict(zip(before.tags, document["robot"]))
        for tag, values in changes.items():
            if tag not in tables:
                raise UsageError(f"{path} has no robot with tag {tag}")
            _put(tables[tag], values)
        text = tomlkit.dumps(document)
        after = _read(path, text)
        _replace(path, text)
    return after


def read_known(path: Path) -> tuple[RosterRobot, ...]:
    """Reads the robots of a roster that may name none yet, or not be there; raises as `read`."""
    return _read(path, read_toml_text(path), least=0).robots if os.path.exists(path) else ()


def extend(path: Path, robots: Sequence[Mapping[str, Any]], head: str) -> Roster:
    """Adds robots to the end of a roster, or writes one that begins with the text `head`.

    All else in it stays. The file is replaced as a whole, and by one process at a time.

    Args:
        path: the roster.
        robots: their values by name, as in the file.
        head: for a file that is not there.

    Returns:
        The roster as it is now.

    Raises:
        UsageError: it cannot be read or written, or has its robots in an inline array.
        ConfigError: something in it is wrong, or would be: two robots with one tag, for example.
    """
    tables = [
        "".join(["[[robot]]\n", *(f"{n} = {_toml(value)}\n" for n, value in values.items())])
        for values in robots
    ]
    new = "\n".join(tables)
    if not os.path.exists(path):
        _read(path, new)  # nothing is left of a file that would be wrong
    read_known(path)  # which refuses pipes and devices
    with failing_as(UsageError, f"cannot write {path}"), suppress(FileExistsError):
        path.open("x").close()
    path = path.resolve()  # a link to it stays one
    with _locked(path) as file:
        before = decode_toml(path, file.read(MOST_FILE_BYTES))
        text = "\n\n".join([(before or head).rstrip(), new])
        try:
            roster = _read(path, text)
        except ConfigError:
            if re.search(r"^\s*robot\s*=", before, re.MULTILINE):
                words = "its robots are an inline array: write each as a table [[robot]]"
                raise UsageError(f"{path}: {words}") from None
            raise
        _replace(path, text)
    return roster


def _toml(value: str | int) -> str:
    return json.dumps(value, ensure_ascii=False)


def _replace(path: Path, text: str) -> None:
    try:
        replace_text(path, text)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from None


def _put(table: Any, values: Mapping[str, Any]) -> None:
    """Puts values into a robot's table.

    What stands between it and the next robot's is this one's for the parser, and the next one's for
    people: it is taken off and comes back at the end.
    """
    import tomlkit

    remarks = _take_remarks(_last_table(table))
    for name, value in values.items():
        part, _, key = name.rpartition(".")
        if part and part not in table:
            inline = isinstance(table, tomlkit.items.InlineTable)
            table[part] = tomlkit.inline_table() if inline else tomlkit.table()
        inner = table[part] if part else table
        between = [] if inner is table else _take_remarks(inner)
        if value is not None:
            inner[key] = value
        elif key in inner:
            del inner[key]
        _put_back(inner, between)
    _put_back(_last_table(table), remarks)


def _last_table(table: Any) -> Any:
    """The table that is the last in the text of a robot's."""
    import tomlkit

    last = table.value.body[-1][1] if table.value.body else None
    return last if isinstance(last, tomlkit.items.Table) else table


def _take_remarks(table: Any) -> list[Any]:
    """Takes blank lines and comments off a table's end."""
    body, taken = getattr(table.value, "body", []), []
    while body and body[-1][0] is None:
        taken.append(body.pop()[1])
    return taken[::-1]


def _put_back(table: Any, remarks: list[Any]) -> None:
    for remark in remarks:
        table.value.body.append((None, remark))


@contextmanager
def _locked(path: Path) -> Iterator[BinaryIO]:
    """Opens the file that has this name, and holds its lock.

    It is the file's own lock: it leaves nothing behind, and works over NFS. Whoever waited for it
    may hold that of a file that was replaced meanwhile, and looks again.
    """
    while True:
        try:
            file = path.open("r+b")
        except OSError as error:
            raise UsageError(f"cannot write {path}: {error.strerror}") from None
        with file:
            fcntl.flock(file, fcntl.LOCK_EX)
            if os.path.exists(path) and os.path.samestat(os.fstat(file.fileno()), path.stat()):
                yield file
                return


def _read(path: Path, text: str, least: int = 1) -> Roster:
    try:
        file = TomlFile(path, text)
    except ConfigError:
        refuse_lines(path, text)
        raise
    values = file.read(LAB)
    if len(values.get("robot", ())) < least:
        raise UsageError(f"{path} names no robot: expected tables [[robot]] with tag = 23")
    defaults = values.get("defaults", {})
    robots = []
    for number, own in enumerate(values.get("robot", ())):
        if "tag" not in own:
            words = "this robot has no tag: expected tag = 0..65535"
            raise file.error(words, "robot", number)
        robots.append(_robot(own, defaults, file.line("robot", number)))
        if not robots[-1].model:
            _check_lengths(file, number, robots[-1])
    _check_unique(str(path), robots)
    return Roster(path, tuple(robots))


def _robot(own: Mapping[str, Any], defaults: Mapping[str, Any], line: int) -> RosterRobot:
    board = {**defaults, **{name: own[name] for name in DEFAULTS if name in own}}
    marker = own.get("marker")
    return RosterRobot(
        **{name: own[name] for name in _OWN if name in own},
        base=board.get("base", ""),
        board={name: str(board[name]) for name in DEFAULTS if name in board},
        calibration=RobotCalibration(**own.get("calibration", {})),
        marker=MarkerOffset.read(marker) if marker else None,
        line=line,
    )


def _check_lengths(file: TomlFile, number: int, robot: RosterRobot) -> None:
    try:
        robot.calibration.settings_of(EPUCK)
    except ValueError as error:
        raise file.error(str(error), "robot", number, "calibration") from None


_OWN = ("tag", "host", "uid", "name", "model", "spare", "out_of_order")


def _check_unique(file: str, robots: Sequence[RosterRobot]) -> None:
    """Two robots with one tag, or two entries for one board, would fight for a session."""
    seen: dict[str, int] = {}
    for robot in robots:
        own = {"tag": str(robot.tag), "host": robot.host, "uid": robot.uid, "name": robot.name}
        for what in (f"{name} {value}" for name, value in own.items() if value):
            if what in seen:
                raise ConfigError(
                    file, robot.line, f"{what} is that of the robot in line {seen[what]}, too"
                )
            seen[what] = robot.line
