"""The swarm's keys: which robots a host believes.

The host has a file with the swarm's keys, numbered from 1. Each robot has a key of its own, made of
one of them and the robot's uid, so that a stolen robot betrays no other one. The key with the
highest number is the one that robots are given. A robot that it has not reached yet is believed
with its older one, and told of, so that nobody is locked out; one that it has reached is not, and
where it has reached all, the older one is forgotten: no former key is good for ever.

    # Swarm keys of vsense. A user who reads them can be every robot, and the host.
    2 = 64 hexadecimal digits
    1 = 64 hexadecimal digits
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import secrets
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from vsense.base import sharing
from vsense.base.errors import ConfigError, VsenseError
from vsense.base.files import check_private, replace_text
from vsense.robots.link.wire import PUBLISHED

SWARM_KEY_BYTES = 32
KEY_FILE_NAME = "swarm.key"
MAX_KEY_FILE_BYTES = 16_384
"""A file of keys is never larger."""

_PERSON = b"vs-robot"
_LINE = re.compile(r"([1-9][0-9]{0,5})\s*=\s*([0-9a-fA-F]{64})")
_HEAD = "# Swarm keys of vsense. A user who reads them can be every robot, and the host.\n"


class KeySource(Protocol):
    """What robots' keys are made from: a `KeyProcess`, where users' code may run beside it."""

    @property
    def numbers(self) -> Sequence[int]:
        """Of the swarm's keys, the newest first."""

    @property
    def newest(self) -> int:
        """Number of the key that robots are given now."""

    def robot_key(self, uid: bytes, number: int | None = None) -> bytes:
        """A robot's own key, made of the newest swarm key or of that with a number."""

    def roots(self, uid: bytes) -> Sequence[tuple[int, bytes]]:
        """All keys that a robot may have, each with the number of its swarm key, newest first."""


@dataclass(frozen=True, slots=True)
class SwarmKeys:
    """The swarm's keys by number; what they are is never shown. A `KeySource`."""

    keys: Mapping[int, bytes] = field(repr=False)

    @property
    def numbers(self) -> Sequence[int]:
        """See `KeySource`."""
        return sorted(self.keys, reverse=True)

    @property
    def newest(self) -> int:
        """See `KeySource`."""
        return max(self.keys)

    def robot_key(self, uid: bytes, number: int | None = None) -> bytes:
        """See `KeySource`."""
        swarm = self.keys[self.newest if number is None else number]
        return hashlib.blake2s(uid, digest_size=16, key=swarm, person=_PERSON).digest()

    def roots(self, uid: bytes) -> Sequence[tuple[int, bytes]]:
        """See `KeySource`."""
        return [(number, self.robot_key(uid, number)) for number in self.numbers]

    def followed(self) -> SwarmKeys:
        """These, and a new one."""
        return SwarmKeys({self.newest + 1: secrets.token_bytes(SWARM_KEY_BYTES), **self.keys})

    def without(self, number: int) -> SwarmKeys:
        """These without one, which no robot has any more."""
        return SwarmKeys({n: key for n, key in self.keys.items() if n != number})


def robot_file(uid: bytes, key: bytes) -> str:
    """The contents of a robot's own file, which `vsensed --key` names."""
    return f"uid = {uid.hex()}\nkey = {key.hex()}\n"


def daemon_options(uid: bytes, keys: KeySource | None, file: Path) -> list[str]:
    """The options that say to a `vsensed` on this machine who it is; writes its key's file.

    `keys` None: there are none.

    Raises:
        OSError: the file cannot be written.
    """
    if keys is None:
        return ["--uid", uid.hex(), "--insecure"]
    write_private(file, robot_file(uid, keys.robot_key(uid)), 0o600)
    return ["--key", str(file.resolve())]


def make() -> SwarmKeys:
    """A new swarm's first key."""
    return SwarmKeys({1: secrets.token_bytes(SWARM_KEY_BYTES)})


@dataclass(frozen=True, slots=True)
class LinkTrust:
    """Which robots a host believes.

    Attributes:
        keys: the swarm's; None: there are none.
        insecure: robots without a key are taken, too: whoever sends packets can be one.
        brought: number of the swarm key that a robot was brought last, by uid. An older one is not
            believed from it any more: who shows that has stolen it, or the robot's former card.
        notes: what people should know of the keys when a run begins.
    """

    keys: KeySource | None
    insecure: bool = False
    brought: Mapping[bytes, int] = field(default_factory=dict, repr=False)
    notes: tuple[str, ...] = ()

    def roots(self, uid: bytes) -> Iterator[tuple[int | None, bytes]]:
        """What the keys of a robot's sessions may be made from, the newest first.

        Each has the number of its swarm key; None is that of a robot without a key.
        """
        if self.keys is not None:
            yield from self.keys.roots(uid)
        yield None, PUBLISHED

    def is_former(self, uid: bytes, number: int | None) -> bool:
        """Whether a robot shows a key that it was brought another one in place of."""
        return number is not None and number < self.brought.get(uid, 0)


INSECURE = LinkTrust(None, insecure=True)
"""For a host without keys."""


def default_path() -> Path:
    """Where the swarm's keys are unless a command is told otherwise.

    In the lab's folder, where this machine has one that this account may enter
    (`vsense.base.sharing`), unless only this account has some. SharingError where that folder is
    not safe.
    """
    base = os.environ.get("XDG_CONFIG_HOME") or ""
    folder = Path(base) if os.path.isabs(base) else Path.home() / ".config"
    own = folder / "vsense" / KEY_FILE_NAME
    try:
        lab = sharing.lab()
    except sharing.NotMember:
        return own
    if lab is None or (own.exists() and not (lab.path / KEY_FILE_NAME).exists()):
        return own
    return lab.path / KEY_FILE_NAME


def read(path: Path) -> SwarmKeys:
    """Reads a file of swarm keys.

    Raises:
        VsenseError: there is no such file, or others than its owner and one group may read it.
        ConfigError: a line is wrong.
    """
    numbers: dict[int, bytes] = {}
    for line, text in enumerate(read_private(path, 0o640).splitlines(), 1):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        match = _LINE.fullmatch(text.strip())
        if match is None or int(match[1]) in numbers:
            # Its words may be a key's: they are not repeated.
            expected = "expected a number that no other line has, =, and 64 hexadecimal digits"
            raise ConfigError(str(path), line, expected)
        numbers[int(match[1])] = bytes.fromhex(match[2])
    if not numbers:
        raise VsenseError(f"{path}: holds no key")
    return SwarmKeys(numbers)


@contextmanager
def changing(path: Path) -> Iterator[None]:
    """Nobody else changes a file of keys, or that of their holders beside it, meanwhile.

    Raises:
        VsenseError: their folder cannot be made or read.
    """
    with ExitStack() as stack:
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
            stack.callback(os.close, folder)
            fcntl.flock(folder, fcntl.LOCK_EX)
        except OSError as error:
            raise VsenseError(f"{path.parent}: {error.strerror}") from None
        yield


def follow(path: Path) -> SwarmKeys:
    """Makes a key that follows those of a file, or the file with the first one; gives all.

    Raises:
        VsenseError: the file cannot be read or written.
        ConfigError: a line is wrong.
    """
    with changing(path):
        keys = read(path).followed() if path.exists() else make()
        write(path, keys)
    return keys


def drop_former(path: Path, newest: int) -> tuple[SwarmKeys, list[int]]:
    """Takes the keys before one out of a file; gives those that are left, and their numbers.

    Raises as `follow`.
    """
    with changing(path):
        left = read(path)
        former = sorted(number for number in left.keys if number < newest)
        for number in former:
            left = left.without(number)
        if former:
            write(path, left)
    return left, former


def write(path: Path, keys: SwarmKeys) -> None:
    """Writes such a file whole, for its owner alone; a group that could read it still can.

    In the lab's folder its group can.

    Raises:
        VsenseError: it cannot be written.
    """
    text = _HEAD + "".join(f"{number} = {keys.keys[number].hex()}\n" for number in keys.numbers)
    try:
        had = stat.S_IMODE(path.stat().st_mode) & 0o640 if path.exists() else 0o600
        write_private(path, text, mode_in(path.parent) | had)
    except OSError as error:
        raise VsenseError(f"{path}: cannot be written: {error.strerror}") from None


def mode_in(folder: Path) -> int:
    """The mode of a new file there: the lab's members may read what is in its folder."""
    return sharing.READ_MODE if sharing.shares(folder) else 0o600


def write_private(path: Path, text: str, mode: int) -> None:
    """Writes a file whole that nobody but those of its mode can ever read.

    Raises:
        OSError: it cannot be written.
    """
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    replace_text(path, text, mode, "ascii")


def read_private(path: Path, mode: int) -> str:
    """Reads a small file that nobody beyond those of a mode may touch.

    Raises:
        VsenseError: it cannot be read, is no such file, or others may read or change it.
    """
    try:
        opened = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError as error:
        raise VsenseError(f"{path}: cannot be read: {error.strerror}") from None
    status = os.fstat(opened)
    if not stat.S_ISREG(status.st_mode):
        os.close(opened)
        raise VsenseError(f"{path}: is no file")
    with os.fdopen(opened, "rb") as file:
        check_private(file, path, "it", mode, mode)
        data = file.read(MAX_KEY_FILE_BYTES + 1)
    if len(data) > MAX_KEY_FILE_BYTES or not data.isascii():
        raise VsenseError(f"{path}: expected a text of at most {MAX_KEY_FILE_BYTES} bytes")
    return data.decode("ascii")
