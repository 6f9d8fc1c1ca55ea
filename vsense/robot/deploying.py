"""Brings `vsensed` to robots' boards over `ssh`, all at the same time.

Everything travels in one connection per robot, as an archive on `ssh`'s standard input: old
boards have no sftp, which newer `scp` needs, but all have a shell and tar.
"""

from __future__ import annotations

import io
import ipaddress
import shutil
import subprocess
import tarfile
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from vsense.errors import ConfigError, UsageError, VsenseError
from vsense.robot import service
from vsense.robot.hosts import RobotHost

SSH = ("ssh", "-o", "BatchMode=yes", "-o", "ConnectTimeout=10")
"""Never asks for a password: with many robots at once nobody could tell who asks."""

TIMEOUT_S = 120.0

_RECEIVE = 'd=$(mktemp -d /tmp/vsensed.XXXXXX) && tar -xf - -C "$d"'
_MOST = 16


class DeployError(VsenseError):
    """Nothing can be deployed from here."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one robot.

    Attributes:
        robot: which one.
        ok: the daemon is there and runs, and, if asked for, found all to be well.
        text: one line for a person.
        details: what the robot said beside it.
    """

    robot: RobotHost
    ok: bool
    text: str
    details: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Plan:
    """What is deployed, and how.

    Attributes:
        binary: the daemon.
        settings: of all robots; a robot's own win.
        kind: "auto", "systemd", "init" or "none".
        sudo: become root with sudo.
        check: look whether all is well there.
    """

    binary: bytes
    settings: Mapping[str, str] = field(default_factory=dict)
    kind: str = "auto"
    sudo: bool = False
    check: bool = False

    def settings_of(self, robot: RobotHost) -> dict[str, str]:
        """A robot's settings."""
        return {**self.settings, **robot.settings}

    def archive(self, robot: RobotHost) -> bytes:
        """What a robot is sent, as a tar file."""
        files = {
            "vsensed": self.binary,
            "vsensed.conf": service.settings_text(self.settings_of(robot)).encode(),
            **service.files(),
        }
        packed = io.BytesIO()
        with tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as tar:
            for name, content in files.items():
                row = tarfile.TarInfo(name)
                row.size, row.mode = len(content), 0o644
                tar.addfile(row, io.BytesIO(content))
        return packed.getvalue()

    def command(self) -> str:
        """What the robot's shell is told."""
        install = f'{"sudo -n " if self.sudo else ""}sh "$d/install.sh" "$d"'
        return f"{_RECEIVE} && {install} {self.kind} {'check' if self.check else '-'}"


def load(binary: Path) -> bytes:
    """Reads a daemon.

    Raises:
        UsageError: it is not there, or no program.
    """
    try:
        content = binary.read_bytes()
    except OSError as error:
        raise UsageError(
            f"cannot read {binary}: {error.strerror}; make it with: vsense robot build"
        ) from None
    if not content.startswith(b"\x7fELF"):
        raise UsageError(f"{binary} is no program for Linux; make it with: vsense robot build")
    return content


def check(plan: Plan, robots: Iterable[RobotHost], file: str) -> None:
    """Looks whether every robot has the settings that it needs.

    Raises:
        ConfigError: one lacks something; the message has its line.
    """
    for robot in robots:
        settings = plan.settings_of(robot)
        for name, option in (("host", "--host ADDRESS"), ("base", "--base BASE")):
            if name not in settings:
                text = f"no {name} for this robot: add {name}=..., or give {option} for all"
                raise ConfigError(file, robot.line, text)
        try:
            ipaddress.IPv4Address(settings["host"])
        except ValueError:
            text = f"host: expected a numeric IPv4 address, got {settings['host']!r}"
            raise ConfigError(file, robot.line, text) from None
        port = settings.get("port", "")
        if not (port.isascii() and port.isdigit() and 0 < int(port) < 65536):
            raise ConfigError(file, robot.line, f"port: expected 1 to 65535, got {port!r}")


def deploy(
    plan: Plan, robots: Sequence[RobotHost], told: Callable[[Outcome], None] = lambda _: None
) -> list[Outcome]:
    """Deploys to all robots at the same time.

    Args:
        plan: what and how.
        robots: whom to.
        told: called with each outcome as it comes, by any thread.

    Returns:
        The outcomes in the robots' order.

    Raises:
        DeployError: there is no `ssh` here.
    """
    if shutil.which(SSH[0]) is None:
        raise DeployError("no ssh here; install it with: sudo apt install openssh-client")
    crew = _Crew(plan, told)
    with ThreadPoolExecutor(max_workers=_MOST) as pool:
        try:
            return list(pool.map(crew.serve, robots))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            crew.abandon()
            raise


class _Crew:
    """The connections that are open."""

    def __init__(self, plan: Plan, told: Callable[[Outcome], None]) -> None:
        self._plan = plan
        self._told = told
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[bytes]] = set()
        self._abandoned = False

    def serve(self, robot: RobotHost) -> Outcome:
        """Deploys to one robot."""
        try:
            outcome = self._connect(robot)
        except OSError as error:
            outcome = Outcome(robot, False, f"ssh does not start: {error.strerror}")
        if not self._abandoned:
            self._told(outcome)
        return outcome

    def abandon(self) -> None:
        """Ends all connections, and begins no other."""
        with self._lock:
            self._abandoned = True
            for process in self._running:
                process.kill()

    def _connect(self, robot: RobotHost) -> Outcome:
        # Under the lock: a connection that has just begun must not be missed by `abandon`.
        with self._lock:
            if self._abandoned:
                return Outcome(robot, False, "interrupted")
            # In a session of its own: Ctrl-C is ours, and no terminal is asked for anything.
            process = subprocess.Popen(
                [*SSH, robot.destination, self._plan.command()],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                start_new_session=True,
            )
            self._running.add(process)
        try:
            out, err = process.communicate(self._plan.archive(robot), TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return Outcome(robot, False, f"no end after {TIMEOUT_S:g} s")
        finally:
            with self._lock:
                self._running.discard(process)
        return _judge(robot, process.returncode, _lines(out), _lines(err))


def _lines(said: bytes) -> list[str]:
    return [line for line in said.decode(errors="replace").splitlines() if line.strip()]


def _judge(robot: RobotHost, status: int, out: list[str], err: list[str]) -> Outcome:
    """Says what became of a robot."""
    installed = bool(out) and ": vsensed " in out[-1]
    if status == 0 and installed:
        return Outcome(robot, True, out[-1], tuple(out[:-1]))
    if installed:
        bad = [line for line in out[:-1] if " BAD " in line] or ["the check has failed"]
        return Outcome(robot, False, f"{out[-1]}, but {bad[0]}", tuple(out[:-1]))
    return Outcome(robot, False, err[-1] if err else f"ssh ended with {status}", tuple(err[:-1]))
