"""Processes of this machine, its free ports, and commands whose lines can be waited for."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

PATIENCE_S = 60


def children(pid: int) -> list[int]:
    """The children of a process, in the order in which they were started."""
    return [int(n) for n in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def descendants(of: int | None = None) -> set[int]:
    """All processes of a process that have not ended, and theirs; by default of this one."""
    listed = subprocess.run(
        ["ps", "-eo", "pid=,ppid=,stat="], capture_output=True, text=True, check=True
    )
    rows = [line.split() for line in listed.stdout.splitlines()]
    root = os.getpid() if of is None else of
    found, before = {root}, set()
    while found != before:
        before = set(found)
        found |= {int(pid) for pid, parent, stat in rows if int(parent) in found and stat[0] != "Z"}
    return found - {root}


def is_alive(pid: int | None) -> bool:
    """Whether the process runs; one that waits to be reaped does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def free_ports(count: int) -> list[int]:
    """TCP ports of this machine that nobody has."""
    servers = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [int(server.getsockname()[1]) for server in servers]
    for server in servers:
        server.close()
    return ports


def free_port() -> int:
    """A TCP port of this machine that nobody has."""
    return free_ports(1)[0]


def parent_of(folder: Path) -> int:
    """Process id of the parent of the process whose folder in /proc this is."""
    return int((folder / "stat").read_text().rpartition(")")[2].split()[1])


class Program:
    """A running program; what it says on stderr can be waited for."""

    def __init__(
        self,
        command: Sequence[str],
        cwd: Path | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.process = subprocess.Popen(
            command,
            cwd=cwd,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.said: list[str] = []
        self.printed: list[str] = []
        self._news = threading.Condition()
        self._readers = [
            threading.Thread(target=self._read, args=(stream, lines), daemon=True)
            for stream, lines in (
                (self.process.stderr, self.said),
                (self.process.stdout, self.printed),
            )
        ]
        for reader in self._readers:
            reader.start()

    def _read(self, stream: IO[str], lines: list[str]) -> None:
        for line in stream:
            with self._news:
                lines.append(line)
                self._news.notify_all()

    def wait_for(self, pattern: str) -> str:
        """Waits until it has said a line that matches."""

        def found() -> str | None:
            return next((line for line in self.said if re.search(pattern, line)), None)

        with self._news:
            assert self._news.wait_for(found, PATIENCE_S), "".join(self.said)
            return found() or ""

    def end(self) -> int:
        """Waits for its end and gives its exit code."""
        code = self.process.wait(PATIENCE_S)
        for reader in self._readers:
            reader.join(PATIENCE_S)
        return code


class Lab(Program):
    """A running `vsense lab`.

    `module` is the program, where it is another one with the same words.
    """

    def __init__(self, directory: Path, *arguments: str, module: str = "vsense") -> None:
        self.directory = directory
        words = ["lab", *arguments, "--output", str(directory)]
        super().__init__([sys.executable, "-m", module, *words])

    def summary(self) -> dict[str, object]:
        """The summary file that it left."""
        return json.loads((self.directory / "summary.json").read_text())

    def relatives(self) -> dict[int, str]:
        """Living processes of this run, by the run directory in their arguments or parentage."""
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
                parent = parent_of(folder)
            except (OSError, ValueError):
                continue
            ours = parent == self.process.pid or str(self.directory) in command
            if ours and int(folder.name) != self.process.pid and command:
                found[int(folder.name)] = command
        return found

    def daemon(self, tag: int) -> int:
        """Process id of a robot's worker: the parent of the two."""
        trace = f"robots/{tag}.trace"
        both = {pid for pid, command in self.relatives().items() if trace in command}
        (worker,) = (pid for pid in both if parent_of(Path(f"/proc/{pid}")) not in both)
        return worker


def order(word: str, lab: Lab, *more: str) -> None:
    """Gives the lab an order, by another command."""
    words = [sys.executable, "-m", "vsense", word, *more, "--process", str(lab.process.pid)]
    subprocess.run(words, check=True, capture_output=True)
