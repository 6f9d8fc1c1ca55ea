"""Robots are leased to one run: who wants them while another run has them is told whose they are.

Each robot has a file, in the lab's folder or in the user's own; the run that has the robot holds
the file's lock for as long as its process lives, so that a process that was killed has no lease.
What the file says is for people. Leases are of one machine: a robot is in a session of one host at
a time, and `vsense robot deploy` tells which.
"""

from __future__ import annotations

import fcntl
import json
import os
import socket
import struct
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from vsense.base import sharing
from vsense.base.errors import VsenseError, failing_as
from vsense.base.files import parse_json
from vsense.base.sharing import user_name
from vsense.base.terminal import printable

_FLOCK = struct.Struct("hhqqi0q")
"""Linux's `struct flock`: type, whence, start, length, process."""

_MOST_BYTES = 4096
_READ_AGAIN, _READ_PAUSE_S = 5, 0.01
"""Whoever has just taken a lock writes a moment later who he is."""


class LeasedError(VsenseError):
    """Another run has robots that are wanted; the message says whose, since when, and what."""


@dataclass(frozen=True, slots=True)
class Lease:
    """Who has a robot.

    Attributes:
        user: whose run it is.
        process: its number.
        host: name of the machine.
        command, experiment: what it does: "run" and "foraging".
        since: when it took the robot, local time, YYYY-MM-DD HH:MM:SS.
    """

    user: str
    process: int
    host: str
    command: str
    experiment: str
    since: str

    def __str__(self) -> str:
        day, _, moment = self.since.partition(" ")
        when = moment[:5] if day == time.strftime("%Y-%m-%d") else self.since[:16]
        what = f"vsense {self.command} of {self.experiment}" if self.experiment else "a run"
        return (
            f"{self.user}'s {what}, process {self.process} on {self.host},"
            f" since {when or 'just now'}"
        )


_WORDS = ("user", "host", "command", "experiment", "since")


class RobotLeases:
    """The robots that this process has; a context that gives them back.

    The system keeps a lock for a process: there is one object of these in each, and its methods
    belong to one thread.
    """

    def __init__(self, folder: Path, command: str, experiment: str) -> None:
        """Takes none yet; `folder` is where all runs that may want the same robots look."""
        self._folder = folder
        self._lease = Lease(
            *(user_name(), os.getpid(), socket.gethostname(), command, experiment),
            time.strftime("%Y-%m-%d %H:%M:%S"),
        )
        self._held: dict[int, int] = {}

    def __enter__(self) -> RobotLeases:
        return self

    def __exit__(self, *exception: object) -> None:
        self.release(list(self._held))

    def take(self, tags: Iterable[int]) -> None:
        """Takes all of these robots, or none; those that are held already stay so.

        Raises:
            LeasedError: another run has some of them.
            SharingError: a file cannot be used.
        """
        # In one order: of two runs that begin together one gets all.
        wanted = sorted(set(tags) - self._held.keys())
        taken: list[int] = []
        busy: dict[int, Lease] = {}
        try:
            for tag in wanted:
                holder = self._take(tag)
                if holder is None:
                    taken.append(tag)
                else:
                    busy[tag] = holder
            if busy:
                raise LeasedError(conflict_text(busy))
        except VsenseError:
            self.release(taken)
            raise

    def release(self, tags: Iterable[int]) -> None:
        """Gives robots back."""
        for tag in tags:
            descriptor = self._held.pop(tag, None)
            if descriptor is not None:
                # The file stays: to remove it would let two runs lock two files of one name.
                with suppress(OSError):
                    os.ftruncate(descriptor, 0)
                os.close(descriptor)

    def _take(self, tag: int) -> Lease | None:
        """Takes a robot; gives who has it where that is another run."""
        path = _file(self._folder, tag)
        mode = sharing.WRITE_MODE if sharing.shares(self._folder) else 0o600
        descriptor = sharing.write_shared(path, mode)
        holder = _lock(descriptor)
        if holder is not None:
            os.close(descriptor)
            return holder
        try:
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, json.dumps(asdict(self._lease)).encode(), 0)
        except OSError as error:
            os.close(descriptor)
            raise sharing.SharingError(f"{path}: {error.strerror}") from None
        self._held[tag] = descriptor
        return None


def _lock(descriptor: int) -> Lease | None:
    """Locks a robot's file; gives who has it where that is another process."""
    for _ in range(_READ_AGAIN):
        with suppress(OSError):
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return None
        # None: it was given back meanwhile.
        if (holder := _holder(descriptor)) is not None:
            return holder
    return _unknown(0)


def _unknown(process: int) -> Lease:
    """Who has a lock and has not said who he is."""
    return Lease("somebody", process, socket.gethostname(), "run", "", "")


def _file(folder: Path, tag: int) -> Path:
    return folder / f"robot-{tag}.lease"


def holders(folder: Path) -> dict[int, Lease]:
    """Who has which robot now, by tag. Not for a process that has leases: it would lose them."""
    by_tag = {}
    for path in folder.glob("robot-*.lease"):
        number = path.stem.removeprefix("robot-")
        with suppress(OSError):
            descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
            try:
                holder = _holder(descriptor) if number.isdigit() else None
            finally:
                os.close(descriptor)
            if holder is not None:
                by_tag[int(number)] = holder
    return dict(sorted(by_tag.items()))


def _holder(descriptor: int) -> Lease | None:
    """Who has locked a file; None: nobody."""
    for _ in range(_READ_AGAIN):
        asked = _FLOCK.pack(fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
        with failing_as(sharing.SharingError, "the lab's folder keeps no locks"):
            answer = fcntl.fcntl(descriptor, fcntl.F_GETLK, asked)
        kind, _, _, _, process = _FLOCK.unpack(answer)
        if kind == fcntl.F_UNLCK:
            return None
        lease = _read(descriptor)
        # 0: of another machine's process, or another container's, there is no number here.
        if lease is not None and process in (0, -1, lease.process):
            return lease
        time.sleep(_READ_PAUSE_S)
    return _unknown(process)


def _read(descriptor: int) -> Lease | None:
    """What a file says; None where it makes no sense."""
    try:
        said = parse_json(os.pread(descriptor, _MOST_BYTES, 0).decode())
        words = {name: printable(str(said[name]))[:80] for name in _WORDS}
        return Lease(process=int(said["process"]), **words)
    except (ValueError, KeyError, TypeError):
        return None


def by_lease(held: Mapping[int, Lease]) -> dict[Lease, list[int]]:
    """The tags of each run's robots."""
    tags: dict[Lease, list[int]] = {}
    for tag, lease in sorted(held.items()):
        tags.setdefault(lease, []).append(tag)
    return tags


def conflict_text(busy: Mapping[int, Lease]) -> str:
    """Who has the robots that somebody else wants, and how they are handed over."""
    lines = [f"{robots(tags)} in use: {lease}" for lease, tags in by_lease(busy).items()]
    return "\n".join([*lines, "ask for them, or end that run with: vsense control handover"])


def robots(tags: Iterable[int]) -> str:
    """Robots in words, with their verb: "robots 23, 24 are"."""
    listed = list(tags)
    names = ", ".join(map(str, listed))
    return f"robot {names} is" if len(listed) == 1 else f"robots {names} are"
