"""Two accounts of one machine and a third one that is not in their group: real ones, made here.

What each of them starts, root starts, loads, and makes that account's: so it works wherever the
interpreter lies, which others may not be able to reach. The run is a control room's doors without
a lab behind them.
"""

from __future__ import annotations

import os
import pwd
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

pytestmark = pytest.mark.quick

BECOME = """
import grp, os, pwd, sys, threading
import concurrent.futures.thread, encodings.idna
from pathlib import Path
from vsense import cli
from vsense.commands import orders, share
from vsense.base.message_bus import MessageBus
from vsense.robots.link import strangers
from vsense.run.control import Control
from vsense.run.leases import RobotLeases
from vsense.run.orders import Order, OrderKind
from vsense.monitor.ui._server import WebServer
from vsense.monitor.ui.control_socket import ControlSocket

row = pwd.getpwnam(sys.argv[1])
os.initgroups(row.pw_name, row.pw_gid)
os.setgid(row.pw_gid)
os.setuid(row.pw_uid)
os.umask(0o077)
os.environ["HOME"] = os.path.join(os.environ["TMPDIR"], row.pw_name)
"""

OPEN = (
    BECOME
    + """
import socket
port = int(sys.argv[2])
with socket.create_connection(("127.0.0.1", port), 10) as page:
    page.sendall(f"GET /ws HTTP/1.1\\r\\nHost: 127.0.0.1:{port}\\r\\nOrigin: http://127.0.0.1:{port}\\r\\n"
                 "Connection: Upgrade\\r\\nUpgrade: websocket\\r\\nSec-WebSocket-Version: 13\\r\\n"
                 "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\\r\\n\\r\\n".encode())
    print(page.recv(65536).decode(errors="replace"))
"""
)

COMMAND = BECOME + "sys.exit(cli.main(sys.argv[2:]))"

RUN = (
    BECOME
    + """
run = {"run": 1, "time_s": 3.0, "length_s": 60.0, "timestep": 30, "late": 0, "rate_hz": 10.0,
       "latency_ms": None, "silent_s": 0.0}
told, over = lambda text: print(text, flush=True), threading.Event()
control = Control(lambda wanted: told(f"robots: {wanted.name}"), told)
control.begin(lambda: None)

def status():
    now = {**run, "state": control.state.value}
    names = ("tag", "name", "expected")
    return {"name": "wander", "command": "track", "directory": "/", "run": now,
            "robots": {name: [] for name in ("tag", "x_m", "y_m", "yaw_rad", "seen")}}

def leave(by, force):
    over.set()
    return "ends"

with RobotLeases(Path(os.environ["VSENSE_LAB"]), "run", "wander") as leases:
    leases.take([23])
    bell = ControlSocket(status, control.give, hand_over=leave)
    page = WebServer(MessageBus(), control.give, "127.0.0.1", 0)
    page.start()
    told(f"open {page.port}")
    over.wait(60)
    page.close()
    bell.close()
"""
)


@dataclass(frozen=True)
class Lab:
    """A lab's folder, its group, two members and a stranger."""

    folder: Path
    group: str
    anna: str
    ben: str
    carl: str

    def environment(self) -> dict[str, str]:
        # Without these each has a folder of its own in its home.
        homes = ("XDG_RUNTIME_DIR", "XDG_CACHE_HOME")
        kept = {name: value for name, value in os.environ.items() if name not in homes}
        place = {"VSENSE_LAB": str(self.folder), "TMPDIR": str(self.folder.parent)}
        return {**kept, **place, "LOGNAME": "root", "USER": "root"}

    def ask(self, user: str, *words: str) -> subprocess.CompletedProcess[str]:
        """Calls vsense as a user."""
        command = [sys.executable, "-c", COMMAND, user, *words]
        return subprocess.run(
            command, env=self.environment(), capture_output=True, text=True, timeout=60
        )

    def open_page(self, user: str, port: str) -> str:
        """What the page on a port of this machine answers to a user's WebSocket."""
        command = [sys.executable, "-c", OPEN, user, port]
        return subprocess.check_output(command, env=self.environment(), text=True, timeout=60)


@pytest.fixture
def lab() -> Iterator[Lab]:
    if os.getuid() != 0 or shutil.which("useradd") is None:
        pytest.skip("only root can make accounts, and needs useradd: apt install passwd")
    stem = f"vsense-t{os.getpid()}"
    group, users = f"{stem}-g", [f"{stem}-{name}" for name in "abc"]
    place = Path(tempfile.mkdtemp(prefix=f"{stem}-"))
    place.chmod(0o1777)
    try:
        subprocess.run(["groupadd", group], check=True)
        for user in users:
            quiet = ["--no-create-home", "--no-user-group", "--shell", "/bin/false"]
            subprocess.run(["useradd", *quiet, user], check=True, capture_output=True)
        for user in users[:2]:
            subprocess.run(["usermod", "-aG", group, user], check=True)
        folder = place / "lab"
        words = ["install", "-d", "-o", "root", "-g", group, "-m", "2770", str(folder)]
        subprocess.run(words, check=True)
        yield Lab(folder, group, *users)
    finally:
        for user in users:
            subprocess.run(["userdel", user], capture_output=True)
        subprocess.run(["groupdel", group], capture_output=True)
        shutil.rmtree(place)
    assert not {row.pw_name for row in pwd.getpwall()} & set(users)


def test_one_member_stops_the_others_run_and_a_stranger_does_not(lab: Lab) -> None:
    command = [sys.executable, "-c", RUN, lab.anna]
    with subprocess.Popen(command, env=lab.environment(), stdout=subprocess.PIPE, text=True) as run:
        try:
            assert run.stdout is not None
            word, port = run.stdout.readline().split()
            assert word == "open"
            _stranger_stays_outside(lab)
            opened = {user: lab.open_page(user, port) for user in (lab.anna, lab.ben, lab.carl)}
            assert [opened[user].split()[1] for user in (lab.anna, lab.ben)] == ["101", "101"]
            assert opened[lab.carl].startswith("HTTP/1.1 403 ")
            assert f"{lab.anna}&#x27;s, and not for {lab.carl}" in opened[lab.carl]
            seen = lab.ask(lab.ben, "status")
            assert seen.stdout.startswith(f"wander, {lab.anna}'s: run 1 is running"), seen.stderr
            stopped = lab.ask(lab.ben, "stop", "--emergency", "--all")
            assert stopped.returncode == 0 and "EMERGENCY STOP" in stopped.stdout, stopped.stderr
            assert f"vsense camera track, {lab.anna}'s" in stopped.stdout
            assert run.stdout.readline() == "robots: STOP\n"
            assert run.stdout.readline().startswith(f"{lab.ben} (terminal): EMERGENCY STOP")
            given = lab.ask(lab.ben, "handover", "23")
            assert given.returncode == 0 and given.stdout == "robot 23 is free\n", given.stderr
            assert f"ends (a run of {lab.anna}'s)" in given.stderr
            assert run.wait(30) == 0
        finally:
            run.kill()


def _stranger_stays_outside(lab: Lab) -> None:
    """Told which group, and what the members have there is closed to others."""
    for words in (["stop", "--emergency", "--all"], ["handover"]):
        said = lab.ask(lab.carl, *words)
        assert said.returncode == 2 and said.stdout == ""
        assert f"is for group '{lab.group}', and {lab.carl} is not in it" in said.stderr
    files = {path.suffix: path.lstat() for path in lab.folder.iterdir()}
    assert files.keys() == {".sock", ".lease"}
    for found in files.values():
        assert stat.S_IMODE(found.st_mode) == 0o660
        assert found.st_gid == lab.folder.stat().st_gid
