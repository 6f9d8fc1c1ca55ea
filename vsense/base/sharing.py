"""What several accounts of one machine share: the lab's folder, and who may enter it.

Runs, robots and keys belong to a lab, not to an account. An administrator makes one folder for a
Unix group (`vsense share` says how); what is in it, the group's members see, steer and use, and
nobody else does. The group owns it and its mode is 2770: whatever a member makes in it is the
group's, too. Without such a folder each account has its own runs, keys and leases.

This module needs nothing of vsense but its errors, as `vsense control stop --emergency` does.
"""

from __future__ import annotations

import grp
import os
import pwd
import stat
from dataclasses import dataclass
from pathlib import Path

from vsense.base.errors import VsenseError, failing_as

ENVIRONMENT = "VSENSE_LAB"
"""Names the folder where it is another one; empty: this account shares nothing."""

PLACE = Path("/var/lib/vsense")
GROUP = "vsense"
"""What the folder and its group are called unless an administrator wants other names."""

FOLDER_MODE = 0o2770
READ_MODE, WRITE_MODE = 0o640, 0o660
"""Of files that members may read, and of sockets and files that they may write."""


class SharingError(VsenseError):
    """The lab's folder cannot be used; one line says why, and what mends it."""


class NotMember(SharingError):
    """This account is not in the group that the lab's folder is for."""


@dataclass(frozen=True, slots=True)
class LabFolder:
    """The lab's folder, which this account may enter; `gid` is its group's number."""

    path: Path
    gid: int

    @property
    def group(self) -> str:
        """The group's name."""
        return group_name(self.gid)


def user_name(uid: int | None = None) -> str:
    """An account's name, by default the one that this process belongs to; its number if unknown.

    The system says it: what the environment says, anybody can write.
    """
    number = os.getuid() if uid is None else uid
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return str(number)


def group_name(gid: int) -> str:
    """A group's name; its number if it has none."""
    try:
        return grp.getgrgid(gid).gr_name
    except KeyError:
        return str(gid)


def members(gid: int) -> list[str]:
    """The accounts of a group, and those whose first one it is, as far as the system lists them."""
    try:
        named = set(grp.getgrgid(gid).gr_mem)
    except KeyError:
        named = set()
    return sorted(named | {account.pw_name for account in pwd.getpwall() if account.pw_gid == gid})


def place() -> Path | None:
    """Where the lab's folder would be; None: this account shares nothing.

    SharingError if `VSENSE_LAB` names no whole path.
    """
    named = os.environ.get(ENVIRONMENT)
    if named is None:
        return PLACE
    if named and not os.path.isabs(named):
        raise SharingError(f"{ENVIRONMENT}={named}: expected a path that begins with /")
    return Path(named) if named else None


def lab() -> LabFolder | None:
    """The lab's folder; None: this machine has none, each account is on its own.

    Raises:
        NotMember: there is one, for a group that this account is not in.
        SharingError: it is not as it must be: others may enter it, or it is somebody else's.
    """
    folder = place()
    if folder is None:
        return None
    try:
        status = folder.lstat()
    except FileNotFoundError:
        if os.environ.get(ENVIRONMENT):
            raise SharingError(f"{folder}, which {ENVIRONMENT} names, is not there") from None
        return None
    except OSError as error:
        raise SharingError(f"{folder}: {error.strerror}") from None
    _check(folder, status)
    if os.getuid() != 0 and status.st_gid not in {os.getegid(), *os.getgroups()}:
        raise NotMember(_stranger(folder, status.st_gid))
    return LabFolder(folder, status.st_gid)


def _check(folder: Path, status: os.stat_result) -> None:
    """Refuses a folder into which somebody else could put what we believe."""
    if not stat.S_ISDIR(status.st_mode):
        raise SharingError(f"{folder}: expected a folder, no link and no file")
    if status.st_uid not in (0, os.getuid()):
        owner = user_name(status.st_uid)
        raise SharingError(f"{folder} belongs to {owner}, expected root: sudo chown root {folder}")
    mode = stat.S_IMODE(status.st_mode)
    if mode & stat.S_ISVTX and mode & 0o007:
        # As /tmp is: no command of ours shall close that.
        raise SharingError(f"{folder} is everybody's: expected a folder of the lab's own")
    if mode != FOLDER_MODE:
        what = "others may enter it" if mode & 0o007 else "its group must own what is in it"
        raise SharingError(
            f"{folder}: {what} (mode {mode:04o}): sudo chmod {FOLDER_MODE:o} {folder}"
        )


def _stranger(folder: Path, gid: int) -> str:
    """Why this account may not enter, and what makes it a member."""
    group, user = group_name(gid), user_name()
    if _joined(os.getuid(), gid):
        return (
            f"{folder} is for group '{group}', which {user} has joined since this login began:"
            " log in again"
        )
    return (
        f"{folder} is for group '{group}', and {user} is not in it:"
        f" sudo usermod -aG {group} {user}   # then log in again"
    )


def _joined(uid: int, gid: int) -> bool:
    """Whether the system has an account in a group; without a list of all accounts: that of a
    university takes longer than anybody waits for a stop."""
    try:
        account = pwd.getpwuid(uid)
        return gid in os.getgrouplist(account.pw_name, account.pw_gid)
    except (KeyError, OSError):
        return False


def is_fellow(uid: int) -> bool:
    """Whether an account is in the group of the lab that this one is in."""
    try:
        folder = lab()
    except SharingError:
        return False
    return folder is not None and _joined(uid, folder.gid)


def shares(folder: Path) -> bool:
    """Whether a folder is the lab's, so that its group may read what is in it."""
    try:
        shared = lab()
    except SharingError:
        return False
    return shared is not None and shared.path == folder


def instructions(group: str = GROUP, users: tuple[str, ...] = ()) -> list[str]:
    """What root types so that a lab's accounts share this machine's runs."""
    folder = place() or PLACE
    names = users or (user_name(),)
    return [
        f"groupadd --force {group}",
        *(f"usermod -aG {group} {name}" for name in names),
        f"install -d -o root -g {group} -m {FOLDER_MODE:o} {folder}",
    ]


def write_shared(path: Path, mode: int, flags: int = 0) -> int:
    """Opens a file for reading and writing that all members may use; made where it is missing.

    Gives the descriptor. A link is followed nowhere.

    Raises:
        SharingError: it cannot be opened, or is no plain file.
    """
    with failing_as(SharingError, str(path)):
        opened = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC | flags, mode)
    status = os.fstat(opened)
    if not stat.S_ISREG(status.st_mode) or status.st_nlink != 1:
        # Another name of it may be that of a file of this account's own.
        os.close(opened)
        raise SharingError(f"{path}: expected a plain file that has no other name")
    if status.st_uid == os.getuid() and stat.S_IMODE(status.st_mode) != mode:
        os.fchmod(opened, mode)  # whatever this account's umask is
    return opened
