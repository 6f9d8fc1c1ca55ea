"""The first day's page, typed from an empty folder by somebody who reads nothing else.

Ports are those of the page, in a network of its own.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from scripts.site.blocks import blocks
from tests.conftest import require_tool, share_parts
from tests.rigs.places import ROOT
from vsense.config import roster
from vsense.run.runs_csv import RUNS, read_runs

pytestmark = [pytest.mark.system, pytest.mark.paced]

PAGE = ROOT / "vsense" / "modes" / "live" / "FIRST_DAY.md"
OWN_TERMINAL = "# in a terminal of its own"
READY = {"pretend": "they wait for", "emulate": "they connect to", "replay": "http://127.0.0.1"}
"""What a command says that goes on until Ctrl-C, by its action."""
SHORTER = {"--link-check": "--link-check 2", "--duration 20": "--duration 3"}
PATIENCE_S = 180
IN_NETWORK = ("unshare", "-r", "-n", "sh", "-c", 'ip link set lo up && exec "$@"', "sh")


class Day:
    """A folder, a network, and what is typed there."""

    def __init__(self, folder: Path) -> None:
        require_tool("unshare", "util-linux")
        require_tool("ip", "iproute2")
        self.folder = folder / "day"
        self.folder.mkdir()
        (folder / "bin").mkdir()
        vsense = folder / "bin" / "vsense"
        vsense.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m vsense "$@"\n')
        vsense.chmod(0o755)
        share_parts(folder / ".cache")
        own = {"HOME": str(folder), "XDG_CONFIG_HOME": str(folder / "config")}
        own["XDG_CACHE_HOME"] = str(folder / ".cache")
        runtime = {"XDG_RUNTIME_DIR": str(folder), "PYTHONPATH": os.environ.get("PYTHONPATH", "")}
        self._env = {**os.environ, **own, **runtime}
        self._env["PATH"] = f"{folder / 'bin'}:{os.environ['PATH']}"
        # The network lives as long as this shell, which every command joins.
        self._shell = subprocess.Popen([*IN_NETWORK, "sleep", "600"], env=self._env)
        while (Path("/proc") / str(self._shell.pid) / "comm").read_text() != "sleep\n":
            assert self._shell.poll() is None, "no network of its own"
        self._going_on: list[tuple[subprocess.Popen[str], Path]] = []

    def type(self, line: str) -> str:
        """Types a line; gives what is printed. One that goes on is ready when this returns."""
        command = line.removesuffix(OWN_TERMINAL).strip()
        action = next((word for word in command.split() if word in READY), "")
        return self._start(command, READY[action]) if action else self._finish(command)

    def close(self) -> None:
        """Presses Ctrl-C in all terminals."""
        for process, said in self._going_on:
            os.killpg(process.pid, signal.SIGINT)
            assert process.wait(30) in (0, 130), said.read_text()
        self._shell.kill()
        self._shell.wait()

    def _joined(self, command: str) -> list[str]:
        join = ("nsenter", "-t", str(self._shell.pid), "-U", "-n", "--preserve-credentials")
        return [*join, "sh", "-c", f"exec {command}"]

    def _here(self) -> dict[str, Any]:
        return {"cwd": self.folder, "env": self._env, "text": True}

    def _finish(self, command: str) -> str:
        done = subprocess.run(
            self._joined(command), **self._here(), capture_output=True, timeout=PATIENCE_S
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        return done.stdout + done.stderr

    def _start(self, command: str, ready: str) -> str:
        said = self.folder.parent / f"terminal-{len(self._going_on)}"
        with said.open("w") as file:
            own = {"stdout": file, "stderr": file, "start_new_session": True}
            process = subprocess.Popen(self._joined(command), **self._here(), **own)
        self._going_on.append((process, said))
        limit_s = time.monotonic() + PATIENCE_S
        while ready not in said.read_text():
            assert process.poll() is None and time.monotonic() < limit_s, said.read_text()
            time.sleep(0.05)
        return said.read_text()


@contextmanager
def started(folder: Path) -> Iterator[Day]:
    day = Day(folder)
    try:
        yield day
    finally:
        day.close()


@pytest.mark.parametrize(
    "changes", [pytest.param({}, marks=pytest.mark.campaign, id="literally"), SHORTER]
)
def test_the_first_day_is_typed_from_an_empty_folder(
    changes: Mapping[str, str], tmp_path: Path
) -> None:
    said = dict[str, str]()
    with started(tmp_path) as day:
        for block in blocks(PAGE.read_text()):
            for line in block.commands() if block.language == "sh" else ():
                typed = line
                for before, after in changes.items():
                    typed = typed.replace(before, after)
                said[line.split(" #")[0].strip()] = day.type(typed)
    by_name = {name: text for line, text in said.items() for name in [line.split()[1]]}
    (printed,) = re.findall(r"vsense: tags ([\d ]+)", "".join(said.values()))
    there = roster.read(day.folder / "robots.toml")
    (row,) = read_runs(day.folder / "run1" / RUNS)
    # The markers that were printed are the roster's, and those of the first run.
    assert tuple(map(int, printed.split())) == tuple(row.tags) == there.tags
    assert row.valid and row.robots == 4, row.why
    assert row.longest_silence_s is not None and "links over" in by_name["run"]
    assert "4 of 4 robots are as they should be" in "".join(said.values())
    assert (day.folder / "report" / "report.html").exists()
    made = {path.name for path in day.folder.iterdir()}
    lab = {"robots.toml", "robots.battery.csv", "markers.pdf", "lab", "shots"}
    assert made == {"first", *lab, "runs", "run1", "report"}
