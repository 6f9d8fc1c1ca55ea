"""The list of a lab's robots: who they are and how to reach them.

    # robots.txt: one robot in a line
    root@192.168.1.30  tag=23  base=argos:/dev/ttyS0
    pi@192.168.1.31    tag=24  base=gctronic:/dev/i2c-12  name=left

The first word is what `ssh` is told. The others are settings of that robot's vsensed, as in its
settings file (see vsensed --help); "tag" must be among them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from vsense.errors import ConfigError, UsageError
from vsense.files import read_text

_MEASURED = "proximity-scale light-scale ground-scale wheel-diameter wheel-ratio axle-length"
SETTINGS = tuple(f"tag base name uid host port battery-stop-mv watchdog {_MEASURED}".split())
"""What may be said of a robot."""

_DESTINATION = re.compile(r"[A-Za-z0-9_.@:\[\]%-]+")
_VALUE = re.compile(r"[^\s'\"\\$`]+")
_TAG_MAX = 65535
_DIGITS_MAX = 10


@dataclass(frozen=True, slots=True)
class RobotHost:
    """A robot's board.

    Attributes:
        destination: what `ssh` is told.
        settings: its own, by name; "tag" is one of them.
        line: where it stands in the file.
    """

    destination: str
    settings: Mapping[str, str]
    line: int


def read(path: Path) -> list[RobotHost]:
    """Reads such a file.

    Raises:
        UsageError: it cannot be read, or names no robot.
        ConfigError: a line is wrong.
    """
    try:
        lines = read_text(path).splitlines()
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError(f"cannot read {path}: it is no text") from None
    robots = [
        _robot(str(path), number, line.split("#")[0].split())
        for number, line in enumerate(lines, 1)
        if line.split("#")[0].strip()
    ]
    if not robots:
        raise UsageError(
            f"{path} names no robot: expected lines such as 'root@192.168.1.30 tag=23'"
        )
    _check_unique(str(path), robots)
    return robots


def _robot(file: str, number: int, words: list[str]) -> RobotHost:
    destination, *rest = words
    if not _DESTINATION.fullmatch(destination) or destination.startswith("-"):
        raise ConfigError(file, number, f"expected [user@]host, got {destination!r}")
    settings: dict[str, str] = {}
    for word in rest:
        name, equals, value = word.partition("=")
        if not equals or name not in SETTINGS or not _VALUE.fullmatch(value):
            expected = ", ".join(f"{known}=VALUE" for known in SETTINGS)
            raise ConfigError(file, number, f"expected one of {expected}; got {word!r}")
        if name in settings:
            raise ConfigError(file, number, f"{name}= is there twice")
        settings[name] = value
    tag = settings.get("tag", "")
    digits = tag.isascii() and tag.isdigit() and len(tag) <= _DIGITS_MAX
    if not (digits and int(tag) <= _TAG_MAX):
        raise ConfigError(file, number, f"expected tag=0..{_TAG_MAX}, got {tag[:40] or 'no tag'}")
    return RobotHost(destination, settings, number)


def _check_unique(file: str, robots: list[RobotHost]) -> None:
    """Two robots with one tag, or two lines for one board, would fight for a session."""
    seen: dict[str, int] = {}
    for robot in robots:
        uid = robot.settings.get("uid", "").lower()
        own = (robot.destination, f"tag {int(robot.settings['tag'])}", uid and f"uid {uid}")
        for what in filter(None, own):
            if what in seen:
                raise ConfigError(file, robot.line, f"{what} is in line {seen[what]}, too")
            seen[what] = robot.line
