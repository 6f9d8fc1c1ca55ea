"""Which robots were given which key: a file beside the swarm's keys, with nothing secret in it.

A robot in a line: its key's number, uid, tag, the day, and what `ssh` was told. `vsense robot
deploy` writes it; robots keep their uid in it, whatever else is deployed to them.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from vsense.errors import ConfigError, VsenseError
from vsense.files import read_text
from vsense.link.robots.keys import write_private
from vsense.robot.deploying import Outcome
from vsense.robot.hosts import RobotHost

UID_BYTES = 16
_HEAD = "# Which robot has which swarm key: key, uid, tag, since, destination. By vsense robot.\n"


@dataclass(frozen=True, slots=True)
class Holder:
    """A robot that was given a key.

    Attributes:
        key: number of the swarm key that its own was made of.
        uid: 32 hexadecimal digits.
        since: the day, YYYY-MM-DD.
        destination: what `ssh` was told.
    """

    key: int
    uid: str
    tag: int
    since: str
    destination: str


def file_of(keys: Path) -> Path:
    """The file that belongs to one of swarm keys."""
    return keys.with_name(f"{keys.name}.robots")


def read(path: Path) -> list[Holder]:
    """Reads such a file; one that is not there names nobody.

    Raises:
        VsenseError: it cannot be read.
        ConfigError: a line is wrong.
    """
    try:
        lines = read_text(path).splitlines()
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        raise VsenseError(f"{path}: cannot be read: {error}") from None
    return [
        _holder(str(path), number, line.split())
        for number, line in enumerate(lines, 1)
        if line.split("#")[0].strip()
    ]


def _holder(file: str, line: int, words: list[str]) -> Holder:
    try:
        key, uid, tag, since, destination = words
        if len(bytes.fromhex(uid)) != UID_BYTES:
            raise ValueError
        return Holder(int(key), uid, int(tag), since, destination)
    except ValueError:
        raise ConfigError(file, line, "expected key, uid, tag, day and destination") from None


def uids(holders: Iterable[Holder], robots: Iterable[RobotHost]) -> dict[str, bytes]:
    """The uid of each robot, by its destination: its settings', else the one that it has had."""
    had = {(holder.destination, holder.tag): holder.uid for holder in holders}
    found = {}
    for robot in robots:
        known = had.get((robot.destination, int(robot.settings["tag"])), "")
        text = robot.settings.get("uid", known)
        found[robot.destination] = bytes.fromhex(text) if text else secrets.token_bytes(UID_BYTES)
    return found


def note(path: Path, key: int, outcomes: Iterable[Outcome]) -> list[Holder]:
    """Notes to whom a key was brought; gives all that hold one.

    Raises:
        VsenseError: the file cannot be read or written.
        ConfigError: a line of it is wrong.
    """
    holders = {(each.destination, each.tag): each for each in read(path)}
    today = date.today().isoformat()
    for one in outcomes:
        if one.keyed:
            tag, destination = int(one.robot.settings["tag"]), one.robot.destination
            holders[destination, tag] = Holder(key, one.uid, tag, today, destination)
    rows = sorted(holders.values(), key=lambda each: (each.tag, each.destination))
    text = "".join(f"{h.key} {h.uid} {h.tag} {h.since} {h.destination}\n" for h in rows)
    try:
        write_private(path, _HEAD + text, 0o600)
    except OSError as error:
        raise VsenseError(f"{path}: cannot be written: {error.strerror}") from None
    return rows
