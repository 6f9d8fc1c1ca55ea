"""Brings `vsensed` to robots' boards over `ssh`, with its settings and what starts it.

The folder `board/` holds the files as they go there: a unit for systemd, an init script for boards
without it (plain sh, BusyBox will do), and the script that puts everything in its place.

All robots are served at the same time. Everything travels in one connection per robot, as an
archive on `ssh`'s standard input: old boards have no sftp, which newer `scp` needs, but all have a
shell and tar.
"""

from __future__ import annotations

import io
import ipaddress
import secrets
import shutil
import signal
import subprocess
import tarfile
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from queue import SimpleQueue

from vsense.base.errors import ConfigError, VsenseError
from vsense.base.terminal import printable
from vsense.robots import boards
from vsense.robots.boards import SSH
from vsense.robots.drivers import Driver, check_daemon
from vsense.robots.link.keys import KeySource, robot_file

_BOARD = Path(__file__).parent / "board"
FILES = ("install.sh", "vsensed.init", "vsensed.radio", "vsensed.service")


KEY_FILE = "vsensed.key"
KEY_PLACE = f"/etc/{KEY_FILE}"


def settings_text(settings: Mapping[str, str]) -> str:
    """The settings file: one `name = value` in a line."""
    lines = "".join(f"{name} = {value}\n" for name, value in settings.items())
    return f"# Settings of vsensed, written by `vsense robot deploy`; see vsensed --help.\n{lines}"


def service_files() -> dict[str, bytes]:
    """What is the same on all boards, by name."""
    return {name: (_BOARD / name).read_bytes() for name in FILES}


SSH_TIMEOUT_S = 120.0

_RADIO_STAYS = "stays as it is"
"""What board/vsensed.radio says of a radio whose power saving it cannot turn off."""

_RECEIVE = (
    "d=$(mktemp -d /tmp/vsensed.XXXXXX) && trap 'rm -rf \"$d\"' EXIT && trap 'exit 1' HUP INT TERM"
    ' && tar -xf - -C "$d"'
)
"""What was sent, the robot's key with it, goes away however this ends."""
_MOST = 16
_SSH_FAILED = 255


class DeployError(VsenseError):
    """Nothing can be deployed from here."""


@dataclass(frozen=True, slots=True)
class RobotHost:
    """A robot's board.

    Attributes:
        destination: what `ssh` is told.
        settings: those of its vsensed by their names; "tag" is one of them.
        line: where it stands in the roster.
        files: of its driver, by their names.
    """

    destination: str
    settings: Mapping[str, str]
    line: int
    files: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one robot.

    Attributes:
        robot: which one.
        ok: the daemon is there and runs, and, if asked for, found all to be well.
        text: one line for a person.
        details: what the robot said beside it.
        uid: who it will be for the host, 32 hexadecimal digits; empty where it did not tell.
        keyed: it has the key that was sent, and says so by its uid.
    """

    robot: RobotHost
    ok: bool
    text: str
    details: tuple[str, ...] = ()
    uid: str = ""
    keyed: bool = False


class Part(Enum):
    """What of a robot is replaced; the value is the word for `install.sh`."""

    ALL = ""
    DAEMON = "daemon"
    """The daemon alone, with the controller in it: settings and service stay."""
    SETTINGS = "settings"
    KEY = "key"
    """Its key alone, to a robot that has one."""
    BACK = "rollback"
    """Nothing is sent: the daemon before this one comes back, with its settings."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What is deployed, and how.

    Attributes:
        binaries: the daemon of each robot, by its destination.
        settings: of all robots; a robot's own win.
        kind: "auto", "systemd", "init" or "none".
        sudo: become root with sudo.
        check: look whether all is well there.
        force: replace it in the midst of an experiment, too.
        part: what is replaced.
        ssh_options: NAME=VALUE, as after `ssh -o`.
        keys: what the robots' keys are made of; None: they have none, and obey anybody.
        uids: of each robot that is brought its key, by its destination; with keys only.
    """

    binaries: Mapping[str, bytes] = field(default_factory=dict)
    settings: Mapping[str, str] = field(default_factory=dict)
    kind: str = "auto"
    sudo: bool = False
    check: bool = False
    force: bool = False
    part: Part = Part.ALL
    ssh_options: tuple[str, ...] = ()
    keys: KeySource | None = None
    uids: Mapping[str, bytes] = field(default_factory=dict)

    def settings_of(self, robot: RobotHost) -> dict[str, str]:
        """A robot's settings."""
        settings = {**self.settings, **robot.settings}
        if self.keys is None:
            return settings | {"insecure": "yes"}
        settings.pop("uid", None)  # it stands beside the key
        return settings | {"key": KEY_PLACE}

    def brings_key(self, robot: RobotHost) -> bool:
        """Whether a robot is sent a key of its own."""
        return self.part is not Part.BACK and robot.destination in self.uids

    def _key_file(self, robot: RobotHost) -> bytes:
        assert self.keys is not None
        uid = self.uids[robot.destination]
        return robot_file(uid, self.keys.robot_key(uid)).encode()

    def archive(self, robot: RobotHost) -> bytes:
        """What a robot is sent, as a tar file."""
        files = service_files()
        if self.part in (Part.ALL, Part.DAEMON):
            files["vsensed"] = self.binaries[robot.destination]
        if self.part in (Part.ALL, Part.SETTINGS):
            files["vsensed.conf"] = settings_text(self.settings_of(robot)).encode()
            files |= {f"drivers/{name}": content for name, content in robot.files.items()}
        if self.brings_key(robot):
            files[KEY_FILE] = self._key_file(robot)
        packed = io.BytesIO()
        with tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as tar:
            for name, content in files.items():
                row = tarfile.TarInfo(name)
                row.size, row.mode = len(content), 0o600 if name == KEY_FILE else 0o644
                tar.addfile(row, io.BytesIO(content))
        return packed.getvalue()

    def command(self) -> str:
        """What the robot's shell is told."""
        install = f'{"sudo -n " if self.sudo else ""}sh "$d/install.sh" "$d"'
        words = [self.kind, self.part.value, "check" * self.check, "force" * self.force]
        return f"{_RECEIVE} && {install} {' '.join(filter(None, words))}"


def with_drivers(plan: Plan, robots: Iterable[RobotHost], beside: Path) -> list[RobotHost]:
    """The robots with the files of their drivers, which lie in the folder `beside`, or are shipped.

    Raises:
        UsageError: a daemon that is brought can have none, or a file cannot be read.
    """
    done = []
    for robot in robots:
        driver = Driver.of(plan.settings_of(robot).get("base", ""), beside)
        if driver is not None and plan.binaries:
            check_daemon(plan.binaries[robot.destination], robot.destination)
        if driver is not None and plan.part is Part.ALL:
            base, files = driver.on_board()
            robot = replace(robot, settings={**robot.settings, "base": base}, files=files)
        done.append(robot)
    return done


_ADD = {"host": 'add run_host = "..."', "base": 'add base = "..."'}
"""How a roster says it."""


def check(plan: Plan, robots: Iterable[RobotHost], file: str) -> None:
    """Looks whether every robot has the settings that it needs.

    Raises:
        ConfigError: one lacks something; the message has its line.
    """
    for robot in robots:
        settings = plan.settings_of(robot)
        for name, option in (("host", "--host ADDRESS"), ("base", "--base BASE")):
            if name not in settings:
                text = f"no {name} for this robot: {_ADD[name]}, or give {option} for all"
                raise ConfigError(file, robot.line, text)
        try:
            ipaddress.IPv4Address(settings["host"])
        except ValueError:
            text = f"--host: expected a numeric IPv4 address, got {settings['host']!r}"
            raise ConfigError(file, robot.line, text) from None
        port = settings.get("port", "")
        if not (port.isascii() and port.isdigit() and 0 < int(port) < 65536):
            raise ConfigError(file, robot.line, f"--port: expected 1 to 65535, got {port!r}")


def deploy(
    plan: Plan, robots: Sequence[RobotHost], report: Callable[[Outcome], None] = lambda _: None
) -> list[Outcome]:
    """Deploys to all robots at the same time; of those with one uid each gets its own.

    Args:
        plan: what and how.
        robots: where to.
        report: called with each outcome as it comes, by any thread.

    Returns:
        The outcomes in the robots' order.

    Raises:
        DeployError: there is no `ssh` here.
    """
    if shutil.which(SSH[0]) is None:
        raise DeployError("no ssh here; install it with: sudo apt install openssh-client")
    outcomes = _serve_all(plan, robots, report)
    clones = _clones(plan, outcomes)
    if not clones or plan.part is not Part.ALL:
        return [_tell_clone(outcome) if outcome in clones else outcome for outcome in outcomes]
    # Cards that were copied, with the id that the first of them was given.
    own = [replace(o.robot, settings={**o.robot.settings, "uid": new_uid()}) for o in clones]
    again = iter(_serve_all(replace(plan, part=Part.SETTINGS, force=True), own, lambda _: None))
    return [_renamed(next(again)) if outcome in clones else outcome for outcome in outcomes]


def new_uid() -> str:
    """An id that no other robot has."""
    return secrets.token_hex(16)


def _clones(plan: Plan, outcomes: Sequence[Outcome]) -> list[Outcome]:
    """The robots that have their uid in common with another one.

    Who was brought a key was given its uid with it, whatever another board says of itself.
    """
    count = Counter(outcome.uid for outcome in outcomes)
    return [o for o in outcomes if count[o.uid] > 1 and o.uid and not plan.brings_key(o.robot)]


def _tell_clone(outcome: Outcome) -> Outcome:
    text = f"{outcome.text}, but another robot has its uid {outcome.uid}"
    return replace(outcome, ok=False, text=f"{text}: deploy to both with their settings")


def _renamed(outcome: Outcome) -> Outcome:
    text = "its uid was another robot's, too: it has one of its own now"
    return replace(outcome, text=f"{outcome.text}; {text}") if outcome.ok else outcome


def _serve_all(
    plan: Plan, robots: Sequence[RobotHost], report: Callable[[Outcome], None]
) -> list[Outcome]:
    crew = _Crew(plan, report)
    done: SimpleQueue[Future[Outcome]] = SimpleQueue()
    with ThreadPoolExecutor(max_workers=_MOST) as pool:
        # Ctrl-C between the taking of a lock and its `with` leaves it locked for ever: it waits
        # until all that this thread does is wait, for a queue that has no such place.
        held = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            try:
                futures = [pool.submit(crew.serve, robot) for robot in robots]
                for future in futures:
                    future.add_done_callback(done.put)
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, held)
            for _ in futures:
                done.get()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            crew.abandon()
            raise
    return [future.result() for future in futures]


class _Crew:
    """The connections that are open."""

    def __init__(self, plan: Plan, report: Callable[[Outcome], None]) -> None:
        self._plan = plan
        self._report = report
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
            self._report(outcome)
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
                boards.ssh_command(robot.destination, self._plan.ssh_options, self._plan.command()),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                start_new_session=True,
            )
            self._running.add(process)
        try:
            out, err = process.communicate(self._plan.archive(robot), SSH_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return Outcome(robot, False, f"no end after {SSH_TIMEOUT_S:g} s")
        finally:
            with self._lock:
                self._running.discard(process)
        outcome = _judge(robot, process.returncode, _lines(out), _lines(err))
        plan = self._plan
        if not plan.brings_key(robot) or not outcome.uid:
            return outcome
        given = plan.uids[robot.destination].hex()
        if outcome.uid == given:
            return replace(outcome, keyed=True)
        text = f"{outcome.text}, but it says that its uid is {outcome.uid}; it was given {given}"
        return replace(outcome, ok=False, text=text)


def _lines(said: bytes) -> list[str]:
    lines = said.decode(errors="replace").splitlines()
    return [boards.in_words(printable(line)) for line in lines if line.strip()]


def _judge(robot: RobotHost, status: int, out: list[str], err: list[str]) -> Outcome:
    installed = bool(out) and ": vsensed " in out[-1]
    if installed:
        uids = [line.split()[1] for line in out[:-1] if line.startswith("uid: ")]
        text, details = out[-1], tuple(out[:-1])
        if status != 0:
            bad = [line for line in details if " BAD " in line] or ["the check has failed"]
            text = f"{text}, but {bad[0]}"
        # That power saving could not be turned off is no failure, and has to be known.
        stays = [line.removeprefix("radio: ") for line in details if _RADIO_STAYS in line]
        text = "; ".join([text, *stays])
        return Outcome(robot, status == 0, text, details, "".join(uids))
    text = err[-1] if err else f"ssh ended with {status}"
    way_out = boards.ssh_advice(robot.destination, err) if status == _SSH_FAILED else None
    return Outcome(robot, False, f"{text}: {way_out}" if way_out else text, tuple(err[:-1]))
