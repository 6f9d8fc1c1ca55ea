"""Which robots were given which key: a file beside the swarm's keys, with nothing secret in it.

A robot in a line: its key's number, uid, tag, the day, and what `ssh` was told. `vsense robot
deploy` writes it; robots keep their uid in it, whatever else is deployed to them.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from vsense.base.errors import ConfigError, VsenseError
from vsense.base.files import read_text
from vsense.robots.deploying import Outcome, RobotHost
from vsense.robots.link import keys as swarm_keys
from vsense.robots.link.key_process import KeyProcess
from vsense.robots.link.keys import KeySource, LinkTrust, write_private

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
        is_plain = destination.isascii() and destination.isprintable()
        if len(bytes.fromhex(uid)) != UID_BYTES or not is_plain:
            raise ValueError
        return Holder(int(key), uid, int(tag), since, destination)
    except ValueError:
        raise ConfigError(file, line, "expected key, uid, tag, day and destination") from None


def uids(holders: Iterable[Holder], robots: Iterable[RobotHost]) -> dict[str, bytes]:
    """The uid of each robot, by its destination: its settings', else the one that it has had."""
    had = {(holder.destination, holder.tag): holder.uid for holder in holders}
    ids = {}
    for robot in robots:
        earlier = had.get((robot.destination, int(robot.settings["tag"])), "")
        text = robot.settings.get("uid", earlier)
        ids[robot.destination] = bytes.fromhex(text) if text else secrets.token_bytes(UID_BYTES)
    return ids


def note(path: Path, key: int, outcomes: Iterable[Outcome]) -> list[Holder]:
    """Notes to whom a key was brought; gives all that hold one.

    Raises:
        VsenseError: the file cannot be read or written.
        ConfigError: a line of it is wrong.
    """
    with swarm_keys.changing(path):
        holders = {(holder.destination, holder.tag): holder for holder in read(path)}
        today = date.today().isoformat()
        for outcome in outcomes:
            if outcome.keyed:
                tag, destination = int(outcome.robot.settings["tag"]), outcome.robot.destination
                # A board that had another name or marker has no second key.
                holders = {who: h for who, h in holders.items() if h.uid != outcome.uid}
                holders[destination, tag] = Holder(key, outcome.uid, tag, today, destination)
        rows = sorted(holders.values(), key=lambda holder: (holder.tag, holder.destination))
        text = "".join(f"{h.key} {h.uid} {h.tag} {h.since} {h.destination}\n" for h in rows)
        try:
            write_private(path, _HEAD + text, swarm_keys.mode_in(path.parent))
        except OSError as error:
            raise VsenseError(f"{path}: cannot be written: {error.strerror}") from None
    return rows


def trust(path: Path, keys: KeySource, insecure: bool = False) -> LinkTrust:
    """Which robots a host with these keys believes; `path` is of the file of their holders.

    Raises as `read`.
    """
    holders = read(path)
    brought: dict[bytes, int] = {}
    for holder in holders:
        uid = bytes.fromhex(holder.uid)
        brought[uid] = max(holder.key, brought.get(uid, 0))
        keys.robot_key(uid)  # a key process remembers it: no robot will wait for it
    return LinkTrust(keys, insecure, brought, tuple(_former(keys, holders)))


def _former(keys: KeySource, holders: Iterable[Holder]) -> Iterator[str]:
    """What is to be said of each key that is followed by another and still taken."""
    rows = list(holders)
    for number in sorted(set(keys.numbers) - {keys.newest}):
        having = [str(holder.tag) for holder in rows if holder.key == number]
        if having:
            yield (
                f"key {number} is still taken: robots that key {keys.newest} has not reached yet"
                f" have it: {', '.join(having)}; bring it with vsense robot deploy"
            )
        else:
            yield (
                f"key {number} is still taken, and no robot is known to have it: if none has,"
                f" vsense robot keys --forget {number}"
            )


def forget(
    path: Path, keys: KeySource, holders: Iterable[Holder], robots: Iterable[RobotHost]
) -> tuple[KeySource, list[int]]:
    """Takes former keys out of their file where no robot needs them any more.

    That is where every robot that ever had a key, and every one of these, has the newest: a key
    that was stolen is of no use then. Where no robot is known, nothing is forgotten.

    Args:
        path: the file of keys.
        keys: those of the file.
        holders: all that hold one.
        robots: who is known beside them.

    Returns:
        The keys that are left, and the numbers of those that are forgotten.

    Raises:
        VsenseError: the file cannot be read or written.
    """
    rows = list(holders)
    there = {(holder.destination, holder.tag) for holder in rows}
    all_there = all((r.destination, int(r.settings["tag"])) in there for r in robots)
    if len(keys.numbers) < 2 or not rows or not all_there:
        return keys, []
    if any(holder.key != keys.newest for holder in rows):
        return keys, []
    # Read again: somebody may have made another key since.
    left = KeyProcess(path)
    return left, left.drop_former(keys.newest)
